"""Operations on plain Python numbers; needs nothing but the standard library."""

from __future__ import annotations

import math

from .base import Thunk, Value


def _real(x: Value) -> float:
    # math.sin(casadi.SX) silently returns nan, so anything but a number is refused.
    if isinstance(x, (float, int)):
        return x
    raise TypeError(f"float operations take numbers, not {type(x).__name__}")


class FloatOps:
    """See :class:`emcas_fmu.ops.base.Ops`."""

    @staticmethod
    def sin(x: Value) -> Value:
        return math.sin(_real(x))

    @staticmethod
    def cos(x: Value) -> Value:
        return math.cos(_real(x))

    @staticmethod
    def tan(x: Value) -> Value:
        return math.tan(_real(x))

    @staticmethod
    def atan(x: Value) -> Value:
        return math.atan(_real(x))

    @staticmethod
    def exp(x: Value) -> Value:
        return math.exp(_real(x))

    @staticmethod
    def log(x: Value) -> Value:
        return math.log(_real(x))

    @staticmethod
    def sqrt(x: Value) -> Value:
        return math.sqrt(_real(x))

    @staticmethod
    def fabs(x: Value) -> Value:
        return math.fabs(_real(x))

    @staticmethod
    def floor(x: Value) -> Value:
        return float(math.floor(_real(x)))

    @staticmethod
    def minimum(a: Value, b: Value) -> Value:
        return a if _real(a) < _real(b) else b

    @staticmethod
    def maximum(a: Value, b: Value) -> Value:
        return a if _real(a) > _real(b) else b

    @staticmethod
    def clip(x: Value, low: Value, high: Value) -> Value:
        return low if _real(x) < _real(low) else high if x > _real(high) else x

    @staticmethod
    def equal(a: Value, b: Value) -> Value:
        return _real(a) == _real(b)

    @staticmethod
    def both(a: Value, b: Value) -> Value:
        return a and b

    @staticmethod
    def either(a: Value, b: Value) -> Value:
        return a or b

    @staticmethod
    def negate(a: Value) -> Value:
        return not _real(a)

    @staticmethod
    def where(condition: Value, yes: Value, no: Value) -> Value:
        return yes if _real(condition) else no

    @staticmethod
    def branch(condition: Value, yes: Thunk, no: Thunk) -> tuple[Value, ...]:
        return yes() if _real(condition) else no()


FLOATS = FloatOps()
