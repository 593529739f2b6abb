"""Percentiles of samples, and the probability that a requirement is met, with its confidence interval."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import ceil, floor, log10

import numpy as np
from scipy import stats

from ...bench.requirements import Requirement
from ...simulation import Array

PERCENTILES = (1, 5, 25, 50, 75, 95, 99)
CONFIDENCE = 0.95


def percentiles(values: Array, percentages: Sequence[int]) -> dict[int, float]:
    """Return percentiles by percentage; each is one of the `values`, since infinite values cannot be interpolated."""
    return dict(zip(percentages, np.percentile(values, percentages, method="inverted_cdf").tolist(), strict=True))


@dataclass(frozen=True)
class Chance:
    """The number of samples that meet a requirement (None: all requirements); failed samples do not meet it."""

    requirement: Requirement | None
    met: int
    samples: int

    @property
    def share(self) -> float:
        """Share of the samples that meet the requirement."""
        return self.met / self.samples

    @property
    def interval(self) -> tuple[float, float]:
        """Two-sided 95 % confidence interval of the probability (Clopper and Pearson, 1934)."""
        low, high = stats.binomtest(self.met, self.samples).proportion_ci(CONFIDENCE, method="exact")
        return float(low), float(high)

    def __str__(self) -> str:
        low, high = self.interval
        if self.met == self.samples:
            return f"≥ {_percent(low, floor)}"
        if not self.met:
            return f"≤ {_percent(high, ceil)}"
        return f"{_percent(self.share, round)} ({_percent(low, floor)} … {_percent(high, ceil)})"


def _percent(share: float, to_integer: Callable[[float], int]) -> str:
    """Return a share as text in %, with two digits of its distance from 0 or 100 %, and at least one decimal."""
    digits = max(1, 2 - ceil(log10(100.0 * min(share, 1.0 - share) or 1.0)))
    return f"{to_integer(share * 100.0 * 10.0**digits) / 10.0**digits:.{digits}f} %"
