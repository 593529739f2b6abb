"""Position loop of a cylinder: PI control of the piston's position, which follows from the measured fin angle.

    r    = x(clip(command))        y = x(fin_measured)        e = r - y
    v_raw = Kp (b r - y) + I + v_f  v_ref = clip(v_raw, +-v_max)
    I+   = I + T_s Ki e            or, while |v_raw| > v_max and e increases |v_raw|, I + Kp (1 - b) (y - y_before)

x(angle) is the piston's position at a fin angle (:mod:`emcas_fmu.physics.cylinder`). The loop controls x, so its gain
does not depend on the angle. At rest I is Kp (1 - b) y. While the speed is limited, I - Kp (1 - b) y is constant. A
large step then ends without the tail that a weight b below 1 would cause; anti-windup by back-calculation would cause a
tail with its time constant. v_f is the speed of the feed-forward of a motion.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from ..ops.base import Ops, Value
from ..physics import cylinder, loads
from .controllers import clipped_command, resting_integral
from .trajectory import Ahead, Motion, added


class SampleResult(NamedTuple):
    """Result of a sample: reference of the piston's speed [m/s]; `limited`, 1 if a limit of speed or command is active,
    else 0; the integral [m/s] after the sample; `held`, the integral after a sample in which the loop does not
    integrate."""

    speed: Value
    limited: Value
    integral: Value
    held: Value


def measured(ops: Ops, p: Any, fin_angle: Value) -> Value:
    """Return the reading [rad] of the transducer at a fin angle [rad]."""
    step = p.transducer.resolution
    divisor = ops.where(step > 0.0, step, 1.0)
    return ops.where(step > 0.0, divisor * ops.floor(fin_angle / divisor + 0.5), fin_angle)


def at_rest(ops: Ops, p: Any, fin_measured: Value) -> Value:
    """Return the integral [m/s] at rest at a measured fin angle [rad]."""
    return resting_integral(p, cylinder.piston_position(ops, p, fin_measured))


def piston_motion(ops: Ops, p: Any, motion: Motion) -> tuple[Value, Value]:
    """Return the piston's mean speed [m/s] and acceleration [m/s2] from this to the next sample of a fin motion."""
    speed, next_speed = (cylinder.linkage(ops, p, angle, loads.NONE).ratio * rate
                    for angle, rate in ((motion.angle, motion.rate), (motion.next_angle, motion.next_rate)))
    return 0.5 * (speed + next_speed), (next_speed - speed) / p.controller.sample_time


def sample(ops: Ops, p: Any, integral: Value, before: Value, fin_measured: Value, command: Value, limit: Value,
           ahead: Ahead | None = None) -> SampleResult:
    """Return the result of a sample for an unlimited fin `command` [rad]; +-`limit` [m/s] limits the speed reference.

    `before` is the piston's position [m] at the last sample; `ahead` contains the speed [m/s] of the feed-forward.
    """
    position = p.controller.position
    target = cylinder.piston_position(ops, p, clipped_command(ops, p, command))
    piston = cylinder.piston_position(ops, p, fin_measured)
    error = target - piston
    raw = position.kp * (error - (1.0 - position.setpoint_weight) * target) + integral
    raw = added(ops, raw, ahead, "speed")
    beyond = ops.fabs(raw) > limit
    followed = resting_integral(p, piston - before)
    moved = integral + ops.where(ops.both(beyond, raw * error > 0.0), followed,
                                 p.controller.sample_time * position.ki * error)
    limited = ops.either(beyond, ops.fabs(command) > p.command.limit)
    return SampleResult(ops.clip(raw, -limit, limit), ops.where(limited, 1.0, 0.0), moved, integral + followed)
