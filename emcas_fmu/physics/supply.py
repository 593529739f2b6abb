"""Supply of a drive: source, DC link with brake chopper, inverter and electronics.

    C dv/dt = i_s - i_b - i_q - P/v                                   v: link voltage, the limit of the motor voltage
    i_s = (V_s - v)/R_s, not below 0 if one way                       current from the source
    i_b = max(v - V_b, 0)/R_b                                         current of the brake chopper
    P = v_m i + U_d |i| + R_d i^2                                     power of motor and inverter
    i_q = P_q/v, below the trip voltage P_q v/V_t^2                   current of the electronics

U_d |i| is the loss of a fixed drop and of switching, R_d i^2 that of a resistance. The bridge opens when v falls below
V_t, and works again above the recovery voltage. The losses load the link and do not reduce the motor's voltage. An open
bridge rectifies the back-EMF only with :mod:`emcas_fmu.physics.inverter`.
"""

from __future__ import annotations

from typing import Any

from ..ops.base import TINY, Ops, Value

_FAR = 1e30  # V, distance to an edge that is not ahead


def tripped(ops: Ops, p: Any, link: Value, before: Value) -> Value:
    """Return whether the bridge is open at a link voltage [V]; `before` is above 0 if the bridge was open before."""
    low = link < p.supply.trip_voltage
    return ops.either(low, ops.both(before > 0.0, link <= p.supply.recovery_voltage))


def inverter_loss(ops: Ops, p: Any, current: Value) -> Value:
    """Return the power [W] that the inverter loses at a motor current [A]."""
    return p.supply.device_voltage * ops.fabs(current) + p.supply.device_resistance * current * current


def source_current(ops: Ops, p: Any, link: Value, source: Value) -> Value:
    """Return the current [A] from a `source` [V] into the link [V]."""
    current = (source - link) / p.supply.source_resistance
    return ops.where(p.supply.one_way, ops.maximum(current, 0.0), current)


def brake_power(ops: Ops, p: Any, link: Value) -> Value:
    """Return the power [W] that the chopper turns into heat at a link voltage [V]."""
    return ops.maximum(link - p.supply.chopper_voltage, 0.0) / p.supply.chopper_resistance * link


def load_current(ops: Ops, p: Any, link: Value, power: Value) -> Value:
    """Return the current [A] that motor and inverter, with a `power` [W], and the electronics draw from the link.

    The motor draws none below the trip voltage. Power that remains where a step ends below it is divided by the trip
    voltage.
    """
    trip = p.supply.trip_voltage
    return (power + p.supply.quiescent_power * ops.minimum(link / trip, 1.0)) / ops.maximum(link, trip)


def _to_edge(ops: Ops, p: Any, link: Value, source: Value, load: Value, h: Value, level: Value | None = None
             ) -> tuple[Value, Value, Value]:
    """Return the link's voltage [V] after `h` [s] or when diode or chopper switches, the time left [s], and the charge
    [A.s] from the source until then. A fall of the link to a `level` [V] also ends the interval.

    In the interval dv/dt = slope exp(-rate t), whose sign is constant. The charge is the sum of the charges into link,
    load and chopper.
    """
    one_way, chopper = p.supply.one_way, p.supply.chopper_voltage
    flowing = source_current(ops, p, link, source) - load
    slope = (flowing - ops.maximum(link - chopper, 0.0) / p.supply.chopper_resistance) / p.supply.capacitance
    up = slope > 0.0
    side = ops.where(up, 1.0, -1.0)
    # Exactly at its edge, diode or chopper conducts if the link's voltage moves to the side on which it conducts.
    fed = ops.either(ops.negate(one_way), ops.either(link < source, ops.both(ops.equal(link, source), ops.negate(up))))
    braked = ops.either(link > chopper, ops.both(ops.equal(link, chopper), up))
    rate = (ops.where(fed, 1.0 / p.supply.source_resistance, 0.0)
            + ops.where(braked, 1.0 / p.supply.chopper_resistance, 0.0)) / p.supply.capacitance
    divisor = ops.where(rate > 0.0, rate, 1.0)
    speed = ops.fabs(slope)
    way = speed * ops.where(rate > 0.0, (1.0 - ops.exp(-rate * h)) / divisor, h)

    to_source, to_chopper = side * (source - link), side * (chopper - link)
    to_source = ops.where(ops.both(one_way, to_source > 0.0), to_source, _FAR)
    to_chopper = ops.where(to_chopper > 0.0, to_chopper, _FAR)
    edge, ahead = ops.where(to_source <= to_chopper, source, chopper), ops.minimum(to_source, to_chopper)
    if level is not None:
        to_level = ops.where(up, _FAR, ops.maximum(link - level, 0.0))
        edge, ahead = ops.where(to_level <= ahead, level, edge), ops.minimum(to_level, ahead)
    meets = way > ahead

    def on_the_way() -> tuple[Value, ...]:
        rest = ops.maximum(1.0 - rate * ahead / speed, TINY)
        time = ops.where(rate > 0.0, -ops.log(rest) / divisor, ahead / speed)
        return edge, ops.maximum(h - time, 0.0)

    end, left = ops.branch(meets, on_the_way, lambda: (link + side * way, 0.0))
    gained, time = end - link, h - left
    beyond = (link - chopper) * time + (slope * time - gained) / divisor
    charge = p.supply.capacitance * gained + load * time + ops.where(braked, beyond / p.supply.chopper_resistance, 0.0)
    return end, left, ops.where(fed, charge, 0.0)


def moved(ops: Ops, p: Any, link: Value, source: Value, load: Value, h: Value, edges: int = 2) -> tuple[Value, Value]:
    """Return the link's voltage [V] after `h` [s] with a `load` current [A] and a `source` voltage [V], and the charge
    [A.s] from the source.

    The result is exact for a constant load and source, however stiff. Diode and chopper switch at most once each.
    """
    end, left, charge = _to_edge(ops, p, link, source, load, h)
    if edges:
        def further() -> tuple[Value, ...]:
            last, then = moved(ops, p, end, source, load, left, edges - 1)
            return last, charge + then

        end, charge = ops.branch(left > 0.0, further, lambda: (end, charge))
    return ops.maximum(end, 0.0), charge


def trip_time(ops: Ops, p: Any, link: Value, source: Value, load: Value, h: Value, edges: int = 2) -> Value:
    """Return the time [s] in which the link falls to the trip voltage, at most `h`; arguments as in :func:`moved`."""
    trip = p.supply.trip_voltage
    end, left, _ = _to_edge(ops, p, link, source, load, h, trip)
    if not edges:
        return ops.where(end <= trip, h - left, h)

    def further() -> tuple[Value, ...]:
        then = trip_time(ops, p, end, source, load, left, edges - 1)
        return (ops.where(then < left, h - left + then, h),)

    on = ops.both(left > 0.0, end > trip)
    return ops.branch(on, further, lambda: (ops.where(end <= trip, h - left, h),))[0]


def mean_ahead(ops: Ops, p: Any, current: Value, mean: Value, interval: Value) -> Value:
    """Return the source's mean current [A] in the next interval [s] at the same source voltage.

    `current` [A] is the current at the end of the last interval, `mean` [A] the mean in it. The result is exact for a
    constant load, and not below 0 for a source of one way.
    """
    decay, kept = _decay(ops, p, interval)
    ahead = current + (current - mean) * (decay * (1.0 - kept) / (kept - decay))
    return ops.where(p.supply.one_way, ops.maximum(ahead, 0.0), ahead)


def admittance(ops: Ops, p: Any, interval: Value) -> Value:
    """Return the mean current in an interval [s] per change of the source's voltage at the interval's start [1/Ohm]."""
    return _decay(ops, p, interval)[1] / p.supply.source_resistance


def _decay(ops: Ops, p: Any, interval: Value) -> tuple[Value, Value]:
    """Return exp(-t/(R_s C)) at the end of an interval [s], and its mean in the interval."""
    ratio = interval / (p.supply.source_resistance * p.supply.capacitance)
    decay = ops.exp(-ratio)
    return decay, (1.0 - decay) / ratio
