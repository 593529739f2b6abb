"""Loss of a loaded screw, (e - 1) L w of :mod:`emcas_fmu.physics.screw`, from an actuator's states and outputs."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ..namespace import Record
from ..ops.base import Ops, Value
from . import drive_line, friction, kinematics, loads, mechanics, screw


def loss(ops: Ops, p: Any, x: Record, u: Record, shown: Mapping[str, Value]) -> Value:
    """Return the power [W] that the screw turns into heat; `shown` contains the actuator's other outputs."""
    speed, fin = shown["motor_speed"], shown["fin_angle"]
    direction = ops.where(speed > 0.0, 1.0, -1.0)

    def rigid() -> tuple[Value, Value]:  # J_l [kg.m2] and L_0 [N.m]
        m = mechanics.coefficients(ops, p, kinematics.motor_angle(ops, p, fin))
        m = m._replace(load=shown["hinge_torque"] * m.gain + p.screw.lead * loads.nut_force(ops, p, u))
        return screw.load_inertia(p, m.gain), screw.load(p, m, speed, direction)

    def elastic() -> tuple[Value, Value]:  # only the nut is rigidly behind the screw
        deflection, rate = x.motor_angle - x.fin_side_angle, x.motor_speed - x.fin_side_speed
        c = drive_line.line(ops, p, x.fin_side_angle)
        pressed, flank = drive_line.pressed(ops, c, deflection, rate)
        torque = ops.where(pressed, drive_line.torque(c, deflection, rate, flank), 0.0)
        return screw.nut_inertia(p), torque - p.screw.lead * loads.nut_force(ops, p, u)

    def turning() -> tuple[Value, ...]:
        inertia, load = (ops.branch(drive_line.rigid(ops, p), rigid, elastic) if p.structure.drive_line else rigid())
        net = (shown["motor_torque"] + mechanics.rotor_torque(p, u)
               - direction * friction.coulomb(ops, p, direction, fin, speed)
               - friction.viscous(ops, p, direction) * speed)
        transmitted, e = screw.transmitted(ops, p, net, inertia, load, direction, speed)
        return ((e - 1.0) * transmitted * speed,)

    return ops.branch(ops.fabs(speed) > 0.0, turning, lambda: (0.0,))[0]
