"""Warnings about parameters that contradict one another: a wrong unit, another motor's winding, a slow drive.

The limits are rules of thumb, far from the values of the shipped actuators. The equations have the supply as an input:
rules about its start value are checked only when a set of parameters is loaded.
"""

from __future__ import annotations

from collections.abc import Callable
from math import degrees, pi
from typing import Any

from ...control import sensors
from ...ops.base import Ops, Value
from ...physics import mechanics
from ...physics.friction import coulomb
from ...rules import Rule, in_degrees, rule, when
from ..composition import with_parameters
from .rules import inertias

# Largest ratio of the load's inertia to the rotor's, rarely above 30 in servo drives, and of the rotor's to the load's.
MOST_LOAD, MOST_ROTOR = 100.0, 1000.0
# Largest ratio of L/R to J R/K_t^2: 0.05 to 20 in servo motors; with mH entered as H it would be 1000 times as large.
MOST_WINDING = 30.0
MOST_FRICTION = 0.5  # largest dry friction as a share of the motor's torque at its current limit
COARSEST_COUNT = 0.01  # largest count as a share of command.limit: accuracy over range in the thesis's Table 2
MOST_JUMP = 0.1  # largest current reference due to one count in a sample, as a share of the current limit
# Largest phase lag [rad] of delay and sampling at the velocity loop's crossover: 30 deg of margin are left.
MOST_LAG = pi / 3.0


@rule("the load's inertia at the motor is %.6g kg.m2 and that of motor and screw %.6g kg.m2: a ratio above "
      f"{MOST_LOAD:g} or below 1/{MOST_ROTOR:g}; check the units of inertia.* (1 g.cm2 is 1e-7 kg.m2) and the "
      "reduction", warning=True)
def matched_inertia(ops: Ops, p: Any, _: Value) -> tuple[Value, ...]:
    load, rotor = inertias(p, 0.0)
    return when(ops, ops.either(load > MOST_LOAD * rotor, rotor > MOST_ROTOR * load)), load, rotor


@rule("dry friction at the motor, %.6g N.m at fin angle 0, is over half of motor.torque_constant times "
      "drive.current_limit = %.6g N.m: little is left for a load; check the units of friction", warning=True)
def little_friction(ops: Ops, p: Any, _: Value) -> tuple[Value, ...]:
    torque = p.motor.torque_constant * p.drive.current_limit
    dry = ops.maximum(coulomb(ops, p, 1.0, 0.0), coulomb(ops, p, -1.0, 0.0))
    dry = dry + mechanics.hinge_friction(p).dry * p.screw.lead / p.kinematics.moment_arm
    return when(ops, dry > MOST_FRICTION * torque), dry, torque


@rule("drive.current_limit = %.6g A is never reached: drive.current_gain times drive.reference_limit is %.6g A; check "
      "the gain and both limits", warning=True)
def reachable_current(ops: Ops, p: Any, _: Value) -> tuple[Value, ...]:
    most = p.drive.current_gain * p.drive.reference_limit
    return when(ops, most < p.drive.current_limit), p.drive.current_limit, most


@rule(f"a count of the encoder is %.6g deg of the fin, over {COARSEST_COUNT:g} of command.limit = %.6g deg: check "
      "encoder.pulses and encoder.multiplier", warning=True)
def fine_counts(ops: Ops, p: Any, _: Value) -> tuple[Value, ...]:
    step = sensors.resolution(p) * ops.where(p.encoder.on_fin, 1.0, p.screw.lead / p.kinematics.moment_arm)
    coarse = ops.both(p.encoder.enabled, step > COARSEST_COUNT * p.command.limit)
    return when(ops, coarse), in_degrees(step), in_degrees(p.command.limit)


@rule("a count of the encoder in a sample is %.6g rad/s, for which controller.velocity.kp commands %.6g A, out of "
      "drive.current_limit = %.6g A: the current will be noise; raise encoder.pulses or controller.sample_time, or "
      "lower the gain", warning=True)
def quiet_current(ops: Ops, p: Any, _: Value) -> tuple[Value, ...]:
    speed = sensors.resolution(p) / p.controller.sample_time
    current = speed * p.controller.velocity.kp * p.drive.current_gain
    return (when(ops, ops.both(p.encoder.enabled, current > MOST_JUMP * p.drive.current_limit)), speed, current,
            p.drive.current_limit)


def stable_velocity(inertia: Callable[[Any], Value]) -> Rule:
    """Return the rule for the velocity loop's crossover; `inertia(p)` returns the inertia at the motor [kg.m2].

    With an ideal current loop the loop's gain falls as 1/s: the crossover w_c is controller.velocity.kp times
    drive.current_gain times K_t/J. The phase lag of delay and sampling is w_c (t_d + T): half a sample time T each for
    the hold and for the speed, a difference of two counts.
    """
    @rule("the velocity loop crosses over at about %.6g rad/s (controller.velocity.kp times drive.current_gain times "
          "motor.torque_constant over the inertia), where drive.transport_delay and controller.sample_time, %.6g s "
          f"together, cost %.3g deg of phase, more than {degrees(MOST_LAG):.3g}: it will ring or be unstable; tune the "
          "gains (emcas tune)", warning=True)
    def check(ops: Ops, p: Any, _: Value) -> tuple[Value, ...]:
        crossover = p.controller.velocity.kp * p.drive.current_gain * p.motor.torque_constant / inertia(p)
        late = p.drive.transport_delay + p.controller.sample_time
        return when(ops, crossover * late > MOST_LAG), crossover, late, in_degrees(crossover * late)

    return check


def plausible_winding(inertia: Callable[[Any], Value]) -> Rule:
    """Return the rule for the winding's time constant; `inertia(p)` returns the inertia at the motor [kg.m2].

    The rule compares it with the mechanical time constant J R/K_t^2, or with the sample time if that is longer.
    """
    @rule("motor.inductance = %.6g H over motor.resistance = %.6g Ohm is a time constant of %.6g s, more than "
          f"{MOST_WINDING:g} times the mechanical one of %.6g s (inertia times motor.resistance over "
          "motor.torque_constant squared) and controller.sample_time: check the units (1 mH is 1e-3 H)", warning=True)
    def check(ops: Ops, p: Any, _: Value) -> tuple[Value, ...]:
        electrical = p.motor.inductance / p.motor.resistance
        mechanical = inertia(p) * p.motor.resistance / (p.motor.torque_constant * p.motor.torque_constant)
        slow = electrical > MOST_WINDING * ops.maximum(mechanical, p.controller.sample_time)
        return when(ops, slow), p.motor.inductance, p.motor.resistance, electrical, mechanical

    return check


VELOCITY_RULE, WINDING_RULE = (make(lambda p: sum(inertias(p, 0.0))) for make in (stable_velocity, plausible_winding))
RULES_WITHOUT_WINDING = (matched_inertia, little_friction, reachable_current, fine_counts, quiet_current, VELOCITY_RULE)
RULES = (*RULES_WITHOUT_WINDING, WINDING_RULE)


def of_screw(change: Callable[[Ops, Any], Any]) -> tuple[Rule, ...]:
    """Return the RULES for the parameters that `change(ops, p)` returns, those of an equivalent screw and lever."""
    return tuple(rule._replace(check=with_parameters(rule.check, change)) for rule in RULES)


@rule("drive.supply_voltage = %.6g V over motor.back_emf_constant is a no-load speed of %.6g rad/s (%.6g rpm): the "
      "motor never reaches controller.speed_limit = %.6g rad/s; check both constants and the limit", warning=True)
def reachable_speed(ops: Ops, p: Any, _: Value) -> tuple[Value, ...]:
    supply, back_emf, limit = p.drive.supply_voltage, p.motor.back_emf_constant, p.controller.speed_limit
    free = supply / ops.maximum(back_emf, 1e-12)
    return when(ops, supply < back_emf * limit), supply, free, 30.0 / pi * free, limit


@rule("drive.current_limit = %.6g A needs %.6g V across motor.resistance at standstill, more than drive.supply_voltage "
      "= %.6g V: the motor does not reach that current; check these values", warning=True)
def current_at_standstill(ops: Ops, p: Any, _: Value) -> tuple[Value, ...]:
    supply, limit, resistance = p.drive.supply_voltage, p.drive.current_limit, p.motor.resistance
    return when(ops, supply < resistance * limit), limit, resistance * limit, supply


SUPPLY_RULES = (reachable_speed, current_at_standstill)
