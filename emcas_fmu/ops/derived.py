"""Functions composed of the basic operations, the same for floats, arrays, symbols and the tracer."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from math import pi
from typing import Any

from .base import Value

# Below 0.1 tanh x is the series x (1 + c1 x^2 + ...), within 4e-15: the quotient of exponentials loses digits there.
_SMALL, _TANH = 0.1, (1.0, -1.0 / 3.0, 2.0 / 15.0, -17.0 / 315.0, 62.0 / 2835.0, -1382.0 / 155925.0)
_MOST = 64  # largest whole exponent for which powers are products


class TableError(ValueError):
    """The `points` of a table do not rise."""

    def __init__(self, points: Sequence[Value]) -> None:
        self.points = points
        super().__init__(f"the points of a table must rise; they are {', '.join(f'{point:g}' for point in points)}")


class Derived:
    """See :class:`emcas_fmu.ops.base.Ops`."""

    def sign(self: Any, x: Value) -> Value:
        return self.where(x > 0.0, 1.0, self.where(x < 0.0, -1.0, 0.0))

    def tanh(self: Any, x: Value) -> Value:
        size = self.fabs(x)
        square, series = x * x, _TANH[-1]
        for coefficient in _TANH[-2::-1]:
            series = coefficient + square * series
        decay = self.exp(-2.0 * size)
        large = self.where(x < 0.0, -1.0, 1.0) * ((1.0 - decay) / (1.0 + decay))
        return self.where(size < _SMALL, x * series, large)

    def pow(self: Any, x: Value, y: Value) -> Value:
        if isinstance(y, (int, float)) and float(y).is_integer() and abs(y) <= _MOST:
            return _power(x, int(abs(y))) if y >= 0 else 1.0 / _power(x, int(abs(y)))
        zero = self.equal(x, 0.0)
        return self.where(zero, 0.0, self.exp(y * self.log(self.where(zero, 1.0, x))))

    def atan2(self: Any, y: Value, x: Value) -> Value:
        high, wide = self.fabs(y), self.fabs(x)
        steep = high > wide
        large = self.maximum(high, wide)
        ratio = self.atan(self.minimum(high, wide) / self.where(large > 0.0, large, 1.0))
        angle = self.where(steep, 0.5 * pi - ratio, ratio)
        angle = self.where(x < 0.0, pi - angle, angle)
        return self.where(y < 0.0, -angle, angle)

    def interp(self: Any, x: Value, points: Sequence[Value], values: Sequence[Value]) -> Value:
        if len(points) != len(values) or len(points) < 2:
            raise ValueError(f"a table of {len(points)} points and {len(values)} values; both need the same number, 2 "
                             "or more")
        numbers = [point for point in points if isinstance(point, (int, float))]
        if len(numbers) == len(points) and any(high <= low for low, high in pairwise(numbers)):
            raise TableError(points)
        result = values[0]
        for (low, high), (begin, end) in zip(pairwise(points), pairwise(values)):
            result = self.where(x > low, begin + (x - low) * ((end - begin) / (high - low)), result)
        return self.where(x >= points[-1], values[-1], result)


def _power(x: Value, n: int) -> Value:
    """Return the n-th power by repeated squaring."""
    if n == 0:
        return 1.0
    half = _power(x, n // 2)
    square = half * half if n > 1 else 1.0
    return square * x if n % 2 else square
