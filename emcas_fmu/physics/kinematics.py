"""Lever and screw, (2.1)-(2.7): fin angle, nut position and motor angle.

    x = d (tan phi - tan phi_0)         nut position; d moment arm, phi = fin_angle + phi_0, phi_0 = initial_angle
    theta = x / l                       motor angle; l = screw lead per radian
    R = d theta/d fin_angle = (d/l) / cos^2 phi

The equation of motion uses the tangent of the lever angle, which is linear in the motor angle. Simpler models have the
constant ratio d/l of small angles and phi_0 = 0, (2.18): theta = (d/l) fin_angle.
"""

from __future__ import annotations

from functools import reduce
from typing import Any

from ..ops.base import Ops, Value


def lever_tangent(ops: Ops, p: Any, motor_angle: Value) -> Value:
    """Return tan(phi) at a motor angle [rad], from (2.1)-(2.5)."""
    gain = p.screw.lead / p.kinematics.moment_arm
    if p.structure.constant_ratio:
        return ops.tan(gain * motor_angle + p.kinematics.initial_angle)
    return gain * motor_angle + ops.tan(p.kinematics.initial_angle)


def fin_angle(ops: Ops, p: Any, tangent: Value) -> Value:
    """Return the fin angle [rad] for tan(phi)."""
    return ops.atan(tangent) - p.kinematics.initial_angle


def fin_at(ops: Ops, p: Any, motor: Value) -> Value:
    """Return the fin angle [rad] at a motor angle [rad], by the inverse of (2.5)."""
    return fin_angle(ops, p, lever_tangent(ops, p, motor))


def motor_angle(ops: Ops, p: Any, fin: Value) -> Value:
    """Return the motor angle [rad] at a fin angle [rad], (2.5); zero at fin angle zero."""
    ratio = p.kinematics.moment_arm / p.screw.lead
    initial = p.kinematics.initial_angle
    if p.structure.constant_ratio:
        return ratio * fin
    return ratio * (ops.tan(fin + initial) - ops.tan(initial))


def deviates(ops: Ops, p: Any, plant: Any) -> Value:
    """Return whether lever or screw in the parameters `plant` differ from those in the nominal parameters `p`."""
    pairs = ((p.kinematics.moment_arm, plant.kinematics.moment_arm), (p.screw.lead, plant.screw.lead),
             (p.kinematics.initial_angle, plant.kinematics.initial_angle))
    return ops.negate(reduce(ops.both, (ops.equal(nominal, actual) for nominal, actual in pairs)))


def reduction_ratio(ops: Ops, p: Any, tangent: Value) -> Value:
    """Return R = d(motor angle)/d(fin angle) [-], (2.6), with 1/cos^2 = 1 + tan^2."""
    if p.structure.constant_ratio:
        return p.kinematics.moment_arm / p.screw.lead
    return p.kinematics.moment_arm / p.screw.lead * (1.0 + tangent * tangent)


def nut_position(ops: Ops, p: Any, motor: Value) -> Value:
    """Return the nut's displacement [m] at a motor angle [rad], (2.1)."""
    return p.screw.lead * motor
