"""Position loop of a cylinder: PI, on the piston that the transducer of the fin angle stands for.

    r    = x(clip(command))        y = x(fin_measured)        e = r - y
    v_raw = Kp (b r - y) + I        v_ref = clip(v_raw, +-v_max)
    I+   = I + T_s Ki e            or, while the limit is met and e drives it further, I + Kp (1 - b) (y - y_before)

x is the lever's (:mod:`emcas_fmu.physics.cylinder`): the loop's gain is then the same at every angle. The integral of a
loop at rest is Kp (1 - b) y. At limits what is held is I less this share, so that large steps, too, end without the
tail that a weight below 1 would leave; back-calculation would leave one of its time constant.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from ..ops.base import Ops, Value
from ..physics import cylinder
from .controllers import clipped_command, resting_integral


class Output(NamedTuple):
    """Reference of the piston's speed [m/s], whether a limit was met, the integral [m/s] for the next sample, and what
    it is where it is held."""

    speed: Value
    limited: Value
    integral: Value
    held: Value


def measured(ops: Ops, p: Any, fin_angle: Value) -> Value:
    """Return a fin angle [rad] as its transducer reads it."""
    step = p.transducer.resolution
    unit = ops.where(step > 0.0, step, 1.0)
    return ops.where(step > 0.0, unit * ops.floor(fin_angle / unit + 0.5), fin_angle)


def at_rest(ops: Ops, p: Any, fin_measured: Value) -> Value:
    """Return the integral [m/s] that asks for no speed at a measured fin angle [rad]."""
    return resting_integral(p, cylinder.piston_position(ops, p, fin_measured))


def sample(ops: Ops, p: Any, integral: Value, before: Value, fin_measured: Value, command: Value, limit: Value
           ) -> Output:
    """Return a sample of the loop within a speed of the piston [m/s]; `command` [rad] before its limit.

    `before` is where the piston was read at the last sample [m].
    """
    position = p.controller.position
    target = cylinder.piston_position(ops, p, clipped_command(ops, p, command))
    piston = cylinder.piston_position(ops, p, fin_measured)
    error = target - piston
    raw = position.kp * (error - (1.0 - position.setpoint_weight) * target) + integral
    beyond = ops.fabs(raw) > limit
    followed = resting_integral(p, piston - before)
    moved = integral + ops.where(ops.both(beyond, raw * error > 0.0), followed,
                                 p.controller.sample_time * position.ki * error)
    limited = ops.either(beyond, ops.fabs(command) > p.command.limit)
    return Output(ops.clip(raw, -limit, limit), ops.where(limited, 1.0, 0.0), moved, integral + followed)
