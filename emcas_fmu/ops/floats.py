"""Operations on plain Python numbers; needs only the standard library."""

from __future__ import annotations

import math
from collections.abc import Callable

from . import elementary
from .base import Thunk, Value
from .derived import Derived


def _real(x: Value) -> float:
    # Other types are refused, since math.sin(casadi.SX) returns NaN without an error.
    if isinstance(x, (float, int)):
        return x
    raise TypeError(f"float operations need numbers, not {type(x).__name__}")


def _of_number(function: Callable[[float], float]) -> staticmethod[[Value], float]:
    """Return a function of one number that raises TypeError for other types."""
    return staticmethod(lambda x: function(_real(x)))


class FloatOps(Derived):
    """See :class:`emcas_fmu.ops.base.Ops`."""

    sin = _of_number(lambda x: elementary.sin(FLOATS, x))
    cos = _of_number(lambda x: elementary.cos(FLOATS, x))
    tan = _of_number(lambda x: elementary.tan(FLOATS, x))
    atan = _of_number(lambda x: elementary.atan(FLOATS, x))
    exp = _of_number(lambda x: elementary.exp(FLOATS, x))
    log = _of_number(lambda x: elementary.log(FLOATS, x))
    sqrt = _of_number(math.sqrt)
    fabs = _of_number(math.fabs)
    floor = _of_number(lambda x: float(math.floor(x)))
    power_of_two = _of_number(lambda k: math.ldexp(1.0, int(k)) if k == k else k)
    exponent = _of_number(lambda x: float(math.frexp(x)[1] - 1))
    minimum = staticmethod(lambda a, b: a if _real(a) < _real(b) else b)
    maximum = staticmethod(lambda a, b: a if _real(a) > _real(b) else b)
    clip = staticmethod(lambda x, low, high: low if _real(x) < _real(low) else high if x > _real(high) else x)
    equal = staticmethod(lambda a, b: _real(a) == _real(b))
    both = staticmethod(lambda a, b: a and b)
    either = staticmethod(lambda a, b: a or b)
    negate = staticmethod(lambda a: not _real(a))
    where = staticmethod(lambda condition, yes, no: yes if _real(condition) else no)

    @staticmethod
    def branch(condition: Value, yes: Thunk, no: Thunk, rare: bool = False) -> tuple[Value, ...]:
        return yes() if _real(condition) else no()


FLOATS: FloatOps = FloatOps()
