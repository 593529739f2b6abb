"""A supply bus that several drives share: a battery with resistance and charge, and optionally a common DC link.

    V_b = V_source - U q/(Q - q)                    open-circuit voltage after a charge q of Q; U polarisation
    V = max(V_b - R I, V_0)        I = sum P_i / V
    with a link:  C dV/dt = max(V_b - V, 0)/R - I - max(V - V_c, 0)/R_c

V is the voltage at the drives, P_i the power of a drive, R the battery's resistance; V_c and R_c are those of the
link's brake chopper. V_b is the no-load voltage E_0 - K Q/(Q - q) of the generic battery model of Tremblay, Dessaint
and Dekkiche (2007), IEEE Vehicle Power and Propulsion Conference, 284-289, without its exponential; V_source = E_0 - K
and U = K. V_b falls slowly at first, and steeply as the battery becomes empty. Without a link all returned current
flows into the battery; its charge does not rise above the full one. With a link a diode protects the battery from being
charged: returned power raises V until drives or the chopper consume it.

The bus is updated at intervals h; V is constant in between. Within h a drive at its voltage limit changes its current
by about dV h/L for a change dV. Without a link the new sag V_source - V is therefore the intersection of two lines,
that of the drives' current over V and that of the source, V_b - R I (one step of Newton's method): otherwise the sag
would overshoot unless R h/L is small. A link follows its equation exactly under a constant I: the present one or,
of actuators with their own links, the mean since the last update (:func:`emcas_fmu.physics.supply.moved`). Drives and
link are stepped in turn. The oscillation of the link with the drives' inductances stays bounded if C >= h^2 sum 1/L_i;
a smaller C is raised to this value. V_0 is a millivolt, or the source's voltage if that is less, so that I = sum P_i/V
is finite on a collapsed bus; at V = 0 the drives' I is 0.

Drives on which the voltage has no effect keep their power P = sum P_i. Without a link V is the higher solution of
V = V_b - R P/V, and at least V_b/2, where the source supplies its largest power. A link does not fall below V_b/2 due
to the drives; below it they draw at most V_b/(2 R), so that it recovers. Its C is at least h |I|/V if P < 0.

For an actuator with its own link, q rises by the charge that flowed to it in the interval. The sag follows from the
mean current that the actuator will draw in the next interval, with 1/L = Y/h, where Y is its mean admittance. Within an
interval only the part c = Y h of its link's capacitance follows a change of V. If C >= sum c, the exchange between bus
and links gains no energy.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from ..namespace import namespace
from ..ops.base import Ops, Value
from . import supply

LEAST_VOLTAGE = 1e-3  # V, V_0 of a source with a higher voltage
NO_LINK = -1.0  # V, state of a link that does not exist or has not been stepped yet
EMPTY = 1e-6  # smallest remaining share of the charge for which the open-circuit voltage is computed


def voltage(ops: Ops, source: Value, sag: Value, link: Value, _: Value) -> Value:
    """Return V [V], at least V_0: that of the link or, without a link, the voltage of the source minus the sag."""
    least = ops.clip(source, 0.0, LEAST_VOLTAGE)
    return ops.where(link < 0.0, ops.maximum(source - sag, least), ops.maximum(link, least))


def fall(ops: Ops, p: Any, drawn: Value) -> Value:
    """Return the fall [V] of the open-circuit voltage with a charge [A.s] `drawn` since the start; 0 if unlimited."""
    full = ops.where(p.charge > 0.0, p.charge, 1.0)
    share = ops.where(p.charge > 0.0, ops.clip((drawn + p.charge_used) / full, 0.0, 1.0 - EMPTY), 0.0)
    return p.polarisation * share / (1.0 - share)


def start(ops: Ops, p: Any) -> tuple[Value, ...]:
    """Return the start values of the states of :func:`following`, without a current."""
    return ops.where(p.source_resistance > 0.0, fall(ops, p, 0.0), 0.0), NO_LINK, 0.0


def following(ops: Ops, p: Any, source: Value, states: Sequence[Value], current: Value, mean: Value,
              inverse_inductance: Value, keeps_power: bool = False) -> tuple[Value, ...]:
    """Return sag [V], voltage of the link [V] and charge drawn [A.s] after an update of the bus.

    The drives draw a `current` [A] from now on; `mean` [A] is the same or, with links of their own, the past mean;
    `inverse_inductance` is sum 1/L_i [1/H]. With `keeps_power` the voltage has no effect on the drives.
    """
    sag, link, drawn = states
    h, fallen, resistance = p.update_time, fall(ops, p, drawn), p.source_resistance
    before, open_circuit = voltage(ops, source, sag, link, drawn), ops.maximum(source - fallen, 0.0)

    def linked() -> tuple[Value, ...]:
        load, least, floor = mean, h * h * inverse_inductance, 0.0
        if keeps_power:
            most = open_circuit / (2.0 * resistance)
            load = ops.where(before > open_circuit / 2.0, mean, ops.minimum(mean, most))
            least = h * ops.maximum(-mean, 0.0) / ops.maximum(before, LEAST_VOLTAGE)
            floor = ops.minimum(before, open_circuit / 2.0)
        of_link = namespace({"supply.source_resistance": resistance, "supply.one_way": True,
                             "supply.capacitance": ops.maximum(p.capacitance, least),
                             "supply.chopper_voltage": p.chopper_voltage,
                             "supply.chopper_resistance": p.chopper_resistance})
        after, charge = supply.moved(ops, of_link, before, open_circuit, load, h)
        return sag, ops.maximum(after, floor) if keeps_power else after, drawn + ops.maximum(charge, 0.0)

    def direct() -> tuple[Value, ...]:
        if keeps_power:
            root = ops.sqrt(ops.maximum(open_circuit * open_circuit - 4.0 * resistance * current * before, 0.0))
            reached = source - (open_circuit + root) / 2.0
        else:
            admittance = h * inverse_inductance
            reached = sag + (resistance * current + fallen - sag) / (1.0 + resistance * admittance)
        return reached, link, ops.maximum(drawn + mean * h, -p.charge_used)  # a full battery stores no more

    return ops.branch(p.capacitance > 0.0, linked, direct)
