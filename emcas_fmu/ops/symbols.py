"""Operations on CasADi expressions (extra `symbols`)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from .base import Thunk, Value
from .derived import Derived

try:
    import casadi as ca
except ModuleNotFoundError as error:  # pragma: no cover - depends on the environment
    raise ImportError("CasADi is not installed: pip install 'emcas-fmu[symbols]'") from error


class SymbolOps(Derived):
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
    equal = staticmethod(ca.eq)
    where = staticmethod(ca.if_else)

    @staticmethod
    def clip(x: Value, low: Value, high: Value) -> Value:
        return ca.fmin(ca.fmax(x, low), high)

    @staticmethod
    def branch(condition: Value, yes: Thunk, no: Thunk, rare: bool = False) -> tuple[Value, ...]:
        return tuple(ca.if_else(condition, a, b) for a, b in zip(yes(), no(), strict=True))


SYMBOLS = SymbolOps()


class Linearised:
    """A function of `size` expressions with its exact Jacobian, by algorithmic differentiation of its operations.

    `parameters` are further symbols in the function; `varies` is true if values or Jacobian depend on them.
    """

    def __init__(self, function: Callable[..., Sequence[Value]], size: int, parameters: Any = None) -> None:
        symbols = ca.SX(0, 1) if parameters is None else parameters
        x = ca.SX.sym("x", size)
        y = ca.vertcat(*function(*ca.vertsplit(x)))
        slopes = ca.jacobian(y, x)
        self.varies = bool(ca.depends_on(ca.veccat(y, slopes), symbols))
        self._both = ca.Function("function", [x, symbols], [y, slopes])

    def __call__(self, point: Sequence[float], parameters: Sequence[float] = ()) -> tuple[Any, Any]:
        """Return values, of shape (m,), and Jacobian, (m, n), at a point of n numbers, as NumPy arrays."""
        values, slopes = self._both(list(point), list(parameters))
        return values.full().ravel(), slopes.full()
