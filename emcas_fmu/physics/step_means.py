"""Means over a step of values that follow an exponential, such as current and voltage of a winding."""

from __future__ import annotations

from ..ops.base import Ops, Value

_SHORT = 0.01  # ratio of step to time constant up to which series replace closed forms, which lose digits; error 6e-7


def shares(ops: Ops, ratio: Value) -> tuple[Value, ...]:
    """Return the means over the step of s and s^2, where s(t) rises from 0 at the start to 1 at the end.

    `ratio` is the ratio of the step to the exponential's time constant, above 0.
    """
    def exact() -> tuple[Value, ...]:
        decay = ops.exp(-ratio)
        change = 1.0 - decay
        rest = change / ratio
        return (1.0 - rest) / change, (1.0 - 2.0 * rest + 0.5 * rest * (1.0 + decay)) / (change * change)

    return ops.branch(ratio > _SHORT, exact, lambda: (0.5 + ratio / 12.0, 1.0 / 3.0 + ratio / 12.0))


def mean(ops: Ops, start: Value, end: Value, ratio: Value) -> Value:
    """Return the mean of a value that changes from `start` to `end`, with the `ratio` of :func:`shares`."""
    return start + (end - start) * shares(ops, ratio)[0]


def mean_square(ops: Ops, start: Value, end: Value, ratio: Value) -> Value:
    """Return the mean of i^2 [A^2] while i changes from `start` to `end` [A], with the `ratio` of :func:`shares`."""
    first, second = shares(ops, ratio)
    change = end - start
    return start * start + change * (2.0 * start * first + change * second)


def mean_product(ops: Ops, start: tuple[Value, Value], end: tuple[Value, Value], ratio: Value) -> Value:
    """Return the mean product of two values that change from `start` to `end`, with the `ratio` of :func:`shares`."""
    first, second = shares(ops, ratio)
    (a, b), change_a, change_b = start, end[0] - start[0], end[1] - start[1]
    return a * b + (a * change_b + b * change_a) * first + change_a * change_b * second
