"""Which requirements pull against each other, and what one costs the other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np
from scipy.stats import spearmanr

from .evaluate import HOPELESS, Evaluation

# Evaluations this close to the best objective are what a choice is made among.
_NEAR = 1.6


@dataclass(frozen=True)
class Conflict:
    """Two requirements and the evaluations none of which is better in both: (share, share), the first rising."""

    first: str
    second: str
    correlation: float
    front: tuple[tuple[float, float], ...]


def front(points: Sequence[tuple[float, float]]) -> tuple[tuple[float, float], ...]:
    """Return the points that no other is at least as good as in both coordinates; small is good."""
    best: list[tuple[float, float]] = []
    for x, y in sorted(set(points)):
        if not best or y < best[-1][1]:
            best.append((x, y))
    return tuple(best)


def shares(evaluations: Sequence[Evaluation], first: str, second: str) -> list[tuple[float, float]]:
    """Return the worst shares of two requirements in each evaluation."""
    return [(e.by_requirement()[first].share, e.by_requirement()[second].share) for e in evaluations]


def conflict(evaluations: Sequence[Evaluation], pair: tuple[str, str] | None = None) -> Conflict | None:
    """Return a pair of requirements, or the two that pull most against each other near the best; None if none do."""
    if not evaluations:
        return None
    best = min(e.objective for e in evaluations)
    near = [e.by_requirement() for e in evaluations if e.objective <= _NEAR * best]
    columns = {name: np.array([judgements[name].share for judgements in near]) for name in near[0]}
    # What hardly moves or cannot be had says nothing of a conflict.
    lively = [name for name, column in columns.items() if np.ptp(column) > 0.02 and column.max() < HOPELESS]
    rated = [(_correlation(columns[first], columns[second]), first, second)
             for first, second in ([pair] if pair else combinations(lively, 2))]
    correlation, first, second = min(rated, key=lambda entry: entry[0], default=(0.0, "", ""))
    if not pair and correlation > -0.3:
        return None
    return Conflict(first, second, correlation, front(shares(evaluations, first, second)))


def _correlation(first: Any, second: Any) -> float:
    """Return the rank correlation of two columns; 0 where one does not move."""
    return float(spearmanr(first, second).statistic) if min(np.ptp(first), np.ptp(second)) > 0.0 else 0.0
