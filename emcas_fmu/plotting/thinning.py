"""Curves in few characters: lines are thinned and numbers rounded to the resolution of a screen."""

from __future__ import annotations

from collections.abc import Sequence
from math import ceil, inf, isfinite, log10
from typing import Any

import numpy as np
from numpy.typing import NDArray

Column = NDArray[np.float64]

# Resolution of a screen after a tenfold zoom, as a share of an axis.
_FINEST = 1.0 / 20_000.0


def rounded(value: float, digits: int = 6) -> float:
    """Return a value of any unit rounded to `digits` significant digits."""
    return float(f"{value:.{digits}g}")


def share(values: Column, log: bool, limits: Sequence[float]) -> Column:
    """Return the positions [1] of values along a linear or logarithmic (`log`) axis: 0 and 1 at its `limits`."""
    low, high = (np.log10(limits) if log else np.asarray(limits, dtype=float))
    with np.errstate(divide="ignore", invalid="ignore"):
        shares: Column = ((np.log10(values) if log else values) - low) / ((high - low) or 1.0)
    return shares


def thinned(x: Column, y: Column, finite: NDArray[np.bool_]) -> list[int]:
    """Return the indices of the points that reproduce a line within the resolution (swinging door); x must not fall.

    `x` and `y` are shares [1] of the axes. Points outside 0 <= x <= 1 are dropped, except the nearest on each side; if
    no point is inside, all are dropped. Of the points that are not finite, one remains in each gap.
    """
    inside = np.flatnonzero((x >= 0.0) & (x <= 1.0) & finite)
    if not len(inside):
        return []
    shown = slice(max(int(inside[0]) - 1, 0), int(inside[-1]) + 2)
    edges = np.flatnonzero(np.diff(finite[shown].astype(int), prepend=0, append=0)) + shown.start
    kept: list[int] = []
    for begin, end in edges.reshape(-1, 2).tolist():
        kept += [begin - 1] if kept else []  # the gap
        kept += _thinned_piece(x, y, begin, end)
    return kept


def _thinned_piece(x: Column, y: Column, begin: int, end: int) -> list[int]:
    """Return the indices to keep among the finite points `begin` to `end` - 1."""
    kept = [begin]
    low, high = -inf, inf  # slopes of the lines from the last kept point that pass all later points closely enough
    at, up = x.tolist(), y.tolist()
    for i in range(begin + 1, end):
        along = at[i] - at[kept[-1]]
        if along <= 0.0 or not low <= (up[i] - up[kept[-1]]) / along <= high:
            if i - 1 > kept[-1]:
                kept.append(i - 1)
            low, high = -inf, inf
            along = at[i] - at[i - 1]
        if along <= 0.0:  # a jump
            kept.append(i)
            continue
        low = max(low, (up[i] - _FINEST - up[kept[-1]]) / along)
        high = min(high, (up[i] + _FINEST - up[kept[-1]]) / along)
    return kept if kept[-1] == end - 1 else [*kept, end - 1]


def packed(values: Column, log: bool, limits: Sequence[float]) -> list[Any]:
    """Return values for JSON, with None for values that are not finite.

    On a logarithmic axis (`log`) they have five significant digits. On a linear axis with these `limits` the list has
    the number of decimals, then each value minus the one before it (at first 0), in units of the last decimal.
    """
    if log:
        return [rounded(value, 5) if isfinite(value) else None for value in values.tolist()]
    decimals = min(max(ceil(-log10((limits[1] - limits[0]) * _FINEST)), -300), 300) if limits[1] > limits[0] else 0
    packed: list[Any] = [decimals]
    previous = 0
    for value in values.tolist():
        if isfinite(value):
            number = round(value * 10.0**decimals)
            packed.append(number - previous)
            previous = number
        else:
            packed.append(None)
    return packed
