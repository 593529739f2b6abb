"""Draw the factors of samples. The values of a sample depend on its index and the campaign's seed only."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.stats import qmc

from ...simulation import Array
from .study import Study


class Sampler:
    """Draws the values of the factors by the indices of samples.

    - ``monte-carlo``: sample i has its own generator, seeded with (seed, i).
    - ``sobol``: point i of a scrambled sequence.
    - ``latin-hypercube``: row i of one hypercube for all samples, with eight bytes for each sample and factor.
    - ``grid``: the digits of i in mixed radix; the last factor changes fastest.
    """

    def __init__(self, study: Study) -> None:
        self._method, self._seed, self._factors = study.method, study.plan.seed, study.plan.factors
        self._samples = study.samples
        self._cube: Array | None = None
        if study.method == "latin-hypercube":
            self._cube = qmc.LatinHypercube(len(self._factors), rng=self._generator()).random(study.samples)

    def _generator(self, *more: int) -> np.random.Generator:
        return np.random.default_rng([self._seed, *more])

    def draw(self, indices: Sequence[int]) -> Array:
        """Return the values [indices, factors] in the factors' units. Raises IndexError outside the campaign."""
        if any(not 0 <= i < self._samples for i in indices):
            raise IndexError(f"samples are numbered from 0 to {self._samples - 1}")
        distributions = [f.distribution for f in self._factors]
        if self._method == "grid":
            where = np.unravel_index(np.asarray(indices), [len(d.levels) for d in distributions])
            return np.column_stack([np.asarray(d.levels, dtype=float)[k]
                                    for d, k in zip(distributions, where, strict=True)])
        shares = self._shares(indices)
        return np.column_stack([d.at(shares[:, k]) for k, d in enumerate(distributions)])

    def _shares(self, indices: Sequence[int]) -> Array:
        """Return numbers between 0 and 1 [indices, factors]."""
        if self._method == "sobol":
            return self._sobol(indices)
        if self._cube is None:
            return np.array([self._generator(i).random(len(self._factors)) for i in indices])
        chosen: Array = self._cube[np.asarray(indices)]
        return chosen

    def _sobol(self, indices: Sequence[int]) -> Array:
        """Return points in the order of `indices`; each is drawn once, in ascending order, as the engine requires."""
        engine = qmc.Sobol(len(self._factors), scramble=True, rng=self._generator())
        ordered, positions = np.unique(np.asarray(indices), return_inverse=True)
        points = np.empty((len(ordered), len(self._factors)))
        for row, index in zip(points, ordered.tolist(), strict=True):
            if index > engine.num_generated:
                engine.fast_forward(index - engine.num_generated)
            row[:] = engine.random(1)[0]
        # A scrambled point may contain 0, where a normal distribution is infinite.
        return np.clip(points, 2.0**-53, 1.0 - 2.0**-53)[positions]
