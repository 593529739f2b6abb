"""What a set of parameter values must fulfil. Standard library only: it is embedded in the FMU.

The rules are written over the operations namespace like the physics, so that the native
FMU's are generated from them. Messages are printf formats of numbers.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from math import degrees, inf, isfinite, pi, radians
from typing import Any, NamedTuple

from .ops.base import Ops, Value
from .ops.floats import FLOATS
from .physics.friction import coulomb_polynomial
from .schedule import longest_tick
from .tree import tree

# The lever's tangent grows without bound towards 90 deg.
LARGEST_LEVER_ANGLE = radians(85.0)
# Of the drive's transport delay, in sample times.
LONGEST_DELAY = 64
# Of a faulty command, in sample times: each is a state.
LONGEST_COMMAND_DELAY = 50
# Beyond it a sample time would cost seconds.
MOST_TICKS = 20_000
SCAN = 100  # points on each side of zero
# Relative. Equal limits may differ in the last digit when they were given in different units.
_SLACK = 1e-12
# Of a homing run, to start, to turn and to settle at zero [s]: an estimate, three times what a clear way takes.
HOMING_SETTLES = 0.3
# Of the rotor's inertia, that of the load side times -efficiency.backward: the rest is left to accelerate.
MOST_JAMMING = 0.9

NOT_FINITE = "%s = %.9g is not a finite number"
BELOW = "%s = %.9g is below its minimum %.9g"
ABOVE = "%s = %.9g is above its maximum %.9g"
_ANGLE = "%.6g rad (%.6g deg)"


class Rule(NamedTuple):
    """A combination of parameters that must not be.

    `check` gives how far the rule is broken (broken above zero) and the numbers of the
    `message`. A `scanned` one is asked for every share of the travel from -1 to 1, and
    the worst is told.
    """

    check: Callable[[Ops, Any, Value], tuple[Value, ...]]
    message: str
    scanned: bool = False


def _degrees(angle: Value) -> Value:
    return angle * (180.0 / pi)


def _broken(ops: Ops, condition: Value) -> Value:
    return ops.where(condition, 1.0, 0.0)


def _travel(ops: Ops, p: Any, _: Value) -> tuple[Value, ...]:
    stop, limit = p.fin.stop_angle, p.command.limit
    return _broken(ops, limit > stop * (1.0 + _SLACK)), stop, _degrees(stop), limit, _degrees(limit)


def _start(ops: Ops, p: Any, _: Value) -> tuple[Value, ...]:
    start, stop = p.fin.start_angle, p.fin.stop_angle
    return (_broken(ops, ops.fabs(start) > stop * (1.0 + _SLACK)), start, _degrees(start), stop, _degrees(stop))


def _lever(ops: Ops, p: Any, _: Value) -> tuple[Value, ...]:
    initial, stop = ops.fabs(p.kinematics.initial_angle), p.fin.stop_angle
    return (_broken(ops, initial + stop >= LARGEST_LEVER_ANGLE * (1.0 - _SLACK)), initial, _degrees(initial),
            stop, _degrees(stop), initial + stop, _degrees(initial + stop))


def _friction(direction: str) -> Rule:
    def check(ops: Ops, p: Any, share: Value) -> tuple[Value, ...]:
        coefficients, stop = getattr(p.friction.coulomb, direction), p.fin.stop_angle
        angle = stop * share
        value = coulomb_polynomial(coefficients, angle)
        largest = coulomb_polynomial([ops.fabs(c) for c in coefficients], stop)
        below = -value - _SLACK * largest
        return below, *coefficients, value, angle, _degrees(angle), stop, _degrees(stop)

    return Rule(check, f"friction.coulomb.{direction} = [{', '.join(['%.6g'] * 7)}] N.m gives a friction of %.6g N.m "
                       f"at fin_angle = {_ANGLE}; it must not be below 0 within +-fin.stop_angle = {_ANGLE}", True)


def _delay(ops: Ops, p: Any, _: Value) -> tuple[Value, ...]:
    delay, period = p.drive.transport_delay, p.controller.sample_time
    return _broken(ops, delay > LONGEST_DELAY * period * (1.0 + _SLACK)), delay, period


def _ticks(ops: Ops, p: Any, _: Value) -> tuple[Value, ...]:
    tick, period = longest_tick(ops, p), p.controller.sample_time
    return _broken(ops, period > MOST_TICKS * tick), period, tick


def _multiplier(ops: Ops, p: Any, _: Value) -> tuple[Value, ...]:
    value = p.encoder.multiplier
    known = ops.either(ops.equal(value, 1.0), ops.either(ops.equal(value, 2.0), ops.equal(value, 4.0)))
    return _broken(ops, ops.negate(known)), value


def _inertia(ops: Ops, p: Any, _: Value) -> tuple[Value, ...]:
    parts = p.inertia
    total = parts.motor + parts.screw + parts.fin + parts.shaft + parts.fork
    return _broken(ops, total <= 0.0), total


def _bristles(ops: Ops, p: Any, _: Value) -> tuple[Value, ...]:
    if not hasattr(p, "lugre"):
        return 0.0, 0.0, 0.0, 0.0
    inertia = p.inertia.motor + p.inertia.screw + p.mass.nut * p.screw.lead * p.screw.lead
    tick, stiffness = longest_tick(ops, p), p.lugre.stiffness
    largest = inertia / (tick * tick)
    return _broken(ops, stiffness > largest * (1.0 + _SLACK)), stiffness, largest, tick


def _homing_push(ops: Ops, p: Any, _: Value) -> tuple[Value, ...]:
    if not hasattr(p, "homing"):
        return 0.0, 0.0, 0.0
    push, most = p.homing.reference_limit, p.drive.reference_limit
    return _broken(ops, push > most * (1.0 + _SLACK)), push, most


def _homing_time(ops: Ops, p: Any, _: Value) -> tuple[Value, ...]:
    if not hasattr(p, "homing"):
        return 0.0, 0.0, 0.0
    # From one stop to the other, back to the first and to zero, each held for the time of a stall. At a constant motor
    # speed zero is not the middle in time. A way may be longer than that between the stops by the tolerance.
    stop, initial = p.fin.stop_angle, p.kinematics.initial_angle
    zero, high, low = ops.tan(initial), ops.tan(initial + stop), ops.tan(initial - stop)
    back = ops.maximum(high - zero, zero - low) / (high - low)
    way = (2.0 + back) * 2.0 * stop + 2.5 * p.homing.travel_tolerance
    least = way / p.homing.speed + 3.0 * p.homing.stall_time + HOMING_SETTLES
    return _broken(ops, p.homing.timeout <= least), p.homing.timeout, least


def _homing_stall(ops: Ops, p: Any, _: Value) -> tuple[Value, ...]:
    """The push, less friction at a stop, brings the motor to homing.speed after the drive's delay: till then it stands
    still as at a stop. Of the lever the least ratio, d/l: the least time."""
    if not hasattr(p, "homing"):
        return 0.0, 0.0, 0.0, 0.0, 0.0
    limit = p.homing.reference_limit
    current = p.pwm.gain * limit / p.motor.resistance if hasattr(p, "pwm") else p.drive.current_gain * limit
    push, stop, coulomb = p.motor.torque_constant * current, p.fin.stop_angle, p.friction.coulomb
    friction = ops.maximum(coulomb_polynomial(coulomb.positive, stop), coulomb_polynomial(coulomb.negative, -stop))
    load, rotor = _inertias(p, 0.0)
    needed = (load + rotor) * p.homing.speed * p.kinematics.moment_arm / p.screw.lead
    lasts = p.homing.stall_time - p.drive.transport_delay
    return _broken(ops, needed >= lasts * (push - friction)), p.homing.stall_time, push, friction, p.homing.speed


def _inertias(p: Any, viscous: Value) -> tuple[Value, Value]:
    """At the motor [kg.m2]: of nut and hinge, with `viscous` [kg.m2] beside the latter's, and of motor and screw."""
    lead, lever = p.screw.lead, p.screw.lead / p.kinematics.moment_arm
    fin = p.inertia.fork + p.inertia.shaft + p.inertia.fin + viscous
    return p.mass.nut * lead * lead + lever * lever * fin, p.inertia.motor + p.inertia.screw


def _jamming(ops: Ops, p: Any, _: Value) -> tuple[Value, ...]:
    """J_r + e J_l > 0 in every tick, with the hinge's viscous friction in the midpoint rule; R is least at d/l."""
    if not hasattr(p, "efficiency"):
        return 0.0, 0.0, 0.0, 0.0
    load, rotor = _inertias(p, 0.5 * longest_tick(ops, p) * p.friction.fin_viscous)
    return _broken(ops, -p.efficiency.backward * load > MOST_JAMMING * rotor), p.efficiency.backward, rotor, load


def _jamming_line(ops: Ops, p: Any, _: Value) -> tuple[Value, ...]:
    if not (hasattr(p, "efficiency") and hasattr(p, "drive_line")):
        return 0.0, 0.0
    return _broken(ops, p.efficiency.backward < 0.0), p.efficiency.backward


def _command_delay(ops: Ops, p: Any, _: Value) -> tuple[Value, ...]:
    """A delay that is switched on or scheduled; others may wait for a longer sample time."""
    if not hasattr(p, "fault"):
        return 0.0, 0.0, 0.0
    own, period = p.fault.command_delay, p.controller.sample_time
    used = ops.either(own.active, own.end > own.begin)
    return _broken(ops, ops.both(used, own.time > LONGEST_COMMAND_DELAY * period * (1.0 + _SLACK))), own.time, period


RULES = (
    Rule(_travel, f"fin.stop_angle = {_ANGLE} must be at least command.limit = {_ANGLE}"),
    Rule(_start, f"fin.start_angle = {_ANGLE} must lie within +-fin.stop_angle = {_ANGLE}"),
    Rule(_lever, f"|kinematics.initial_angle| = {_ANGLE} and fin.stop_angle = {_ANGLE} add up to {_ANGLE}; the sum "
                 f"must be below {LARGEST_LEVER_ANGLE:.6g} rad ({degrees(LARGEST_LEVER_ANGLE):.6g} deg)"),
    _friction("positive"),
    _friction("negative"),
    Rule(_delay, f"drive.transport_delay = %.6g s must be at most {LONGEST_DELAY} times "
                 "controller.sample_time = %.6g s"),
    Rule(_ticks, f"controller.sample_time = %.6g s needs over {MOST_TICKS} ticks of %.6g s; "
                 "raise solver.max_tick or motor.inductance, or lower drive.ki or controller.sample_time"),
    Rule(_multiplier, "encoder.multiplier = %.6g must be 1, 2 or 4"),
    Rule(_inertia, "inertia.motor + inertia.screw + inertia.fin + inertia.shaft + inertia.fork = %.6g kg.m2 "
                   "must be above 0"),
    # 1 rad of the rotor's swing on its bristles in a tick: the period is 8 % long there.
    Rule(_bristles, "lugre.stiffness = %.6g N.m/rad must be at most %.6g N.m/rad, the motor's inertia over the square "
                    "of the tick of %.6g s; lower it or solver.max_tick"),
    Rule(_homing_push, "homing.reference_limit = %.6g V must be at most drive.reference_limit = %.6g V"),
    Rule(_homing_time, "homing.timeout = %.6g s must be above %.6g s: two ways between the stops and one to zero at "
                       "homing.speed, each with homing.travel_tolerance, 3 homing.stall_time, and "
                       f"{HOMING_SETTLES:g} s to settle"),
    Rule(_homing_stall, "homing.stall_time = %.6g s is over before the push of %.6g N.m at the motor, less friction of "
                        "%.6g N.m at a stop, brings it from rest to homing.speed = %.6g rad/s at the fin, "
                        "drive.transport_delay included; raise homing.stall_time or homing.reference_limit, or lower "
                        "homing.speed"),
    Rule(_jamming, f"efficiency.backward = %.6g must not be below minus {MOST_JAMMING:g} times the inertia of motor "
                   "and screw over that of the load at the motor, %.6g over %.6g kg.m2"),
    Rule(_jamming_line, "efficiency.backward = %.6g must not be below 0 with an elastic drive line; 0 is a screw that "
                        "the load cannot drive"),
    Rule(_command_delay, f"fault.command_delay.time = %.6g s must be at most {LONGEST_COMMAND_DELAY} times "
                         "controller.sample_time = %.6g s"),
)


def check_ranges(values: Mapping[str, float], table: Iterable[tuple[str, float, float]]) -> list[str]:
    """Problems of single values: not finite, or outside the inclusive limits of (name, minimum, maximum).

    Values and limits are in the variable table's units. Raises KeyError where `values` lacks a name.
    """
    problems = []
    for name, minimum, maximum in table:
        value = values[name]
        if not isfinite(value):
            problems.append(NOT_FINITE % (name, value))
        elif value < minimum:
            problems.append(BELOW % (name, value, minimum))
        elif value > maximum:
            problems.append(ABOVE % (name, value, maximum))
    return problems


def check_consistency(values: Mapping[str, float]) -> list[str]:
    """Combinations of parameters without physical sense, one message each; none if all is well.

    `values` are in the variable table's units, within their ranges. Non-finite ones are reported alone,
    since nothing can be said of a combination with them.
    """
    problems = [NOT_FINITE % (name, value) for name, value in values.items() if not isfinite(value)]
    if problems:
        return problems
    p = tree(values)
    for rule in RULES:
        worst, numbers = -inf, ()  # type: float, tuple[float, ...]
        for share in (i / SCAN for i in range(-SCAN, SCAN + 1)) if rule.scanned else (0.0,):
            broken, *rest = rule.check(FLOATS, p, share)
            if broken > worst:
                worst, numbers = broken, tuple(rest)
        if worst > 0.0:
            problems.append(rule.message % numbers)
    return problems
