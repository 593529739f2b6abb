"""Pump between the two chambers of a cylinder, on the shaft of a motor, with its valves.

    J w' = K_t i - D (p1 - p2) - B w - (T_c + k |p1 - p2|) sgn w
    Q1 = D w - (xi + K_b o) (p1 - p2) - K_r r(p1 - p2) + C_e (p_a - p1) + K_c max(p_a - p_o - p1, 0)
    Q2 = -(D w - ...)                                  + C_e (p_a - p2) + K_c max(p_a - p_o - p2, 0)
    r(dp) = dp - p_r sgn dp beyond +-p_r, else 0

D is the pump's displacement per radian, J the inertia of rotor and pump; B, T_c and k describe the shaft's friction.
p_a is the pressure of reservoir and case. The conductances are xi of the pump's leakage from side to side, C_e of its
leakage to the case, K_b o of the bypass valve, open by the share o, K_r of the relief valves, one for each direction,
which open at p_r, and K_c of the check valves through which the reservoir refills a chamber, with the cracking pressure
p_o. Leakage and friction are those of Merritt, "Hydraulic Control Systems" (1967), chapter 4.

Oil does not bear tension: at the pressure p_v a void opens. Flow into or out of the chamber then changes the void, and
the pressure hardly: the chamber has a modulus far below the oil's. The void has to close before the pressure exceeds
p_v again.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from ..ops.base import Ops, Value
from . import drive


class Valves(NamedTuple):
    """Which check valves are open, which relief valve is open (1: from chamber 1, -1: from 2, 0: neither), and which
    chambers have a void."""

    check_1: Value
    check_2: Value
    relief: Value
    void_1: Value
    void_2: Value


class Lines(NamedTuple):
    """Coefficients of the flows [m3/s] in a state of the valves: ``cross`` (p1 - p2) - ``set`` from chamber 1 to 2, and
    ``feed`` - ``drain`` p from the reservoir into a chamber; ``share`` [-] is a chamber's modulus over that of oil."""

    cross: Value
    set: Value
    feed_1: Value
    drain_1: Value
    feed_2: Value
    drain_2: Value
    share_1: Value
    share_2: Value


def refill_pressure(p: Any) -> Value:
    """Return the pressure [Pa] below which the check valve of a chamber is open."""
    return p.reservoir.pressure - p.check_valve.cracking_pressure


def at_rest(ops: Ops, p: Any) -> Value:
    """Return the pressure [Pa] of a chamber at rest without load."""
    return ops.maximum(p.reservoir.pressure, p.oil.cavitation_pressure)


def valves(ops: Ops, p: Any, pressure_1: Value, pressure_2: Value) -> Valves:
    """Return the state of the valves at pressures [Pa]."""
    refill, void, drop = refill_pressure(p), p.oil.cavitation_pressure, pressure_1 - pressure_2
    over = p.relief_valve.pressure
    relief = ops.where(drop > over, 1.0, ops.where(drop < -over, -1.0, 0.0))
    return Valves(pressure_1 < refill, pressure_2 < refill, relief, pressure_1 <= void, pressure_2 <= void)


SHUT = Valves(False, False, 0.0, False, False)
"""All valves shut and no void."""


def bypass(ops: Ops, p: Any, enabled: Value) -> Value:
    """Return the conductance [m3/(s.Pa)] of the bypass valve; `opens_disabled` opens it fully while disabled."""
    open_ = ops.where(ops.both(p.bypass_valve.opens_disabled, ops.negate(enabled)), 1.0, p.bypass_valve.opening)
    return open_ * p.bypass_valve.conductance


def lines(ops: Ops, p: Any, v: Valves, bypassing: Value) -> Lines:
    """Return the coefficients of the flows in a state of the valves; `bypassing` is the bypass's conductance."""
    case, check, reservoir, refill = (p.pump.case_leakage, p.check_valve.conductance, p.reservoir.pressure,
                                      refill_pressure(p))
    fed, fed_by_check = case * reservoir, case * reservoir + check * refill
    relieved = ops.where(ops.equal(v.relief, 0.0), 0.0, p.relief_valve.conductance)
    soft = p.oil.cavitated_modulus / p.oil.bulk_modulus
    return Lines(p.pump.leakage + bypassing + relieved, relieved * p.relief_valve.pressure * v.relief,
                 ops.where(v.check_1, fed_by_check, fed), ops.where(v.check_1, case + check, case),
                 ops.where(v.check_2, fed_by_check, fed), ops.where(v.check_2, case + check, case),
                 ops.where(v.void_1, soft, 1.0), ops.where(v.void_2, soft, 1.0))


def flows(p: Any, line: Lines, motor_speed: Value, pressure_1: Value, pressure_2: Value) -> tuple[Value, Value]:
    """Return the flows [m3/s] into both chambers at a motor speed [rad/s]."""
    across = p.pump.displacement * motor_speed - (line.cross * (pressure_1 - pressure_2) - line.set)
    return across + (line.feed_1 - line.drain_1 * pressure_1), (line.feed_2 - line.drain_2 * pressure_2) - across


def driving(p: Any, current: Value, drop: Value) -> Value:
    """Return the torque [N.m] of a motor current [A] and a pressure drop [Pa] from chamber 1 to 2 on the shaft."""
    return drive.torque(p, current) - p.pump.displacement * drop


def dry(ops: Ops, p: Any, drop: Value) -> Value:
    """Return the dry friction [N.m] of the shaft at a pressure drop [Pa]."""
    return p.pump.coulomb_friction + p.pump.pressure_friction * ops.fabs(drop)


def acceleration(p: Any, speed: Value, torque: Value) -> Value:
    """Return the shaft's acceleration [rad/s2] at a speed [rad/s], under a torque [N.m] and viscous friction."""
    return (torque - p.pump.viscous_friction * speed) / p.inertia.motor


def margins(ops: Ops, p: Any, v: Valves, pressure_1: Value, pressure_2: Value) -> dict[str, Value]:
    """Return the event margins [Pa] of the valves and voids by name."""
    refill, void, over = refill_pressure(p), p.oil.cavitation_pressure, p.relief_valve.pressure
    drop = pressure_1 - pressure_2

    def below(pressure: Value, level: Value, is_below: Value) -> Value:
        return ops.where(is_below, level - pressure, pressure - level)

    return {"relief": ops.where(ops.equal(v.relief, 0.0), over - ops.fabs(drop), v.relief * drop - over),
            "check_1": below(pressure_1, refill, v.check_1), "check_2": below(pressure_2, refill, v.check_2),
            "void_1": below(pressure_1, void, v.void_1), "void_2": below(pressure_2, void, v.void_2)}
