"""One step of equations that are smooth between events: stick and slip, locking, valves that open, limits, stops.

It serves actuators whose event times have no closed form. A mode defines which equations apply. It is a set of named
values, computed at the start of the step and constant in it, such as the lever's ratio predicted for mid-step. ROS2
(:mod:`emcas_fmu.steppers.smooth`), L-stable and of second order, integrates the states. Each event margin of a mode is
above 0 while the mode holds. The step ends where the first margin is lost, that is, falls to 0; a secant and a
correction locate this time. If the zero is far off, the step ends before it, without an event. At an event `landed`
sets values that are known exactly, such as the speed 0 of a body that comes to rest, and the caller continues with the
mode of that state.

A margin that is 0 at the start of a step, such as the speed of a body that starts, causes no event in the step.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import reduce
from types import MappingProxyType
from typing import Any, NamedTuple

from ..namespace import Record
from ..ops.base import Ops, Value
from .smooth import ros2

# No event is located earlier than this share of the step, so that every call advances.
PROGRESS = 1e-6
# The zero of a margin is far away if more than _FAR of the starting value remains at its first estimate; the step then
# advances by at least _FURTHER of `h`.
_FAR, _FURTHER = 0.5, 1.0 / 16.0
Values = Mapping[str, Value]


@dataclass(frozen=True)
class Switched:
    """Equations with events; states, event margins and events are mappings by name.

    mode(ops, p, x, u, h)               the mode of a step of `h` [s] that starts at `x`
    derivatives(ops, p, x, u, mode)     d/dt of the states; states without a derivative are constant
    margins(ops, p, x, u, mode)         event margins, above 0 while the mode holds
    landed(ops, p, begin, x, u, mode, events)  corrected values of states at `x`, the end of a step from `begin`;
                                        `events` is true for the margin that was lost there
    check(ops, p, x, u)                 raises EmcasError for values or equations that do not fit the events; called in
                                        the first simulation of a user's actuator
    begun(ops, p, x, u, h)              states at the start, some switched by inputs, and a step [s] of at most `h`
    least                               by margin, the earliest time of its event, as a share of the step; else PROGRESS
    """

    mode: Callable[[Ops, Any, Record, Any, Value], Record]
    derivatives: Callable[[Ops, Any, Record, Any, Record], Values]
    margins: Callable[[Ops, Any, Record, Any, Record], Values]
    landed: Callable[[Ops, Any, Record, Record, Any, Record, Values], Values]
    begun: Callable[[Ops, Any, Record, Any, Value], tuple[Record, Value]] = lambda ops, p, x, u, h: (x, h)
    check: Callable[[Ops, Any, Record, Any], None] = lambda ops, p, x, u: None
    least: Values = field(default_factory=dict)

    def step(self, as_built: Callable[[Ops, Any], Any]) -> SwitchedStep:
        """Return the step function of the system; `as_built(ops, p)` returns the parameters of the plant."""
        return SwitchedStep(self, as_built)


@dataclass(frozen=True)
class SwitchedStep:
    """The function `step(ops, p, x, u, h)` of a system; `as_built(ops, p)` returns the parameters of the plant."""

    system: Switched
    as_built: Callable[[Ops, Any], Any]

    def __call__(self, ops: Ops, p: Any, x: Record, u: Record, h: Value) -> tuple[Values, Value]:
        moved, used = advance(ops, self.as_built(ops, p), self.system, x, u, h)
        return vars(moved), used

    def margins(self, ops: Ops, p: Any, x: Record, u: Record, h: Value) -> Values:
        """Return the event margins by name at the start of a step."""
        q = self.as_built(ops, p)
        x, h = self.system.begun(ops, q, x, u, h)
        return self.system.margins(ops, q, x, u, self.system.mode(ops, q, x, u, h))


def advance(ops: Ops, p: Any, system: Switched, x: Record, u: Record, h: Value) -> tuple[Record, Value]:
    """Return the states after at most `h` [s], at the first event if there is one, and the time that has passed [s]."""
    x, h = system.begun(ops, p, x, u, h)
    mode = system.mode(ops, p, x, u, h)
    names = tuple(system.derivatives(ops, p, x, u, mode))

    def moved(time: Value) -> Record:
        def slope(y: list[Value]) -> list[Value]:
            rates = system.derivatives(ops, p, x.replace(**dict(zip(names, y, strict=True))), u, mode)
            return [rates[name] for name in names]

        return x.replace(**dict(zip(names, ros2(ops, slope, [getattr(x, name) for name in names], time), strict=True)))

    def margins(at: Record) -> Values:
        return system.margins(ops, p, at, u, mode)

    def landed(at: Record, events: Values) -> tuple[Value, ...]:
        corrected = system.landed(ops, p, x, at, u, mode, events)
        return tuple({**vars(at), **corrected}.values())

    whole = moved(h)
    start, after = margins(x), margins(whole)
    before = {name: y for name, y in start.items() if after[name] is not y}  # a constant margin has no event
    lost = {name: ops.both(after[name] <= 0.0, y > 0.0) for name, y in before.items()}

    def to_event() -> tuple[Value, ...]:
        first = first_event(ops, h, before, after, lost, lambda time: margins(moved(time)), system.least)
        # The zero of a margin that first grows, or hardly falls, is far away: the step ends before, without an event.
        far = first.margin > _FAR * first.begin
        used = ops.where(far, ops.maximum(first.time, _FURTHER * h), first.time)
        events = {name: ops.both(happens, ops.negate(far)) for name, happens in first.happens.items()}
        return *landed(moved(used), dict.fromkeys(start, False) | events), used

    *states, used = ops.branch(reduce(ops.either, lost.values(), False), to_event,
                               lambda: (*landed(whole, dict.fromkeys(start, False)), h), rare=True)
    return Record(**dict(zip(vars(x), states, strict=True))), used


class FirstEvent(NamedTuple):
    """The first event in a step: its time [s]; for each margin, whether its loss is the event; and the lost margin's
    value at the start of the step (`begin`) and at the first estimate of the time (`margin`)."""

    time: Value
    happens: Values
    begin: Value
    margin: Value


def first_event(ops: Ops, h: Value, before: Values, after: Values, lost: Values, at: Callable[[Value], Values],
                least: Values = MappingProxyType({})) -> FirstEvent:
    """Return the first event of a step of `h` [s], in which the margins change from `before` to `after`.

    `lost` is true for the margins that are lost in the step; `at` returns the margins at a time [s]. The event's time
    is at least the share of the step that `least` has for the margin, or PROGRESS.
    """
    time, index, begin, end = h, -1.0, 1.0, 1.0
    for i, name in enumerate(before):
        new_time = ops.clip(zero_between(ops, 0.0, before[name], h, after[name]), 0.0, h)
        earlier = ops.both(lost[name], ops.either(new_time < time, index < 0.0))
        time, index, begin, end = (ops.where(earlier, new, old) for new, old in zip(
            (new_time, float(i), before[name], after[name]), (time, index, begin, end), strict=True))
    shortest = PROGRESS * h
    for i, name in enumerate(before):
        if name in least:
            shortest = ops.where(ops.equal(index, float(i)), least[name] * h, shortest)
    guess = ops.maximum(time, shortest)
    at_guess, happens, margin = at(guess), {}, 0.0
    for i, name in enumerate(before):
        happens[name] = ops.equal(index, float(i))
        margin = ops.where(happens[name], at_guess[name], margin)
    late = margin <= 0.0
    better = zero_between(ops, guess, margin, ops.where(late, 0.0, h), ops.where(late, begin, end))
    return FirstEvent(ops.clip(better, shortest, h), happens, begin, margin)


def zero_between(ops: Ops, x: Value, y: Value, other_x: Value, other_y: Value) -> Value:
    """Return the x at which the line through (`x`, `y`) and (`other_x`, `other_y`) is zero."""
    change = ops.where(ops.equal(y, other_y), 1.0, y - other_y)
    return x - y * (x - other_x) / change
