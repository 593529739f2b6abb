"""LuGre bristles instead of exact stick at the motor: presliding, frictional lag, rate-dependent breakaway.

    dz/dt = w - sigma_0 |w| z/g(w)            g = C_m (1 + (s - 1) exp(-(w/w_s)^2)) + C_f/R
    torque = sigma_0 z + sigma_1(w) dz/dt     sigma_1(w) = sigma_1/(1 + sigma_1 |w|/g)

w is the motor's speed, z the bristles' mean deflection, C_m the Coulomb friction at the motor, C_f the dry friction
about the hinge, R the ratio of motor to fin speed. Viscous friction is added to the torque. The model is that of
Canudas de Wit, Olsson, Astrom and Lischinsky (1995), "A new model for control of systems with friction", IEEE
Transactions on Automatic Control 40 (3), 419-425. The power of friction minus the rate of sigma_0 z^2/2 is a quadratic
form of dz/dt and z, which is never negative if sigma_1(w) |w| <= 4 g. As the damping fades with speed,
q = sigma_1(w) |w|/g < 1 for any sigma_1, and

    torque = (1 - q) sigma_0 z + q g sgn w

is between the bristles' spring torque and sliding friction: it never exceeds the largest g on the way, not even at a
reversal. Without friction, g = 0, bristles slip at once and transmit nothing. :mod:`emcas_fmu.steppers.lugre` solves
these equations.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from ..actuators import capabilities
from ..actuators.declaration import Actuator, PlantInputs, State, Values
from ..namespace import Record
from ..ops.base import Ops, Value
from ..physics import mechanics
from ..rules import SLACK, Rule, rule, when
from ..steppers.electrical import Motor, states
from ..steppers.lugre import advance
from ..variables import in_group, parameter, real_output
from .declaration import Extension

PARAMETERS = in_group(
    "lugre",
    parameter("stiffness", "N.m/rad", 1e-3, 1e6, "stiffness of the bristles at the motor, sigma_0"),
    parameter("damping", "N.m.s/rad", 0.0, 1.0, "damping of the bristles at rest, sigma_1; it fades with speed"),
    parameter("static_ratio", "1", 1.0, 10.0, "ratio of breakaway to Coulomb friction at the motor, s"),
    parameter("stribeck_speed", "rad/s", 1e-3, 1e3,
              "motor speed at which 1/e of the excess over Coulomb friction is left, w_s", display="rpm"),
)
OUTPUTS = (
    real_output("bristle_deflection", "rad", "mean deflection of the bristles at the motor", 0.01),
    real_output("friction_torque", "N.m", "friction at the motor without viscous friction, positive against positive "
                "motion", 0.1),
)


def extend(actuator: Actuator) -> Actuator:
    """Return the actuator with bristles, whose deflection is a state."""
    def step(ops: Ops, p: Any, x: Record, u: PlantInputs, h: Value) -> tuple[Values, Value]:
        moved, deflection, used = advance(ops, actuator.plant_parameters(ops, p), states(Motor, x),
                                          x.bristle_deflection, u, h)
        return {**moved._asdict(), "bristle_deflection": deflection}, used

    def output_values(ops: Ops, p: Any, x: Record, u: PlantInputs) -> Values:
        built = actuator.plant_parameters(ops, p)
        m = mechanics.coefficients(ops, built, x.motor_angle, u)
        rate, damping = mechanics.bristles(ops, built, m, x.motor_speed)
        torque = p.lugre.stiffness * x.bristle_deflection + damping * (x.motor_speed - rate * x.bristle_deflection)
        return {**actuator.output_values(ops, p, x, u), "bristle_deflection": x.bristle_deflection,
                "friction_torque": torque}

    return replace(actuator, states=(*actuator.states, State("bristle_deflection", "rad")), step=step,
                   output_values=output_values)


def _rules(actuator: Actuator) -> tuple[Rule, ...]:
    # At this limit the rotor's oscillation on its bristles advances 1 rad in a tick, and its period is 8 % too long.
    @rule("lugre.stiffness = %.6g N.m/rad must be at most %.6g N.m/rad, the motor's inertia over the square of the "
          "tick of %.6g s; lower it or solver.max_tick")
    def resolved(ops: Ops, p: Any, _: Value) -> tuple[Value, ...]:
        inertia = mechanics.screw_inertia(actuator.equation_parameters(ops, p))
        tick, stiffness = actuator.longest_tick(ops, p), p.lugre.stiffness
        largest = inertia / (tick * tick)
        return when(ops, stiffness > largest * (1.0 + SLACK)), stiffness, largest, tick

    return (resolved,)


EXTENSION = Extension(
    "lugre", "LuGre friction at the motor", extend,
    needs=(capabilities.RIGID_DRIVE_LINE, capabilities.CURRENT_LOOP, capabilities.COULOMB_FRICTION,
           capabilities.SCREW_LOAD, capabilities.DRIVE_STEP, capabilities.SCREW_EQUATIONS),
    replaces=(capabilities.COULOMB_FRICTION, capabilities.SCREW_LOAD), parameters=lambda actuator: PARAMETERS,
    outputs=OUTPUTS, rules=_rules)
