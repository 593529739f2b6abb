"""Which requirements pull against each other, and what one costs the other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

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
    """Points that no other is at least as good as in both coordinates; small is good."""
    best: list[tuple[float, float]] = []
    for x, y in sorted(set(points)):
        if not best or y < best[-1][1]:
            best.append((x, y))
    return tuple(best)


def shares(evaluations: Sequence[Evaluation], first: str, second: str) -> list[tuple[float, float]]:
    """Worst shares of two requirements in each evaluation."""
    return [(e.by_requirement()[first].share, e.by_requirement()[second].share) for e in evaluations]


def conflict(evaluations: Sequence[Evaluation], pair: tuple[str, str] | None = None) -> Conflict | None:
    """The pair asked for, or the two that pull most against each other near the best; None if none do."""
    if not evaluations:
        return None
    best = min(e.objective for e in evaluations)
    near = [e for e in evaluations if e.objective <= _NEAR * best]
    names = list(near[0].by_requirement())
    table = np.array([[e.by_requirement()[name].share for name in names] for e in near])
    # What hardly moves or cannot be had says nothing of a conflict.
    lively = [i for i in range(len(names)) if np.ptp(table[:, i]) > 0.02 and table[:, i].max() < HOPELESS]
    found: tuple[float, str, str] | None = None
    for i, j in combinations(lively, 2):
        correlation = float(spearmanr(table[:, i], table[:, j]).statistic)
        if pair is None and (found is None or correlation < found[0]):
            found = correlation, names[i], names[j]
    if pair is not None:
        i, j = names.index(pair[0]), names.index(pair[1])
        moving = min(np.ptp(table[:, i]), np.ptp(table[:, j])) > 0.0
        found = (float(spearmanr(table[:, i], table[:, j]).statistic) if moving else 0.0, *pair)
    if found is None or (pair is None and found[0] > -0.3):
        return None
    correlation, first, second = found
    return Conflict(first, second, correlation, front(shares(evaluations, first, second)))
