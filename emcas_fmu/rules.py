"""Limits of parameters and rules for their combinations. Standard library only: Python FMUs contain this file.

A rule is a function of the operations `ops`, as the equations are: both back ends apply the same rule. Messages are
printf formats.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from functools import reduce
from itertools import pairwise
from math import inf, isfinite, pi
from typing import Any, NamedTuple

SCAN = 100  # number of shares of the travel on each side of 0
SHARES = tuple(i / SCAN for i in range(-SCAN, SCAN + 1))
"""Shares of the travel, from -1 to 1, at which a scanned rule is evaluated."""
# Relative tolerance of comparisons: equal values may differ in the last digit if they are written in different units.
SLACK = 1e-12

NOT_FINITE = "%s = %.9g is not a finite number"
BELOW = "%s = %.9g is below its minimum %.9g"
ABOVE = "%s = %.9g is above its maximum %.9g"
TOO_LATE = ("start time %.9g s: at this time numbers are too coarse for the solver's ticks; choose a start time within "
            "+-%.6g s")
UNCONNECTED = "%s at the first command: the fin does not follow the command; connect this input if it should follow"
NO_VARIABLE = "no %s variable has value reference %u; modelDescription.xml lists references and types"
ANGLE = "%.6g rad (%.6g deg)"


class Rule(NamedTuple):
    """A condition for a combination of parameters.

    `check(ops, p, share)` returns the amount by which the rule is broken (above zero: broken) and the numbers for the
    `message`. A `scanned` rule is evaluated at shares of the travel from -1 to 1, and the worst share is reported. A
    rule with `warning` reports values that are allowed but unusual.
    """

    check: Callable[[Any, Any, Any], tuple[Any, ...]]
    message: str
    scanned: bool = False
    warning: bool = False


def rule(message: str, *, scanned: bool = False, warning: bool = False) -> Callable[[Callable[..., Any]], Rule]:
    """Return a decorator that turns a check into the :class:`Rule` with this message."""
    return lambda check: Rule(check, message, scanned, warning)


Check = tuple[Callable[[float], tuple[Any, ...]], str, bool, bool]
"""A rule bound to parameters: check(share of the travel), message, whether it is scanned, whether it only warns."""


def in_degrees(angle: Any) -> Any:
    """Convert an angle [rad], a number or traced value, to degrees."""
    return angle * (180.0 / pi)


def when(ops: Any, condition: Any) -> Any:
    """Return the amount by which a rule is broken: 1 if the `condition` that breaks it holds, otherwise 0."""
    return ops.where(condition, 1.0, 0.0)


def rising(name: str, count: int, unit: str = "1") -> Rule:
    """Return the rule that the `count` values of an array, such as the points of a table, strictly increase."""
    @rule(f"{name} = [{', '.join(['%.6g'] * count)}]{'' if unit == '1' else ' ' + unit} must rise from point to point")
    def check(ops: Any, p: Any, _: Any) -> tuple[Any, ...]:
        points = reduce(getattr, name.split("."), p)
        falls: Any = False
        for low, high in pairwise(points):
            falls = ops.either(falls, low >= high)
        return when(ops, falls), *points

    return check


def at_most(name: str, limit: str, unit: str = "", otherwise: str = "") -> Rule:
    """Return the rule that the parameter `name` is at most the parameter `limit`, both in `unit`.

    `otherwise` is the end of the message.
    """
    unit = unit and f" {unit}"

    @rule(f"{name} = %.6g{unit} must be at most {limit} = %.6g{unit}{otherwise}")
    def check(ops: Any, p: Any, _: Any) -> tuple[Any, ...]:
        value, most = (reduce(getattr, each.split("."), p) for each in (name, limit))
        return when(ops, value > most * (1.0 + SLACK)), value, most

    return check


def check_ranges(values: Mapping[str, float], table: Iterable[tuple[str, float, float]]) -> list[str]:
    """Return a message for each value that is not finite or outside its limits.

    `table` contains (name, minimum, maximum). Raises KeyError if `values` lacks a name.
    """
    problems = []
    for name, minimum, maximum in table:
        value = values[name]
        if not isfinite(value):
            problems.append(NOT_FINITE % (name, value))
        elif value < minimum:
            problems.append(BELOW % (name, value, minimum))
        elif value > maximum:
            problems.append(ABOVE % (name, value, maximum))
    return problems


def check_rules(checks: Iterable[Check], warnings: bool = False) -> list[str]:
    """Return a message for each broken rule, with the numbers at its worst share.

    With `warnings` these are the rules that only warn, otherwise those that refuse.
    """
    problems = []
    for check, message, scanned, warning in checks:
        if warning != warnings:
            continue
        worst, numbers = -inf, ()  # type: float, tuple[float, ...]
        for share in SHARES if scanned else (0.0,):
            broken, *rest = check(share)
            if broken > worst:
                worst, numbers = broken, tuple(rest)
        if worst > 0.0:
            problems.append(message % numbers)
    return problems
