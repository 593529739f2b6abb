"""Worm and wheel: the ratio from their teeth, the efficiencies from lead angle and friction.

    N = z_2/z_1        tan(lambda) = z_1/q        z_1 starts, z_2 teeth, q diameter quotient, alpha pressure angle
    eta_f = (cos alpha - mu tan lambda)/(cos alpha + mu/tan lambda)          the motor drives the load
    eta_b = (cos alpha - mu/tan lambda)/(cos alpha + mu tan lambda)          the load drives the motor

with alpha in the normal section (Budynas & Nisbett, "Shigley's Mechanical Engineering Design", force analysis of worm
gearing). If mu >= cos(alpha) tan(lambda), eta_b <= 0 and the worm locks: no load drives it. Friction falls with the
sliding speed v of the flanks at the worm's pitch diameter q m, where m is the module:

    mu(v) = mu (1 + (s - 1) exp(-(v/v_s)^2))        v = |w| (q m/2)/cos(lambda)
"""

from __future__ import annotations

from typing import Any

from ..ops.base import Ops, Value
from .friction import stribeck


def ratio(p: Any) -> Value:
    """Return N [-], the turns of the worm per turn of the wheel."""
    return p.worm.teeth / p.worm.starts


def lead_tangent(p: Any) -> Value:
    """Return tan(lambda) [-], the tangent of the lead angle."""
    return p.worm.starts / p.worm.diameter_quotient


def sliding_speed(ops: Ops, p: Any, speed: Value) -> Value:
    """Return v [m/s] of the flanks, with the sign of the worm's speed [rad/s]."""
    tangent = lead_tangent(p)
    radius = 0.5 * p.worm.diameter_quotient * p.worm.module
    return speed * (radius * ops.sqrt(1.0 + tangent * tangent))


def coefficient(ops: Ops, p: Any, speed: Value) -> Value:
    """Return mu [-] of the flanks at a speed of the worm [rad/s]."""
    worm = p.worm
    return worm.friction * stribeck(ops, worm.static_ratio, worm.stribeck_speed, sliding_speed(ops, p, speed))


def forward(ops: Ops, p: Any, speed: Value) -> Value:
    """Return eta_f [-] at a speed of the worm [rad/s]."""
    mu, tangent, normal = coefficient(ops, p, speed), lead_tangent(p), ops.cos(p.worm.pressure_angle)
    return (normal - mu * tangent) / (normal + mu / tangent)


def backward(ops: Ops, p: Any, speed: Value) -> Value:
    """Return eta_b [-] at a speed of the worm [rad/s]."""
    mu, tangent, normal = coefficient(ops, p, speed), lead_tangent(p), ops.cos(p.worm.pressure_angle)
    return (normal - mu / tangent) / (normal + mu * tangent)
