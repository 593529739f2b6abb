"""Dry friction that is set-valued: what rests stays there to the bit while it holds, what slides feels all of it.

For bodies whose forces follow from states, so that each decides by itself (:mod:`emcas_fmu.steppers.events`).
"""

from __future__ import annotations

from typing import NamedTuple

from ..ops.base import Ops, Value

WALL = 1e30  # N or N.m, a mechanical stop seen as friction that nothing overcomes
# Friction counts as overcome this close to its limit, so that a step that ended at breakaway does not rest again by a
# rounding error.
EDGE = 1.0 - 1e-9


class Slide(NamedTuple):
    """Direction of a body's motion (-1, 0 at rest, 1), and the torques that it takes to move it up and down."""

    direction: Value
    high: Value
    low: Value


def overcome(ops: Ops, torque: Value, high: Value, low: Value) -> tuple[Value, Value]:
    """Return whether a torque moves a body at rest up, beyond `high`, and whether it moves it down, beyond `low`."""
    # Strictly beyond: without friction and torque a body at rest stays at rest.
    up = ops.both(torque >= high * EDGE, torque > 0.0)
    return up, ops.both(torque <= low * EDGE, torque < 0.0)


def slide(ops: Ops, speed: Value, torque: Value, dry: Value, place: Value, stop: Value) -> Slide:
    """Return how a body moves that has a `speed`, under a `torque` besides a dry friction of `dry`.

    At rest at a `place` beyond +-`stop` it moves inwards only.
    """
    high = ops.where(place >= stop, WALL, dry)
    low = -ops.where(place <= -stop, WALL, dry)
    up, down = overcome(ops, torque, high, low)
    starts = ops.where(up, 1.0, ops.where(down, -1.0, 0.0))
    return Slide(ops.where(speed > 0.0, 1.0, ops.where(speed < 0.0, -1.0, starts)), high, low)


def moves(ops: Ops, s: Slide, value: Value) -> Value:
    """Return a value of a body that moves, 0 of one at rest."""
    return ops.where(ops.equal(s.direction, 0.0), 0.0, value)


def margin(ops: Ops, s: Slide, speed: Value, torque: Value) -> Value:
    """Return what is above 0 while the body goes on as it does: its speed, or at rest the friction that is left."""
    rest = ops.minimum(s.high - torque, torque - s.low)
    return ops.where(ops.equal(s.direction, 0.0), rest, s.direction * speed)


def stop_margin(ops: Ops, s: Slide, place: Value, stop: Value) -> Value:
    """Return the way to the stop ahead, 1 of a body at rest."""
    return ops.where(ops.equal(s.direction, 0.0), 1.0, stop - s.direction * place)


def nowhere(ops: Ops, s: Slide, begin: Value, end: Value) -> Value:
    """Return whether a body that starts from rest, of a speed of 0 at the `begin` of a step, leads nowhere."""
    return ops.both(ops.equal(begin, 0.0), end * s.direction <= 0.0)


def speed_after(ops: Ops, s: Slide, begin: Value, end: Value, halted: Value) -> Value:
    """Return the speed at the end of a step: 0 where it was `halted`, or where a start from rest leads nowhere."""
    return ops.where(ops.either(halted, nowhere(ops, s, begin, end)), 0.0, end)


def landed(ops: Ops, s: Slide, stop: Value, begin: tuple[Value, Value], end: tuple[Value, Value], halted: Value,
           struck: Value) -> tuple[Value, Value]:
    """Return place and speed of a body between stops at +-`stop`, from those where a step began and ended.

    Its speed was lost in the step (`halted`) or it was `struck` by the stop ahead. Another event may be placed a
    rounding behind that of the stop; and a body that leaves it and turns back within a step gets as far beyond.
    """
    (from_place, from_speed), (place, speed) = begin, end
    moving = ops.negate(ops.equal(s.direction, 0.0))
    met = ops.either(struck, ops.both(moving, s.direction * place >= stop))
    inside = ops.where(met, s.direction * stop, ops.clip(place, -stop, stop))
    return (ops.where(nowhere(ops, s, from_speed, speed), from_place, inside),
            speed_after(ops, s, from_speed, speed, ops.either(met, ops.both(moving, halted))))
