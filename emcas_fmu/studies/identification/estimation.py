"""Weighted least squares whose covariance accounts for unequal noise of records and residuals correlated in time.

A first fit gives each record's noise. Its residuals are weighted by that noise and by their autocorrelation time
tau = 1 + 2 sum rho_k, at least that of white noise: n samples are worth n/tau independent ones. Records of few
residuals share one tau, that of all of them, since each alone would be too uncertain. The sum ends at the first window
of five tau (Sokal 1997, "Monte Carlo methods in statistical mechanics", section 3). The covariance is
(sum J'J/(s^2 tau))^-1 with the records' residual variances s^2, degrees of freedom counted.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from .records import Array, RecordError, require

METHOD = ("weighted least squares; 1 sigma from the covariance scaled by each file's residuals and by their "
          "autocorrelation time")
_WINDOW = 5.0
_PASSES = 3
_DIFFERENCE = 6e-6  # cube root of the rounding error, best for central differences
_ENOUGH = 90  # residuals of a record whose autocorrelation time may be longer than that shared by small records
_ALONE = 500  # residuals of a record that does not need the shared time
_SINGULAR = 1e-10  # of the largest singular value: the accuracy of the Jacobian's differences
# Noise estimated from few residuals may be much too small: a record's is at least this share of the median.
_QUIETEST = 0.2


@dataclass(frozen=True)
class Fit:
    """Estimated `values`, the first of which have `names`, with their `covariance`; the `residuals` of each stretch.

    `owners` has the index of each stretch's record; `deviations` and correlation `times` [samples] are the records'.
    """

    names: Sequence[str]
    values: Array
    covariance: Array
    residuals: tuple[Array, ...]
    owners: Sequence[int]
    deviations: Array
    times: Array

    @property
    def sigmas(self) -> Array:
        """1-sigma uncertainties."""
        sigmas: Array = np.sqrt(np.diag(self.covariance))
        return sigmas

    @property
    def correlation(self) -> Array:
        """Correlation matrix of the estimates."""
        matrix: Array = self.covariance / np.outer(self.sigmas, self.sigmas)
        return matrix

    @property
    def counts(self) -> list[int]:
        """Number of residuals of each record."""
        lengths = [len(r) for r in self.residuals]
        return [int(count) for count in np.bincount(self.owners, lengths)]


def correlation_time(residuals: Sequence[Array]) -> float:
    """Return the integrated autocorrelation time [samples] of several stretches; 1 for white noise."""
    longest = max(len(r) for r in residuals)
    power = sum(float(r @ r) for r in residuals)
    if power == 0.0:
        return 1.0
    total = 1.0
    for lag in range(1, longest // 3):
        total += 2.0 * sum(float(r[:-lag] @ r[lag:]) for r in residuals if len(r) > lag) / power
        if lag >= _WINDOW * max(total, 0.2):
            break
    return max(total, 1.0)


def _jacobian(residuals: Callable[[Array], Array], x: Array) -> Array:
    """Return the Jacobian by central differences, for parameters of the order of one."""
    changes = np.diag(_DIFFERENCE * np.maximum(np.abs(x), 1.0))
    jacobian: Array = np.array([(residuals(x + change) - residuals(x - change)) / (2.0 * change.max())
                                for change in changes]).T
    return jacobian


def solve(residuals: Callable[[Array], Array], start: Array) -> tuple[Array, Array]:
    """Return the least-squares parameters by Levenberg and Marquardt (MINPACK), and the Jacobian there.

    Raises RecordError if the iteration leads to numbers that are not finite.
    """
    try:
        with np.errstate(over="ignore", invalid="ignore"):
            x = least_squares(residuals, start, jac=lambda x: _jacobian(residuals, x), method="lm", x_scale="jac",
                              xtol=1e-12, ftol=1e-12, gtol=1e-12, max_nfev=200).x
            return x, _jacobian(residuals, x)
    except (ValueError, ArithmeticError, np.linalg.LinAlgError) as error:
        raise RecordError(f"no parameters fit the records ({error}): check units and signs in the headers, and that "
                          "the columns belong together") from error


def _times(records: Sequence[Sequence[Array]], deviations: Array) -> Array:
    """Return each record's correlation time [samples]; small records share that of all small ones."""
    lengths = np.array([sum(map(len, stretches)) for stretches in records])
    times = np.array([correlation_time(stretches) for stretches in records])
    small = lengths < _ALONE
    if small.any():
        shared = correlation_time([r / (s or 1.0) for stretches, s, few in zip(records, deviations, small) if few
                                   for r in stretches])
        times = np.where(lengths < _ENOUGH, shared, np.where(small, np.maximum(times, shared), times))
    return times


def _deviations(records: Sequence[Sequence[Array]], leverages: Sequence[Sequence[Array]]) -> Array:
    """Return each record's noise: its residuals over its degrees of freedom, from the diagonal of the hat matrix.

    A record that alone determines a parameter bends the fit towards itself, and its residuals shrink.
    """
    powers = [sum(float(r @ r) for r in stretches) for stretches in records]
    freedom = [max(sum(float(np.sum(1.0 - h)) for h in stretches), 1.0) for stretches in leverages]
    deviations: Array = np.sqrt(np.array(powers) / np.array(freedom))
    return deviations


def weighted_fit(names: Sequence[str], residuals: Callable[[Array], Sequence[Array]], start: Array, scale: Array,
                 owners: Sequence[int], least_time: float = 1.0) -> Fit:
    """Minimise the stretches of residuals, a function of the parameters, the first of which have `names`.

    `scale` has each parameter's typical size. `owners` has the index of each stretch's record: a record's stretches
    have the same noise. `least_time` [samples] is the correlation time of the residuals of white noise.
    Raises RecordError if the parameters cannot be determined.
    """
    count = max(owners) + 1
    weights = np.ones(count)
    values = start / scale

    def weighted(x: Array) -> Array:
        return np.concatenate([r * weights[owner] for r, owner in zip(residuals(x * scale), owners, strict=True)])

    def by_record(stretches: Sequence[Array]) -> list[list[Array]]:
        return [[each for each, owner in zip(stretches, owners, strict=True) if owner == k] for k in range(count)]

    for _ in range(_PASSES):
        values, jacobian = solve(weighted, values)
        stretches = residuals(values * scale)
        leverages = np.split(np.sum(np.linalg.qr(jacobian)[0] ** 2, axis=1),
                             np.cumsum([len(r) for r in stretches])[:-1])
        deviations = _deviations(by_record(stretches), by_record(leverages))
        times = np.maximum(_times(by_record(stretches), deviations), least_time)
        least = _QUIETEST * float(np.median(deviations)) or 1.0
        weights = 1.0 / (np.maximum(deviations, least) * np.sqrt(times))
    jacobian = _jacobian(weighted, values)  # with the final weights
    # By singular values: the normal equations would square the condition number of a sixth-order polynomial.
    _, singular, rows = np.linalg.svd(jacobian, full_matrices=False)
    require(singular.min() > _SINGULAR * singular.max(), "the records leave some combination of the parameters "
            "undetermined: they are too alike, or what they excite is too little; vary speeds, levels and range more")
    inverse = rows.T / singular
    covariance = (inverse @ inverse.T) * np.outer(scale, scale)
    return Fit(names, values * scale, covariance, tuple(stretches), owners, deviations, times)
