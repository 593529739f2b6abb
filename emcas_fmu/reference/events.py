"""Integration of equations with events by SciPy, from event to event.

A plant has smooth equations in each of its modes: which bodies slide or stick, which limits hold. A mode ends where
one of its event margins, functions of the state that are above 0 while it lasts, falls through 0.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np

Value = float | int | bool
Vector = Sequence[float]
State = list[float]
Successor = Callable[[State], Any]
"""Returns the mode after an event from the state there, and may correct that state in place."""

_MOST_STALLS = 20  # events at one instant, one after the other


class Event:
    """A SciPy event: its `margin` is above 0 while the mode lasts; `successor` gives the next mode."""

    terminal = True
    direction = -1.0

    def __init__(self, margin: Callable[[Vector], float], successor: Successor):
        self.margin, self.successor = margin, successor

    def __call__(self, _time: float, state: Vector) -> float:
        # SciPy counts a value that stays exactly zero as crossing. Here a zero is not yet crossed, so that a
        # frictionless fin can rest without load.
        return self.margin(state) or sys.float_info.min


class Accuracy(NamedTuple):
    """Tolerances and largest step [s] of an integration: the absolute tolerances are `rtol` times `scales`, in the
    units of the states.

    Events are looked for at the ends of a step: of two zeros of a margin within one step neither is seen.
    """

    rtol: float
    scales: tuple[float, ...]
    max_step: float


class Plant(Protocol):
    """Smooth equations for each mode, and the events that end a mode."""

    @property
    def accuracy(self) -> Accuracy:
        """Tolerances and largest step of the integration."""

    def slope(self, state: Vector, mode: Any, around: Any) -> Sequence[float]:
        """Return the time derivative of the state in a mode; `around` is what acts from outside."""

    def events(self, mode: Any, around: Any) -> list[Event]:
        """Return the events that end a mode."""


def friction_events(direction: int, speed: Callable[[Vector], float], excess: Callable[[Vector, int], float],
                    halt: Successor, start: Callable[[int], Successor]) -> list[Event]:
    """Return the events of a body under dry friction.

    One that slides in a `direction` comes to rest where its `speed` is 0. One at rest, of direction 0, starts towards
    a side where `excess`, the force beyond what friction holds on that side, rises above 0.
    """
    if direction:
        return [Event(lambda y: direction * speed(y), halt)]

    def breakaway(side: int) -> Event:
        return Event(lambda y: -excess(y, side), start(side))

    return [breakaway(1), breakaway(-1)]


def advance(plant: Plant, state: State, mode: Any, around: Any, start: float, end: float) -> tuple[State, Any]:
    """Integrate from `start` to `end` [s] through every event; return the state and the mode at `end`.

    Raises ArithmeticError where the integration fails, or where modes follow each other without progress in time.
    """
    from scipy.integrate import solve_ivp  # would be a third of the start of every command

    rtol, scales, max_step = plant.accuracy
    time, stalls = start, 0
    while time < end:
        events = plant.events(mode, around)
        run = solve_ivp(lambda _t, y, mode=mode: plant.slope(y.tolist(), mode, around), (time, end), state,
                        method="DOP853", events=events, rtol=rtol, atol=rtol * np.array(scales), max_step=max_step)
        if run.status < 0:
            raise ArithmeticError(f"integration failed after {time} s in {mode}: {run.message}")
        state, reached = [float(x) for x in run.y[:, -1]], float(run.t[-1])
        if run.status == 1:  # all events are terminal, so exactly one has fired: the first
            fired = next(event for event, times in zip(events, run.t_events, strict=True) if times.size)
            mode = fired.successor(state)
        stalls = 0 if reached > time else stalls + 1
        if stalls > _MOST_STALLS:
            raise ArithmeticError(f"modes chatter at {time} s in {mode}")
        time = reached
    return state, mode
