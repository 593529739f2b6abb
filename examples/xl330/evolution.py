"""Minimisation of a rough function of about ten numbers by the CMA evolution strategy, which SciPy does not have.

Source: Hansen, "The CMA evolution strategy: a tutorial" (2016), with its constants, without active weights.
"""

from __future__ import annotations

from collections.abc import Callable
from math import sqrt

import numpy as np

from .records import Array


def minimised(cost: Callable[[Array], Array], start: Array, spread: float, farthest: float, generations: int,
              samples: int, seed: int, report: Callable[[int, float], None] = lambda *_: None) -> Array:
    """Return the mean [parameters] of the points' distribution at the end of a search that begins around `start`.

    `cost` maps points [parameters, points] to their costs. `spread` is the first standard deviation; points are clipped
    to +-`farthest`. The mean is preferred to the best point, whose low cost is partly due to the roughness. `report` is
    called with the generation's number and its smallest cost.
    """
    n, rng = len(start), np.random.default_rng(seed)
    half = samples // 2
    mean: Array = start.copy()
    weights = np.log(half + 0.5) - np.log(np.arange(1, half + 1))
    weights /= weights.sum()
    effective = 1.0 / float(np.sum(weights**2))
    c_path, c_step = (4 + effective / n) / (n + 4 + 2 * effective / n), (effective + 2) / (n + effective + 5)
    c_one = 2 / ((n + 1.3) ** 2 + effective)
    c_half = min(1 - c_one, 2 * (effective - 2 + 1 / effective) / ((n + 2) ** 2 + effective))
    damping = 1 + 2 * max(0.0, sqrt((effective - 1) / (n + 1)) - 1) + c_step
    usual = sqrt(n) * (1 - 1 / (4 * n) + 1 / (21 * n**2))  # length of a vector of n normal numbers
    covariance, path, step_path = np.eye(n), np.zeros(n), np.zeros(n)
    for generation in range(1, generations + 1):
        squares, axes = np.linalg.eigh(covariance)
        sizes = np.sqrt(np.maximum(squares, 1e-12))
        points = np.clip(mean + spread * (rng.normal(size=(samples, n)) * sizes) @ axes.T, -farthest, farthest)
        costs = cost(points.T)
        best = (points[np.argsort(costs)[:half]] - mean) / spread
        change = weights @ best
        mean = mean + spread * change
        step_path = ((1 - c_step) * step_path
                     + sqrt(c_step * (2 - c_step) * effective) * axes @ (axes.T @ change / sizes))
        length = float(np.linalg.norm(step_path)) / usual
        short = length / sqrt(1 - (1 - c_step) ** (2 * generation)) < 1.4 + 2 / (n + 1)
        path = (1 - c_path) * path + short * sqrt(c_path * (2 - c_path) * effective) * change
        covariance = ((1 - c_one - c_half) * covariance + c_one * np.outer(path, path)
                      + c_half * (best.T * weights) @ best)
        spread *= float(np.exp(c_step / damping * (length - 1)))
        report(generation, float(costs.min()))
    return mean
