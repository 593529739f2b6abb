"""Integration by SciPy of equations with events, from event to event.

A mode is a named tuple: its fields are the directions in which bodies slide and the limits that act. Its equations are
smooth. Its event margins are functions of the state [SI] that are above 0 while the mode lasts. The mode ends where the
first of them falls through 0; this event changes states and fields of the mode, one after the other.

`Event` is a margin with its changes. The following return the events of one field of the mode:

- `switch`: the field is true while a value is above 0.
- `band`: the field is 0 while a value is within a band, 1 above it, -1 below it.
- `Body`: the field is the direction in which a body under dry friction slides, 0 while it rests.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Mapping
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from .actuator import ReferenceActuator

Array = NDArray[np.floating[Any]]
Scalar = float | int | bool
StateVector = list[float]
Margin = Callable[[StateVector], float]
Changes = Mapping[int | str, Scalar | Callable[[StateVector, Any], Scalar]]
"""New values of states, by index, and of the mode's fields, by name. A function computes a value from the state, after
the preceding changes, and the surroundings."""

_MOST_STALLS = 20  # largest number of events in a row without progress in time


class Event:
    """A SciPy event: a margin, and the changes when it falls through 0."""

    terminal = True
    direction = -1.0

    def __init__(self, margin: Margin, changes: Changes):
        self.margin, self.changes = margin, changes

    def __call__(self, _time: float, state: StateVector) -> float:
        # SciPy counts a margin that stays exactly 0 as a crossing. Here 0 counts as positive, so that a frictionless
        # fin can rest without load.
        return self.margin(state) or sys.float_info.min

    def changed(self, state: StateVector, mode: Any, around: Any) -> Any:
        """Return the mode after the event, and change the state in place."""
        for key, change in self.changes.items():
            value = change(state, around) if callable(change) else change
            if isinstance(key, int):
                state[key] = value
            else:
                mode = mode._replace(**{key: value})
        return mode


class Body(NamedTuple):
    """A body under dry friction.

    `field` names its direction in the mode. `speed` returns its sliding speed; `rest` are the other changes when it
    stops. `excess` returns the force or torque on the resting body towards a side beyond stiction, from state, mode,
    surroundings and side. The body comes to rest where the magnitude of its angle reaches `stop`.
    """

    field: str
    speed: Margin
    excess: Callable[[StateVector, Any, Any, int], float]
    rest: Changes
    angle: int = 0  # index of its angle in the state
    stop: float = math.inf  # rad

    def held(self, state: StateVector, mode: Any, around: Any, side: int) -> float:
        """Return a margin that is above 0 while the resting body does not start towards a side."""
        return 1.0 if side * state[self.angle] >= self.stop else -self.excess(state, mode, around, side)

    def starts(self, state: StateVector, mode: Any, around: Any) -> int:
        """Return the direction in which the resting body starts, or 0."""
        return next((side for side in (1, -1) if self.held(state, mode, around, side) < 0.0), 0)

    def events(self, mode: Any, around: Any) -> list[Event]:
        """Return the events at which the body starts, comes to rest or meets its stop."""
        way = getattr(mode, self.field)
        if not way:
            return [Event(partial(self.held, mode=mode, around=around, side=side), {self.field: side})
                    for side in (1, -1)]
        rest: Changes = {self.field: 0, **self.rest}
        halt = Event(lambda y: way * self.speed(y), rest)
        if self.stop == math.inf:
            return [halt]
        return [halt, Event(lambda y: self.stop - way * y[self.angle], {self.angle: way * self.stop, **rest})]


def band(mode: Any, field: str, value: Margin, low: float, high: float) -> list[Event]:
    """Return the events at which a value leaves or enters a band from `low` to `high`, in the value's unit."""
    side = getattr(mode, field)
    if side:
        return [Event(lambda y: value(y) - high if side > 0 else low - value(y), {field: 0})]
    return [Event(lambda y: high - value(y), {field: 1}), Event(lambda y: value(y) - low, {field: -1})]


def switch(mode: Any, field: str, value: Margin) -> Event:
    """Return the event at which a value changes its sign."""
    above = getattr(mode, field)
    return Event(lambda y: value(y) if above else -value(y), {field: not above})


class Accuracy(NamedTuple):
    """Tolerances and largest step [s] of an integration.

    The absolute tolerances are `rtol` times `scales`, in the units of the states. SciPy compares margins only at the
    ends of a step: it misses two zeros of a margin within one step.
    """

    rtol: float
    scales: tuple[float, ...]
    max_step: float


def advance(actuator: ReferenceActuator, state: StateVector, mode: Any, around: Any, start: float,
            end: float) -> tuple[StateVector, Any]:
    """Integrate from `start` to `end` [s] through every event and return the state and the mode at `end`.

    Raises ArithmeticError if the integration fails, or if modes alternate without progress in time.
    """
    from scipy.integrate import solve_ivp  # slow: a third of every command's start if imported above

    rtol, scales, max_step = actuator.accuracy
    time, stalls = start, 0
    while time < end:
        events = actuator.events(mode, around)
        holding = [event for event in events if event(time, state) > 0.0]
        run = solve_ivp(lambda _t, y, mode=mode: actuator.slope(y.tolist(), mode, around), (time, end), state,
                        method="DOP853", events=events, rtol=rtol, atol=rtol * np.array(scales), max_step=max_step)
        if run.status < 0:
            raise ArithmeticError(f"integration failed after {time} s in {mode}: {run.message}")
        state, last_time = [float(x) for x in run.y[:, -1]], float(run.t[-1])
        if run.status == 1:  # all events are terminal, so exactly one has fired: the first
            fired = next(event for event, times in zip(events, run.t_events, strict=True) if times.size)
            # Others at the same time would not fire later: their margins are already below 0.
            also = [event for event in holding if event(last_time, state) < 0.0
                    and event.changes.keys().isdisjoint(fired.changes)]
            for event in (fired, *also):
                mode = event.changed(state, mode, around)
            mode = actuator.settled(state, mode, around)
        stalls = 0 if last_time > time else stalls + 1
        if stalls > _MOST_STALLS:
            raise ArithmeticError(f"modes alternate at {time} s without progress, the last is {mode}; a mode must not "
                                  "end where it begins")
        time = last_time
    return state, mode
