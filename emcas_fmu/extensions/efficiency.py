"""Efficiency of the screw in forward and backward drive (:mod:`emcas_fmu.physics.screw`).

Steps follow from the parameters alone; what is added is the output `screw_loss`.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from ..actuators import capabilities
from ..actuators.declaration import Acting, Actuator, Values
from ..actuators.electromechanical.interface import inertias
from ..namespace import Record
from ..ops.base import Ops, Value
from ..physics import drive_line, friction, kinematics, loads, mechanics, screw
from ..rules import Rule, when
from ..variables import parameter, real_output
from .declaration import Extension

PARAMETERS = (
    parameter("efficiency.forward", "1", 0.01, 1.0, "efficiency of the screw where the motor drives the load"),
    parameter("efficiency.backward", "1", -10.0, 1.0,
              "efficiency of the screw where the load drives the motor (0 or less: it cannot)"),
)
LOSS = real_output("screw_loss", "W", "power that the loaded screw turns into heat", 100.0)
# Of the rotor's inertia, that of the load side times -efficiency.backward: the rest is left to accelerate.
MOST_JAMMING = 0.9


def _load_side(ops: Ops, p: Any, speed: Value, fin: Value, moment: Value, u: Acting, direction: Value
               ) -> tuple[Value, Value]:
    """Return J_l [kg.m2] and L_0 [N.m] of a rigid drive line at a speed of the motor [rad/s] and a fin angle [rad]."""
    m = mechanics.coefficients(ops, p, kinematics.motor_angle(ops, p, fin))
    m = m._replace(load=moment / m.ratio + p.screw.lead * loads.nut_force(ops, p, u))
    return screw.load_inertia(p, m.ratio), screw.load(p, m, speed, direction)


def _line_load(ops: Ops, p: Any, x: Record, fin: Value, u: Acting) -> tuple[Value, Value]:
    """Return the same with an elastic drive line behind screw and nut."""
    deflection, rate = x.motor_angle - x.fin_side_angle, x.motor_speed - x.fin_side_speed
    c = drive_line.line(ops, p, x.fin_side_angle)
    pressed, flank = drive_line.pressed(ops, c, deflection, rate)
    torque = ops.where(pressed, drive_line.torque(c, deflection, rate, flank), 0.0)
    return screw.nut_inertia(p), torque - p.screw.lead * loads.nut_force(ops, p, u)


def loss(ops: Ops, p: Any, x: Record, u: Acting, shown: Mapping[str, Value]) -> Value:
    """Return the power [W] that the screw turns into heat, from the states and the actuator's other outputs."""
    speed, fin = shown["motor_speed"], shown["fin_angle"]
    direction = ops.where(speed > 0.0, 1.0, -1.0)

    def rigid() -> tuple[Value, Value]:
        return _load_side(ops, p, speed, fin, shown["hinge_torque"], u, direction)

    def turning() -> tuple[Value, ...]:
        inertia, load = rigid() if not p.structure.drive_line else ops.branch(
            drive_line.rigid(ops, p), rigid, lambda: _line_load(ops, p, x, fin, u))
        net = (shown["motor_torque"] + mechanics.rotor_torque(p, u)
               - direction * friction.coulomb(ops, p, direction, fin, speed)
               - friction.viscous(ops, p, direction) * speed)
        transmitted, e = screw.transmitted(ops, p, net, inertia, load, direction)
        return ((e - 1.0) * transmitted * speed,)

    return ops.branch(ops.fabs(speed) > 0.0, turning, lambda: (0.0,))[0]


def extend(actuator: Actuator) -> Actuator:
    """Return the actuator with such a screw: steps see its parameters."""
    def output_values(ops: Ops, p: Any, x: Record, u: Acting) -> Values:
        outputs = actuator.output_values(ops, p, x, u)
        return {**outputs, LOSS.name: loss(ops, actuator.plant_parameters(ops, p), x, u, outputs)}

    return replace(actuator, output_values=output_values, structure=replace(actuator.structure, screw_losses=True))


def _rules(actuator: Actuator) -> tuple[Rule, ...]:
    def jamming(ops: Ops, p: Any, _: Value) -> tuple[Value, ...]:
        """Return J_r + e J_l > 0 in every tick, with the hinge's viscous friction in the midpoint rule; R >= d/l."""
        load, rotor = inertias(p, 0.5 * actuator.longest_tick(ops, p) * p.friction.fin_viscous)
        return when(ops, -p.efficiency.backward * load > MOST_JAMMING * rotor), p.efficiency.backward, rotor, load

    def jamming_line(ops: Ops, p: Any, _: Value) -> tuple[Value, ...]:
        return when(ops, p.efficiency.backward < 0.0), p.efficiency.backward

    rigid = Rule(jamming, f"efficiency.backward = %.6g must not be below minus {MOST_JAMMING:g} times the inertia of "
                          "motor and screw over that of the load at the motor, %.6g over %.6g kg.m2")
    line = Rule(jamming_line, "efficiency.backward = %.6g must not be below 0 with an elastic drive line; 0 is a screw "
                              "that the load cannot drive")
    return (rigid, line) if actuator.structure.drive_line else (rigid,)


EXTENSION = Extension(
    "efficiency", "efficiency of the screw in forward and backward drive", extend, needs=(capabilities.SCREW_LOAD,),
    parameters=lambda actuator: PARAMETERS, outputs=(LOSS,), rules=_rules, module=sys.modules[__name__])
