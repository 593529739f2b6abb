"""The plant in continuous time: physics functions wired together, over any operations namespace.

Dry friction is left out: it has no slope at rest, and the linear analyses are about what remains
when it is compensated. Of the two directions' viscous coefficients the mean acts, which is the
fundamental of the pair for a motion both ways.
"""

from __future__ import annotations

from typing import Any

from ..ops.base import Ops, Value
from ..physics import drive, kinematics, mechanics


def motor(ops: Ops, p: Any, force: tuple[float, float], angle: Value, speed: Value, current: Value, voltage: Value,
          aero_torque: Value) -> tuple[Value, ...]:
    """d/dt of motor angle [rad/s], speed [rad/s2] and current [A/s] under a voltage [V] and hinge moment [N.m].

    `force` is the specific force [m/s2] along x and z of the fin's frame. (2.17), (2.46), (2.47).
    """
    m = mechanics.coefficients(ops, p, angle, aero_torque, *force)
    damping = 0.5 * (mechanics.damping(ops, p, m, 1.0) + mechanics.damping(ops, p, m, -1.0))
    torque = drive.torque(p, current) + m.load - damping * speed + m.centrifugal * speed * speed
    rise = voltage - p.motor.resistance * current - drive.back_emf(p, speed)
    return speed, torque / m.inertia, rise / p.motor.inductance


def current_controller(ops: Ops, p: Any, integral: Value, reference: Value, current: Value) -> tuple[Value, ...]:
    """d/dt of xi [V/s] and the voltage [V] demanded, for an analogue reference [V] and a current [A]; section 3.2.2."""
    i_ref = drive.current_reference(ops, p, reference)
    return p.drive.ki * (i_ref - current), drive.voltage_demand(p, i_ref, current, integral)


def fin(ops: Ops, p: Any, angle: Value) -> Value:
    """Fin angle [rad] at a motor angle [rad]."""
    return kinematics.fin_angle(ops, p, kinematics.lever_tangent(ops, p, angle))
