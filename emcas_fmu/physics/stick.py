"""Set-valued dry friction: a body at rest keeps its position, bit for bit, while friction holds it.

The equations apply where the other forces on a body depend on states and not on accelerations, so that each body sticks
or slides independently of the others (:mod:`emcas_fmu.steppers.events`).
"""

from __future__ import annotations

from typing import NamedTuple

from ..ops.base import Ops, Value

WALL = 1e30  # N or N.m, friction that represents a mechanical stop: nothing overcomes it
EDGE = 1.0 - 1e-9  # share of its limit at which friction is overcome: a rounding error cannot hold a body


class Slide(NamedTuple):
    """Direction of a body's motion (-1, 0 at rest, 1), and the torques [N.m] that start it forwards and backwards."""

    direction: Value
    high: Value
    low: Value


def overcome(ops: Ops, torque: Value, high: Value, low: Value) -> tuple[Value, Value]:
    """Return whether a torque [N.m] starts a body at rest forwards (from `high` on) and backwards (from `low` on)."""
    # A torque of 0 starts no body, not even one without friction.
    up = ops.both(torque >= high * EDGE, torque > 0.0)
    return up, ops.both(torque <= low * EDGE, torque < 0.0)


def start(ops: Ops, torque: Value, high: Value, low: Value) -> Value:
    """Return the direction (-1, 1) in which a torque starts a body at rest, 0 between `low` and `high` [N.m]."""
    up, down = overcome(ops, torque, high, low)
    return ops.where(up, 1.0, ops.where(down, -1.0, 0.0))


def holding(ops: Ops, dry: Value, position: Value, stop: Value) -> tuple[Value, Value]:
    """Return the torques [N.m] that start a body at rest at a position [rad] forwards and backwards, under dry friction
    `dry` [N.m] and between stops at +-`stop` [rad]."""
    return ops.where(position >= stop, WALL, dry), -ops.where(position <= -stop, WALL, dry)


def slide(ops: Ops, speed: Value, torque: Value, dry: Value, position: Value, stop: Value) -> Slide:
    """Return the motion of a body with a `speed` [rad/s] under a `torque` [N.m] and a dry friction `dry` [N.m].

    A body at rest at or beyond its stop, at +-`stop` [rad], starts inwards only.
    """
    high, low = holding(ops, dry, position, stop)
    starts = start(ops, torque, high, low)
    return Slide(ops.where(speed > 0.0, 1.0, ops.where(speed < 0.0, -1.0, starts)), high, low)


def moves(ops: Ops, s: Slide, value: Value) -> Value:
    """Return `value` for a body that moves, 0 for one at rest."""
    return ops.where(ops.equal(s.direction, 0.0), 0.0, value)


def reserve(ops: Ops, s: Slide, torque: Value) -> Value:
    """Return the smallest change of a torque [N.m] that starts a body at rest; it is negative beyond the friction."""
    return ops.minimum(s.high - torque, torque - s.low)


def margin(ops: Ops, s: Slide, speed: Value, torque: Value) -> Value:
    """Return the event margin of the direction: the speed [rad/s] or, for a body at rest, :func:`reserve` [N.m]."""
    return ops.where(ops.equal(s.direction, 0.0), reserve(ops, s, torque), s.direction * speed)


def stop_margin(ops: Ops, s: Slide, position: Value, stop: Value) -> Value:
    """Return the distance [rad] to the stop ahead, 1 for a body at rest."""
    return ops.where(ops.equal(s.direction, 0.0), 1.0, stop - s.direction * position)


def nowhere(ops: Ops, s: Slide, begin: Value, end: Value) -> Value:
    """Return whether a body at rest at the start of a step ends it at rest, or in motion against its direction `s`;
    `begin` and `end` are its speeds [rad/s]."""
    return ops.both(ops.equal(begin, 0.0), end * s.direction <= 0.0)


def speed_after(ops: Ops, s: Slide, begin: Value, end: Value, halted: Value) -> Value:
    """Return the speed [rad/s] at the end of a step: 0 if the body has `halted`, or would move against its start."""
    return ops.where(ops.either(halted, nowhere(ops, s, begin, end)), 0.0, end)


def landed(ops: Ops, s: Slide, stop: Value, begin: tuple[Value, Value], end: tuple[Value, Value], halted: Value,
           struck: Value) -> tuple[Value, Value]:
    """Return position [rad] and speed [rad/s] of a body between stops at +-`stop` after a step.

    `begin` and `end` are position and speed before and after the step. `halted` is true if the body came to rest in the
    step, `struck` if it reached the stop ahead. A body may be at the stop or beyond without `struck`, if rounding puts
    another event first, or if the body leaves the stop and turns back within the step.
    """
    (from_position, from_speed), (position, speed) = begin, end
    moving = ops.negate(ops.equal(s.direction, 0.0))
    met = ops.either(struck, ops.both(moving, s.direction * position >= stop))
    inside = ops.where(met, s.direction * stop, ops.clip(position, -stop, stop))
    return (ops.where(nowhere(ops, s, from_speed, speed), from_position, inside),
            speed_after(ops, s, from_speed, speed, ops.either(met, ops.both(moving, halted))))
