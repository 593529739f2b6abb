"""One step of equations that are smooth between events: stick and slip, locking, valves that open, limits, stops.

For actuators that have such events and no closed forms for them. A mode says which of the equations hold: numbers by
name, chosen where the step starts and held through it, with whatever else is frozen for the step (a lever's ratio at
its middle). The states then take a step of ROS2 (:mod:`emcas_fmu.steppers.smooth`), L-stable and of second order. A
mode has margins, each above 0 while it holds. The step ends where the first of them is lost, by a secant and another
that corrects it; there `landed` puts what is known to the bit, such as the speed 0 of what comes to rest, and the
caller steps on with the mode of that state.

A margin that is 0 where the step starts, as that of a body at rest which now slides, is no event in it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import reduce
from typing import Any, NamedTuple

from ..namespace import Record
from ..ops.base import Ops, Value
from .smooth import ros2

# The least share of a step that is taken, so that every call moves on.
PROGRESS = 1e-6
# Of a margin at the step's start, what is left of it where its zero is still far; and the share of a step that is then
# taken at least.
_FAR, _FURTHER = 0.5, 1.0 / 16.0
Values = Mapping[str, Value]


@dataclass(frozen=True)
class Switched:
    """Equations with events, of states by name.

    mode(ops, p, x, u, h)               what holds through a step of `h` [s] that starts at `x`
    derivatives(ops, p, x, u, mode)     d/dt of the states; those left out stay as they are
    margins(ops, p, x, u, mode)         by name, above 0 while the mode holds
    landed(ops, p, begin, x, u, mode, events)  states that differ from `x`, where a step from `begin` ends: `events`
                                        says by name which margin was lost there, none without an event
    """

    mode: Callable[[Ops, Any, Record, Record, Value], Record]
    derivatives: Callable[[Ops, Any, Record, Record, Record], Values]
    margins: Callable[[Ops, Any, Record, Record, Record], Values]
    landed: Callable[[Ops, Any, Record, Record, Record, Record, Values], Values]


def advance(ops: Ops, p: Any, system: Switched, x: Record, u: Record, h: Value) -> tuple[Record, Value]:
    """Return the states after `h` [s] or at the first event before, and the time that took [s]."""
    mode = system.mode(ops, p, x, u, h)
    names = tuple(system.derivatives(ops, p, x, u, mode))

    def moved(time: Value) -> Record:
        def slope(y: list[Value]) -> list[Value]:
            given = system.derivatives(ops, p, x.replace(**dict(zip(names, y, strict=True))), u, mode)
            return [given[name] for name in names]

        return x.replace(**dict(zip(names, ros2(ops, slope, [getattr(x, name) for name in names], time), strict=True)))

    def margins(at: Record) -> Values:
        return system.margins(ops, p, at, u, mode)

    def landed(at: Record, events: Values) -> tuple[Value, ...]:
        put = system.landed(ops, p, x, at, u, mode, events)
        return tuple({**vars(at), **put}.values())

    whole = moved(h)
    before, after = margins(x), margins(whole)
    lost = {name: ops.both(after[name] <= 0.0, y > 0.0) for name, y in before.items()}

    def to_event() -> tuple[Value, ...]:
        first = first_lost(ops, h, tuple(before.values()), tuple(after.values()), tuple(lost.values()))
        least = PROGRESS * h
        guess = ops.maximum(first.time, least)
        better, left = corrected(ops, h, first, guess, tuple(margins(moved(guess)).values()))
        used = ops.clip(better, least, h)
        # A margin that first grows, or hardly falls, is zero nowhere near: the step looks further, without an event.
        far = left > _FAR * first.begin
        used = ops.where(far, ops.maximum(used, _FURTHER * h), used)
        events = {name: ops.both(ops.equal(first.place, float(i)), ops.negate(far)) for i, name in enumerate(before)}
        return *landed(moved(used), events), used

    *states, used = ops.branch(reduce(ops.either, lost.values()), to_event,
                               lambda: (*landed(whole, dict.fromkeys(before, False)), h), rare=True)
    return Record(**dict(zip(vars(x), states, strict=True))), used


class First(NamedTuple):
    """The margin that is lost first: when, by the line between its ends [s], its place among them (-1: none), and what
    it is at the step's begin and end."""

    time: Value
    place: Value
    begin: Value
    end: Value


def first_lost(ops: Ops, h: Value, before: Sequence[Value], after: Sequence[Value], lost: Sequence[Value]) -> First:
    """Return which of the margins that are `lost` in a step of `h` [s] is so first."""
    first = First(h, -1.0, 1.0, 1.0)
    for i, (y, z, gone) in enumerate(zip(before, after, lost, strict=True)):
        time = ops.clip(zero_between(ops, 0.0, y, h, z), 0.0, h)
        earlier = ops.both(gone, ops.either(time < first.time, first.place < 0.0))
        found = First(time, float(i), y, z)
        first = First(*(ops.where(earlier, new, old) for new, old in zip(found, first, strict=True)))
    return first


def corrected(ops: Ops, h: Value, first: First, guess: Value, margins: Sequence[Value]) -> tuple[Value, Value]:
    """Return a better time [s] of the event than a `guess`, from the `margins` there, and the event's own there."""
    left: Value = 0.0
    for i, margin in enumerate(margins):
        left = ops.where(ops.equal(first.place, float(i)), margin, left)
    late = left <= 0.0
    return zero_between(ops, guess, left, ops.where(late, 0.0, h), ops.where(late, first.begin, first.end)), left


def zero_between(ops: Ops, x: Value, y: Value, other_x: Value, other_y: Value) -> Value:
    """Return where the line through two points is zero."""
    change = ops.where(ops.equal(y, other_y), 1.0, y - other_y)
    return x - y * (x - other_x) / change
