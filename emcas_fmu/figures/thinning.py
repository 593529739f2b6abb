"""Values of curves in few characters: lines thinned to what a screen shows, numbers rounded to that."""

from __future__ import annotations

from collections.abc import Sequence
from math import ceil, isfinite, log10
from typing import Any

import numpy as np
from numpy.typing import NDArray

Values = NDArray[np.float64]

# What a screen shows after a zoom of ten: values are kept to this share of an axis.
_FINEST = 1.0 / 20_000.0


def rounded(value: float, digits: int = 6) -> float:
    """Return a value of no more than these significant digits."""
    return float(f"{value:.{digits}g}")


def share(values: Values, log: bool, limits: Sequence[float]) -> Values:
    """Return where values lie between the limits of an axis, which are 0 and 1."""
    low, high = (np.log10(limits) if log else np.asarray(limits, dtype=float))
    with np.errstate(divide="ignore", invalid="ignore"):
        shares: Values = ((np.log10(values) if log else values) - low) / ((high - low) or 1.0)
    return shares


def thinned(x: Values, y: Values, finite: NDArray[np.bool_]) -> list[int]:
    """Return which points of a line to keep, so that it nowhere moves by more than what is seen (swinging door)."""
    inside = np.flatnonzero((x >= 0.0) & (x <= 1.0) & finite)
    if not len(inside):
        return []
    first, last = max(int(inside[0]) - 1, 0), min(int(inside[-1]) + 1, len(x) - 1)
    kept: list[int] = []
    begin = -1  # of the piece that is being drawn, whose slope stays between low and high
    low, high = -np.inf, np.inf
    at, up, sound = x.tolist(), y.tolist(), finite.tolist()
    for i in range(first, last + 1):
        if not sound[i]:
            if begin >= 0:
                kept += [i - 1] if i - 1 > begin else []
                kept.append(i)
            begin = -1
            continue
        if begin < 0:
            kept.append(i)
            begin, low, high = i, -np.inf, np.inf
            continue
        along = at[i] - at[begin]
        if (along > 0.0 and not low <= (up[i] - up[begin]) / along <= high) or along <= 0.0:
            if i - 1 > begin:
                kept.append(i - 1)
            begin, low, high = i - 1, -np.inf, np.inf
            along = at[i] - at[begin]
            if along <= 0.0:
                kept.append(i)
                begin = i
                continue
        low = max(low, (up[i] - _FINEST - up[begin]) / along)
        high = min(high, (up[i] + _FINEST - up[begin]) / along)
    if begin >= 0 and last > begin:
        kept.append(last)
    return list(dict.fromkeys(kept))


def packed(values: Values, log: bool, limits: Sequence[float]) -> list[Any]:
    """Return values as numbers of five digits, or, along a linear axis, as decimals and differences in that place."""
    if log:
        return [rounded(value, 5) if isfinite(value) else None for value in values.tolist()]
    places = min(max(ceil(-log10((limits[1] - limits[0]) * _FINEST)), -300), 300) if limits[1] > limits[0] else 0
    packed: list[Any] = [places]
    before = 0
    for value in values.tolist():
        if not isfinite(value):
            packed.append(None)
            continue
        number = round(value * 10.0**places)
        packed.append(number - before)
        before = number
    return packed
