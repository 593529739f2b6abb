"""Sampled controllers, section 4.2: PI position loop with anti-windup around a P velocity loop.

    e      = theta(clip(command)) - theta_measured
    w_raw  = Kp_pos e + I        w_ref = clip(w_raw, +-w_max)
    I+     = I + T_s (Ki_pos e + K_aw (w_ref - w_raw))
    u      = clip(Kp_vel (w_ref - w_measured) + u_fc, +-u_max)
    u_fc   = g_fc C_m(fin_measured, sgn w_ref)/(K_t K_v) clip(w_ref/w_band, +-1)
"""

from __future__ import annotations

from typing import Any, NamedTuple

from ..ops.base import Ops, Value
from ..physics import friction, kinematics
from .sensors import Measurement


class Output(NamedTuple):
    """A sample's result: DAC value [V], speed references before and after the limit [rad/s], limits hit."""

    reference: Value
    speed_raw: Value
    speed_reference: Value
    error: Value
    limited: Value


def clipped_command(ops: Ops, p: Any, command: Value) -> Value:
    """Return a fin command [rad] within +-command.limit."""
    return ops.clip(command, -p.command.limit, p.command.limit)


def friction_compensation(ops: Ops, p: Any, fin_measured: Value, speed_reference: Value) -> Value:
    """Return reference [V] that cancels Coulomb friction in the direction asked for.

    The controller knows the friction identified at 24 degC, not the temperature.
    """
    polynomials = p.friction.coulomb
    (estimate,) = ops.branch(
        speed_reference > 0.0,
        lambda: (friction.coulomb_reference(ops, polynomials.positive, fin_measured),),
        lambda: (friction.coulomb_reference(ops, polynomials.negative, fin_measured),),
    )
    per_volt = p.motor.torque_constant * p.drive.current_gain
    share = ops.clip(speed_reference / p.compensation.speed_band, -1.0, 1.0)
    return p.compensation.gain / per_volt * estimate * share


def output(ops: Ops, p: Any, integral: Value, measured: Measurement, command: Value) -> Output:
    """Return the controllers' outputs at a sample; `integral` I [rad/s], `command` [rad] before its limit."""
    target = kinematics.motor_angle(ops, p, clipped_command(ops, p, command))
    error = target - measured.motor_angle
    position, limit = p.controller.position, p.controller.speed_limit
    speed_raw = position.kp * error + integral
    speed_reference = ops.clip(speed_raw, -limit, limit)
    compensation = friction_compensation(ops, p, measured.fin_angle, speed_reference)
    raw = p.controller.velocity.kp * (speed_reference - measured.motor_speed) + compensation
    u_max = p.drive.reference_limit
    limited = ops.either(ops.either(ops.fabs(command) > p.command.limit, ops.fabs(speed_raw) > limit),
                         ops.fabs(raw) > u_max)
    return Output(ops.clip(raw, -u_max, u_max), speed_raw, speed_reference, error, limited)


def update(ops: Ops, p: Any, integral: Value, out: Output) -> Value:
    """Return the integral [rad/s] after a sample, back-calculated where the speed reference was clipped."""
    antiwindup = p.controller.antiwindup * (out.speed_reference - out.speed_raw)
    return integral + p.controller.sample_time * (p.controller.position.ki * out.error + antiwindup)
