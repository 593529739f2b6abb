"""Rules for the parameters of electromechanical actuators: lever, friction, gains and inertias."""

from __future__ import annotations

from collections.abc import Callable
from math import degrees, radians
from typing import Any

from ...ops.base import Ops, Value
from ...physics import mechanics
from ...physics.friction import coulomb_polynomial
from ...rules import ANGLE, SLACK, Rule, in_degrees, rising, rule, when
from ..shared import TABLE_POINTS

# The tangent of the lever's angle grows without bound towards 90 deg.
LARGEST_LEVER_ANGLE = radians(85.0)


@rule(f"|kinematics.initial_angle| = {ANGLE}, nominal or as built, and fin.stop_angle = {ANGLE} add up to {ANGLE}; the "
      f"sum must be below {LARGEST_LEVER_ANGLE:.6g} rad ({degrees(LARGEST_LEVER_ANGLE):.6g} deg)")
def lever_angle(ops: Ops, p: Any, _: Value) -> tuple[Value, ...]:
    nominal, off = p.kinematics.initial_angle, p.deviation.kinematics.initial_angle
    initial = ops.maximum(ops.fabs(nominal), ops.fabs(nominal + off))
    stop = p.fin.stop_angle
    return (when(ops, initial + stop >= LARGEST_LEVER_ANGLE * (1.0 - SLACK)), initial, in_degrees(initial),
            stop, in_degrees(stop), initial + stop, in_degrees(initial + stop))


def _friction(direction: str) -> Rule:
    @rule(f"friction.coulomb.{direction} = [{', '.join(['%.6g'] * 7)}] N.m gives a friction of %.6g N.m at fin_angle = "
          f"{ANGLE}; it must not be below 0 within +-fin.stop_angle = {ANGLE}", scanned=True)
    def check(ops: Ops, p: Any, share: Value) -> tuple[Value, ...]:
        coefficients, stop = getattr(p.friction.coulomb, direction), p.fin.stop_angle
        angle = stop * share
        value = coulomb_polynomial(coefficients, angle)
        largest = coulomb_polynomial([ops.fabs(c) for c in coefficients], stop)
        below = -value - SLACK * largest
        return below, *coefficients, value, angle, in_degrees(angle), stop, in_degrees(stop)

    return check


@rule("encoder.multiplier = %.6g must be 1, 2 or 4")
def encoder_multiplier(ops: Ops, p: Any, _: Value) -> tuple[Value, ...]:
    value = p.encoder.multiplier
    known = ops.either(ops.equal(value, 1.0), ops.either(ops.equal(value, 2.0), ops.equal(value, 4.0)))
    return when(ops, ops.negate(known)), value


def _stable(name: str, share: float) -> Rule:
    """Return the rule that a gain [1/s] corrects at most this `share` of an error in a sample."""
    @rule(f"controller.{name} = %.6g 1/s must be at most {share:g}/controller.sample_time = %.6g 1/s")
    def check(ops: Ops, p: Any, _: Value) -> tuple[Value, ...]:
        gain, fastest = getattr(p.controller, name), share / p.controller.sample_time
        return when(ops, gain > fastest * (1.0 + SLACK)), gain, fastest

    return check


@rule("friction.temperature = %.6g degC is outside the range in which friction was measured, friction.identified_from "
      "= %.6g to friction.identified_to = %.6g degC: friction.table is an estimate there", warning=True)
def identified(ops: Ops, p: Any, _: Value) -> tuple[Value, ...]:
    low, now, high = p.friction.identified_from, p.friction.temperature, p.friction.identified_to
    return when(ops, ops.either(now < low, now > high)), now, low, high


@rule("friction.identified_from = %.6g degC must be at most friction.identified_to = %.6g degC")
def identified_range(ops: Ops, p: Any, _: Value) -> tuple[Value, ...]:
    low, high = p.friction.identified_from, p.friction.identified_to
    return when(ops, low > high), low, high


@rule("controller.position.setpoint_weight = %.6g with controller.position.ki = %.6g 1/s2: without an integral the fin "
      "does not reach its command; set the weight to 1", warning=True)
def setpoint_weight(ops: Ops, p: Any, _: Value) -> tuple[Value, ...]:
    position = p.controller.position
    short = ops.both(ops.equal(position.ki, 0.0), ops.negate(ops.equal(position.setpoint_weight, 1.0)))
    return when(ops, short), position.setpoint_weight, position.ki


def inertias(p: Any, viscous: Value) -> tuple[Value, Value]:
    """Return two inertias [kg.m2] at the motor: that of nut and fin, and that of motor and screw.

    The ratio is moment arm over lead, the smallest in the lever's travel.
    `viscous` [kg.m2] is added to the inertia about the hinge.
    """
    lead, lever = p.screw.lead, p.screw.lead / p.kinematics.moment_arm
    fin = p.inertia.fork + p.inertia.shaft + p.inertia.fin + viscous
    return p.mass.nut * lead * lead + lever * lever * fin, p.inertia.motor + p.inertia.screw


# Largest -e J_l/J_r: e is the backward efficiency, J_l and J_r are the inertias of load and rotor. At 1 the screw jams.
MOST_JAMMING = 0.9


def jams(ops: Ops, p: Any, backward: Value, tick: Value) -> tuple[Value, ...]:
    """Return 1 if -e J_l exceeds MOST_JAMMING J_r, else 0, and e, J_r and J_l [kg.m2]; e is the efficiency `backward`.

    J_l includes the hinge's viscous friction in the midpoint rule with a `tick` [s].
    """
    load, rotor = inertias(p, 0.5 * tick * mechanics.hinge_friction(p).viscous)
    return when(ops, -backward * load > MOST_JAMMING * rotor), backward, rotor, load


def jamming(turning: str, change: Callable[[Ops, Any], Any], tick: Callable[[Ops, Any], Value]) -> Rule:
    """Return the rule against a backward efficiency with which a screw jams; `turning` names the screw's rotor.

    `change(ops, p)` returns the parameters of a screw, `tick(ops, p)` the longest tick [s].
    """
    @rule(f"efficiency.backward = %.6g must not be below minus {MOST_JAMMING:g} times the inertia of {turning} over "
          "that of the load at the motor, %.6g over %.6g kg.m2; raise it")
    def check(ops: Ops, p: Any, _: Value) -> tuple[Value, ...]:
        return jams(ops, change(ops, p), p.efficiency.backward, tick(ops, p))

    return check


FRICTION_RULES = (_friction("positive"), _friction("negative"))
OBSERVER_RULE = _stable("load_observer", 1.0)
# The drive's anti-windup acts on two integrals at once.
ANTIWINDUP_RULES = (_stable("antiwindup", 1.0), _stable("drive_antiwindup", 0.5))
TEMPERATURE_RULES = (rising("friction.table.temperature", TABLE_POINTS, "degC"), identified_range, identified)
