"""Operations on CasADi expressions; the only module that imports CasADi (extra `symbols`)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from .base import Thunk, Value

try:
    import casadi as ca
except ImportError as error:  # pragma: no cover - depends on the environment
    raise ImportError("CasADi is not installed: pip install 'emcas-fmu[symbols]'") from error


class SymbolOps:
    """See :class:`emcas_fmu.ops.base.Ops`."""

    sin = staticmethod(ca.sin)
    cos = staticmethod(ca.cos)
    tan = staticmethod(ca.tan)
    atan = staticmethod(ca.atan)
    exp = staticmethod(ca.exp)
    log = staticmethod(ca.log)
    sqrt = staticmethod(ca.sqrt)
    fabs = staticmethod(ca.fabs)
    floor = staticmethod(ca.floor)
    minimum = staticmethod(ca.fmin)
    maximum = staticmethod(ca.fmax)
    both = staticmethod(ca.logic_and)
    either = staticmethod(ca.logic_or)
    negate = staticmethod(ca.logic_not)

    @staticmethod
    def equal(a: Value, b: Value) -> Value:
        return ca.eq(a, b)

    @staticmethod
    def where(condition: Value, yes: Value, no: Value) -> Value:
        return ca.if_else(condition, yes, no)

    @staticmethod
    def clip(x: Value, low: Value, high: Value) -> Value:
        return ca.fmin(ca.fmax(x, low), high)

    @staticmethod
    def branch(condition: Value, yes: Thunk, no: Thunk, rare: bool = False) -> tuple[Value, ...]:
        return tuple(ca.if_else(condition, a, b) for a, b in zip(yes(), no(), strict=True))


SYMBOLS = SymbolOps()


Linearised = Callable[[Sequence[float]], tuple[Any, Any]]
"""Values [m] and exact Jacobian [m, n] of a function at a point [n], as NumPy arrays."""


def linearised(function: Callable[..., Sequence[Value]], size: int) -> Linearised:
    """Return a function of `size` expressions with its Jacobian, by algorithmic differentiation of its operations."""
    x = ca.SX.sym("x", size)
    y = ca.vertcat(*function(*ca.vertsplit(x)))
    both = ca.Function("function", [x], [y, ca.jacobian(y, x)])

    def at(point: Sequence[float]) -> tuple[Any, Any]:
        values, slopes = both(list(point))
        return values.full().ravel(), slopes.full()

    return at


def jacobian(function: Callable[..., Sequence[Value]], point: Sequence[float]) -> tuple[Any, Any]:
    """Return values [m] and exact Jacobian [m, n] of a function of n expressions at a `point` [n]."""
    return linearised(function, len(point))(point)
