"""Bounds and dependencies of the results of a traced program, by interval arithmetic."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from itertools import product
from math import inf
from typing import NamedTuple

from .tracer import Assign, Block, Expr, Operand, Tracer


class Dependence(NamedTuple):
    """Bounds of a value, and the names of the parameters and arguments on which it depends; a constant has none."""

    low: float = -inf
    high: float = inf
    names: frozenset[str] = frozenset()

    @property
    def constant(self) -> bool:
        """Whether the bounds leave only one value."""
        return self.low == self.high


ZERO = Dependence(0.0, 0.0)
_Bounds = tuple[float, float]


def of_parameters(tracer: Tracer, parameters: Mapping[str, Dependence]) -> Mapping[str, Dependence]:
    """Return the bounds and dependencies of all values that depend on parameters alone, by their traced names."""
    known = {short: parameters[key] for short, key in tracer.parameters}
    _follow(tracer.prologue, known)
    return known


def dependencies(tracer: Tracer, name: str, arguments: Sequence[Dependence],
                 fixed: Mapping[str, Dependence]) -> list[Dependence]:
    """Return bounds and dependencies of the results of a function; all its values are assumed to be finite.

    `arguments` are the bounds and dependencies of its arguments; `fixed` is the result of :func:`of_parameters`.
    """
    (function,) = (f for f in tracer.functions if f.name == name)
    known = {**fixed, **dict(zip(function.printed, arguments, strict=True))}
    _follow(function.block, known)
    return [_look_up(known, value) for value in function.results]


def _look_up(known: Mapping[str, Dependence], value: Operand) -> Dependence:
    return known[value.name] if isinstance(value, Expr) else Dependence(float(value), float(value))


def _follow(block: Block, known: dict[str, Dependence]) -> None:
    for statement in block.statements:
        if isinstance(statement, Assign):
            known[statement.name] = _assigned(statement, [_look_up(known, operand) for operand in statement.operands])
            continue
        _follow(statement.yes, known)
        _follow(statement.no, known)
        condition = _look_up(known, statement.condition)
        for name, yes, no in zip(statement.names, statement.yes_values, statement.no_values, strict=True):
            known[name] = _chosen(condition, _look_up(known, yes), _look_up(known, no))


def _chosen(condition: Dependence, yes: Dependence, no: Dependence) -> Dependence:
    if condition.constant:
        return yes if condition.low else no
    return _within(min(yes.low, no.low), max(yes.high, no.high), condition, yes, no)


def _within(low: float, high: float, *values: Dependence) -> Dependence:
    """Return a value with these bounds that depends on `values`."""
    return Dependence(low, high, frozenset() if low == high else frozenset().union(*(value.names for value in values)))


def _assigned(statement: Assign, values: Sequence[Dependence]) -> Dependence:
    """Return the bounds and dependencies of an operation's result from those of its operands."""
    operation = statement.operation
    if operation == "where":
        return _chosen(*values)
    # The result is the operand that is certainly the smallest, the largest, or within the limits, if there is one.
    if operation in ("minimum", "maximum", "clip") and (sure := _sure(operation, values)):
        return sure
    if operation == "subtract" and _same(*statement.operands):
        return ZERO
    return _within(*_BOUNDS[operation](*((value.low, value.high) for value in values)), *values)


def _same(one: Operand, other: Operand) -> bool:
    return isinstance(one, Expr) and isinstance(other, Expr) and one.name == other.name


def _sure(operation: str, values: Sequence[Dependence]) -> Dependence | None:
    if operation == "clip":
        x, low, high = values
        return x if low.high <= x.low and x.high <= high.low else None
    for one, other in (values, values[::-1]):
        if one.high <= other.low if operation == "minimum" else one.low >= other.high:
            return one
    return None


def _truth(surely: bool, possibly: bool) -> _Bounds:
    return float(surely), float(possibly)


def _of_corners(function: Callable[[float, float], float]) -> Callable[[_Bounds, _Bounds], _Bounds]:
    """Return the bounds, as a function of two intervals, of a `function` whose extremes are at the intervals' ends."""
    def bounds(a: _Bounds, b: _Bounds) -> _Bounds:
        corners = [function(x, y) for x, y in product(a, b)]
        return min(corners), max(corners)

    return bounds


def _divided(a: _Bounds, b: _Bounds) -> _Bounds:
    if a == (0.0, 0.0):
        return a
    if b[0] <= 0.0 <= b[1]:
        return -inf, inf
    return _of_corners(lambda x, y: 0.0 if math.isinf(y) else x / y)(a, b)


def _rising(function: Callable[[float], float], at_least: float = -inf) -> Callable[[_Bounds], _Bounds]:
    """Return the bounds, as a function of an interval, of a rising `function` that is defined from `at_least` on."""
    def of(x: float) -> float:
        try:
            return function(max(x, at_least))
        except (ValueError, OverflowError):  # log(0); exp beyond the largest number; floor of infinity
            return x if math.isinf(x) else -inf if x <= at_least else inf

    return lambda a: (of(a[0]), of(a[1]))


def _waves(function: Callable[[float], float], bound: float) -> Callable[[_Bounds], _Bounds]:
    return lambda a: (function(a[0]),) * 2 if a[0] == a[1] else (-bound, bound)


def _absolute(a: _Bounds) -> _Bounds:
    least = 0.0 if a[0] <= 0.0 <= a[1] else min(abs(a[0]), abs(a[1]))
    return least, max(abs(a[0]), abs(a[1]))


_BOUNDS: dict[str, Callable[..., _Bounds]] = {
    "add": lambda a, b: (a[0] + b[0], a[1] + b[1]),
    "subtract": lambda a, b: (a[0] - b[1], a[1] - b[0]),
    "multiply": _of_corners(lambda x, y: 0.0 if 0.0 in (x, y) else x * y),
    "divide": _divided,
    "negative": lambda a: (-a[1], -a[0]),
    "less": lambda a, b: _truth(a[1] < b[0], a[0] < b[1]),
    "less_equal": lambda a, b: _truth(a[1] <= b[0], a[0] <= b[1]),
    "greater": lambda a, b: _truth(a[0] > b[1], a[1] > b[0]),
    "greater_equal": lambda a, b: _truth(a[0] >= b[1], a[1] >= b[0]),
    "equal": lambda a, b: _truth(a[0] == a[1] == b[0] == b[1], a[0] <= b[1] and b[0] <= a[1]),
    "both": _of_corners(min),
    "either": _of_corners(max),
    "negate": lambda a: (1.0 - a[1], 1.0 - a[0]),
    "minimum": _of_corners(min),
    "maximum": _of_corners(max),
    "clip": lambda x, low, high: (min(max(x[0], low[0]), high[0]), min(max(x[1], low[1]), high[1])),
    "fabs": _absolute,
    "sin": _waves(math.sin, 1.0),
    "cos": _waves(math.cos, 1.0),
    "tan": _waves(math.tan, inf),
    "atan": _rising(math.atan),
    "exp": _rising(math.exp),
    "log": _rising(math.log, 0.0),
    "sqrt": _rising(math.sqrt, 0.0),
    "floor": _rising(lambda x: float(math.floor(x))),
}
