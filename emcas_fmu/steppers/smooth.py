"""One step of smooth equations of motion.

ROS2 of Verwer, Spee, Blom and Hundsdorfer (1999), "A second-order Rosenbrock method applied to photochemical
dispersion problems", SIAM Journal on Scientific Computing 20 (4), 1456-1480:

    (I - g h A) k1 = f(y)        (I - g h A) k2 = f(y + h k1) - 2 k1        y(h) = y + h (3 k1 + k2)/2

With g = 1 - 1/sqrt(2) and the Jacobian A of f the method is L-stable: a mode that decays much faster than the step is
damped. It is of second order for any A, so difference quotients are sufficient.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from math import sqrt
from typing import Any

from ..namespace import Record
from ..ops.base import Ops, Value

_GAMMA = 1.0 - 1.0 / sqrt(2.0)
# Ratio of a difference quotient's increment to 1 + |state|: a few times the square root of a double's rounding.
_INCREMENT = 1e-7

Derivatives = Callable[[Ops, Any, Record, Any], Mapping[str, Value]]


def ros2(ops: Ops, slope: Callable[[list[Value]], list[Value]], begin: list[Value], h: Value) -> list[Value]:
    """Return the values after a step of `h` [s] from `begin`; `slope` returns d/dt of each value."""
    count, first = len(begin), slope(begin)
    columns = []
    for i, value in enumerate(begin):
        increment = _INCREMENT * (1.0 + ops.fabs(value))
        shifted = slope([*begin[:i], value + increment, *begin[i + 1:]])
        # In a traced program a derivative that does not depend on the value is the same object: its entry is 0.
        columns.append([0.0 if a is b else (a - b) / increment for a, b in zip(shifted, first, strict=True)])
    matrix = [[_less(1.0 if i == k else 0.0, _GAMMA * h, columns[k][i]) for k in range(count)] for i in range(count)]
    k1 = solve(matrix, first)
    second = slope([y + h * k for y, k in zip(begin, k1, strict=True)])
    k2 = solve(matrix, [f - 2.0 * k for f, k in zip(second, k1, strict=True)])
    return [y + h * (1.5 * a + 0.5 * b) for y, a, b in zip(begin, k1, k2, strict=True)]


def solve(matrix: Sequence[Sequence[Value]], right: Sequence[Value]) -> list[Value]:
    """Return the solution [n] of `matrix` [n, n] y = `right` [n] by elimination without pivoting; no pivot may be 0."""
    rows = [[*row, value] for row, value in zip(matrix, right, strict=True)]
    count = len(rows)
    for i in range(count):
        for k in range(i + 1, count):
            if not _zero(rows[k][i]):
                factor = rows[k][i] / rows[i][i]
                rows[k] = [_less(a, factor, b) for a, b in zip(rows[k], rows[i], strict=True)]
    solution: list[Value] = [0.0] * count
    for i in reversed(range(count)):
        total = rows[i][count]
        for k in range(i + 1, count):
            total = _less(total, rows[i][k], solution[k])
        solution[i] = total / rows[i][i]
    return solution


def _zero(value: Value) -> bool:
    """Return whether a value is the number 0, not a traced value: terms with this factor are left out."""
    return isinstance(value, float) and value == 0.0


def _less(value: Value, factor: Value, other: Value) -> Value:
    """Return value - factor other."""
    return value if _zero(factor) or _zero(other) else value - factor * other
