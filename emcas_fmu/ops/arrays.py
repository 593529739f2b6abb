"""Operations on NumPy arrays, element by element (any broadcastable shapes)."""

from __future__ import annotations

from typing import cast

import numpy as np

from .base import Ops, Thunk, Value
from .derived import Derived


class ArrayOps(Derived):
    """See :class:`emcas_fmu.ops.base.Ops`."""

    sin = staticmethod(np.sin)
    cos = staticmethod(np.cos)
    tan = staticmethod(np.tan)
    atan = staticmethod(np.arctan)
    exp = staticmethod(np.exp)
    log = staticmethod(np.log)
    sqrt = staticmethod(np.sqrt)
    fabs = staticmethod(np.fabs)
    floor = staticmethod(np.floor)
    minimum = staticmethod(np.minimum)
    maximum = staticmethod(np.maximum)
    equal = staticmethod(np.equal)
    both = staticmethod(np.logical_and)
    either = staticmethod(np.logical_or)
    negate = staticmethod(np.logical_not)
    where = staticmethod(np.where)

    @staticmethod
    def clip(x: Value, low: Value, high: Value) -> Value:
        return np.minimum(np.maximum(x, low), high)

    @staticmethod
    def branch(condition: Value, yes: Thunk, no: Thunk, rare: bool = False) -> tuple[Value, ...]:
        if np.ndim(condition) == 0:  # the same for all elements
            return yes() if condition else no()
        return tuple(np.where(condition, a, b) for a, b in zip(yes(), no(), strict=True))


ARRAYS = cast(Ops, ArrayOps())
