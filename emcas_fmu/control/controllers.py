"""Sampled controllers, section 4.2: PI position loop with anti-windup around a P or PI velocity loop.

    r      = theta(clip(command))       e = r - theta_measured
    w_raw  = Kp_pos (b r - theta_measured) + I + v_ff (r - s)/T_c             w_ref = clip(w_raw, +-w_max)
    u_raw  = Kp_vel (w_ref - w_measured) + V + u_fc + u_ff - T_l/(K_t K_v)    u = clip(u_raw, +-u_max)
    u_fc   = g_fc C_m(fin_measured, sgn w_ref)/(K_t K_v) clip(w_ref/w_band, +-1)
    I+     = I + T_s (Ki_pos e + K_aw (clip(w) - w) + K_d (u_drive - u_raw)/Kp_vel)    w = w_raw without v_ff's share
    V+     = V + T_s (Ki_vel (w_ref - w_measured) + min(K_d, Ki_vel/Kp_vel) (u_drive - u_raw))
    s+     = s + T_s/T_c (r - s)

With the setpoint weight b the position loop has two degrees of freedom (Astrom & Hagglund, "Advanced PID Control",
section 3.4): the response to a load does not depend on b. The command's rate is (r - s)/T_c, with the command's update
time T_c (T_s if a command arrives at every sample) and the lagged target s. Between updates this rate decays; without
the lag it would be a pulse of one sample. At rest I is Kp_pos (1 - b) theta_measured and s is r; I and s also have
these values at the start and while the drive is disabled. u_drive is u_raw within the limits of DAC and current.
Anti-windup changes I only if Ki_pos > 0, and V no faster than its integral time (ibid., section 3.5), hence not at all
if Ki_vel = 0: without integral action, the change would remain as an offset after every saturation. The controllers use
the nominal parameters of mechanism and motor.

T_l is the load at the motor without the friction that is fed forward. A first-order observer of the momentum m, with
the bandwidth L, estimates it (De Luca & Mattone, "Sensorless robot collision detection and hybrid force/motion
control", ICRA 2005):

    T_l    = L (J w_measured - m)               m+ = m + T_s (K_t i + T_l - K_t K_v u_fc)

u_ff is the feed-forward of a motion (:func:`feed_forward`), 0 without a motion. With a motion, u_fc is computed from
its speed plus the feedback's share of w_raw, instead of from w_ref. The observer uses the measured current. If its
model is exact, T_l is therefore independent of the controllers' reference, and the loop's margins hardly change.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from ..ops.base import Ops, Value
from ..physics import drive, friction, kinematics, mechanics
from . import command_bus
from .sensors import Measurement
from .trajectory import Ahead, Motion, added


class Loops(NamedTuple):
    """States of the loops: integrals of position [rad/s] and velocity [V], lagged target s [rad], and the observer's
    momentum m [N.m.s]."""

    integral: Value
    velocity_integral: Value
    target: Value
    momentum: Value


class SampleResult(NamedTuple):
    """Result of a sample: DAC value [V], speed reference before its limit [rad/s], a flag that a limit of command,
    speed or DAC acts, and the loops' states after the sample."""

    reference: Value
    speed_raw: Value
    limited: Value
    loops: Loops


def clipped_command(ops: Ops, p: Any, command: Value) -> Value:
    """Return a fin command [rad], limited to +-command.limit."""
    return ops.clip(command, -p.command.limit, p.command.limit)


def friction_compensation(ops: Ops, p: Any, fin_measured: Value, speed_reference: Value) -> Value:
    """Return the reference [V] that cancels Coulomb friction in the direction of the speed reference [rad/s].

    The friction is that at 24 degC: the controllers do not know the temperature.
    """
    return fed_forward(ops, p, friction.coulomb_reference(ops, p, speed_reference, fin_measured), speed_reference)


def fed_forward(ops: Ops, p: Any, dry: Value, speed_reference: Value) -> Value:
    """Return the reference [V] against a friction `dry` [N.m] at the motor, times compensation.gain and
    clip(speed reference [rad/s]/compensation.speed_band, +-1)."""
    per_volt = drive.stall_torque(p, 1.0)
    share = ops.clip(speed_reference / p.compensation.speed_band, -1.0, 1.0)
    return p.compensation.gain / per_volt * dry * share


def _momentum(ops: Ops, p: Any, measured: Measurement) -> Value:
    """Return the measured momentum J w [N.m.s] at the motor."""
    return mechanics.coefficients(ops, p, measured.motor_angle).inertia * measured.motor_speed


def resting_integral(p: Any, target: Value) -> Value:
    """Return the position loop's integral [rad/s] at rest at a target [rad]; for a piston [m/s] and [m]."""
    position = p.controller.position
    return position.kp * (1.0 - position.setpoint_weight) * target


def target_angle(ops: Ops, p: Any, command: Value) -> Value:
    """Return the target [rad] of the motor angle for a fin command [rad], which is limited first."""
    return kinematics.motor_angle(ops, p, clipped_command(ops, p, command))


def at_rest(ops: Ops, p: Any, measured: Measurement, command: Value) -> Loops:
    """Return the loops' states at rest at the measured position, without load, for a fin `command` [rad]."""
    (momentum,) = ops.branch(p.controller.load_observer > 0.0, lambda: (_momentum(ops, p, measured),), lambda: (0.0,))
    return Loops(resting_integral(p, measured.motor_angle), 0.0, target_angle(ops, p, command), momentum)


def _observed(ops: Ops, p: Any, momentum: Value, measured: Measurement, current: Value, compensation: Value
              ) -> tuple[Value, ...]:
    """Return the reference [V] that cancels the load, and the observer's momentum [N.m.s] after the sample."""
    load = p.controller.load_observer * (_momentum(ops, p, measured) - momentum)
    per_volt = drive.stall_torque(p, 1.0)
    net = drive.torque(p, current) + load - per_volt * compensation
    return -load / per_volt, momentum + p.controller.sample_time * net


def feed_forward(ops: Ops, p: Any, motion: Motion, integral: Value) -> tuple[Ahead, Value, Value]:
    """Return the feed-forward of a fin motion, from the inverse of plant and current loop without Coulomb friction.

    `integral` [V] is the integral of the drive's current loop that the motion requires at this sample. The second
    result is this integral at the next sample. The third is the time [s] until a reference acts: the drive's delay plus
    the lag of its current.
    """
    now, after = (mechanics.coefficients(ops, p, kinematics.motor_angle(ops, p, angle))
                  for angle in (motion.angle, motion.next_angle))
    speed, next_speed = motion.rate * now.ratio, motion.next_rate * after.ratio
    mean = 0.5 * (speed + next_speed)
    torque = (0.5 * (now.inertia + after.inertia) * (next_speed - speed) / p.controller.sample_time
              + mechanics.damping(ops, p, now, mean) * mean - now.centrifugal * mean * mean)
    reference, integral = drive.inverse(p, torque / p.motor.torque_constant, mean, integral)
    return Ahead(mean, reference), integral, p.drive.transport_delay + drive.lag(p)


def sample(ops: Ops, p: Any, loops: Loops, measured: Measurement, current: Value, command: Value,
           ahead: Ahead | None = None) -> SampleResult:
    """Return the result of a sample for a measured motor `current` [A], an unlimited fin `command` [rad] and, if any,
    the feed-forward `ahead` of a motion."""
    position, velocity, limit, period = (p.controller.position, p.controller.velocity, p.controller.speed_limit,
                                         p.controller.sample_time)
    target = target_angle(ops, p, command)
    error = target - measured.motor_angle
    fed_back = position.kp * (error - (1.0 - position.setpoint_weight) * target) + loops.integral
    update_time, change = command_bus.interval(ops, p), target - loops.target
    speed_raw = fed_back + position.velocity_feedforward * change / update_time
    lagged = ops.where(update_time > period, loops.target + period / update_time * change, target)
    speed_reference = ops.clip(speed_raw, -limit, limit)
    intended = speed_reference if ahead is None else ops.where(ahead.active, fed_back + ahead.speed, speed_reference)
    compensation = friction_compensation(ops, p, measured.fin_angle, intended)
    speed_error = speed_reference - measured.motor_speed
    against_load, momentum = ops.branch(
        p.controller.load_observer > 0.0,
        lambda: _observed(ops, p, loops.momentum, measured, current, compensation), lambda: (0.0, loops.momentum))
    raw = velocity.kp * speed_error + loops.velocity_integral + compensation + against_load
    raw = added(ops, raw, ahead, "reference")
    u_max = p.drive.reference_limit
    limited = ops.either(ops.either(ops.fabs(command) > p.command.limit, ops.fabs(speed_raw) > limit),
                         ops.fabs(raw) > u_max)
    reference = ops.clip(raw, -u_max, u_max)
    beyond = drive.followed(ops, p, reference) - raw  # 0 while the drive follows
    proportional = ops.where(velocity.kp > 0.0, velocity.kp, 1.0)
    unwinding = (p.controller.antiwindup * (ops.clip(fed_back, -limit, limit) - fed_back)
                 + p.controller.drive_antiwindup / proportional * beyond)
    integral = loops.integral + ops.where(position.ki > 0.0, period * (position.ki * error + unwinding), 0.0)
    tracking = ops.minimum(p.controller.drive_antiwindup, velocity.ki / proportional)
    velocity_integral = loops.velocity_integral + period * (velocity.ki * speed_error + tracking * beyond)
    return SampleResult(reference, speed_raw, limited, Loops(integral, velocity_integral, lagged, momentum))
