"""Least squares with an honest covariance: groups of unequal noise, residuals correlated in time.

Each group of residuals (a file) is weighted by its own noise, found from a first fit, and by the
autocorrelation time tau = 1 + 2 sum rho_k of its residuals, never below that of white noise: n samples are worth n/tau
independent ones. Groups of few residuals share one tau, of all of them: alone they would show it by
chance. The sum ends at the first window of five tau (Sokal 1997, "Monte Carlo methods in statistical
mechanics", section 3). The covariance is (sum J'J/(s^2 tau))^-1 with s^2 the groups' residual
variances, degrees of freedom counted.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from .records import Array, RecordError

METHOD = ("weighted least squares; 1 sigma from the covariance scaled by each file's residuals and by their "
          "autocorrelation time")
_WINDOW = 5.0
_PASSES = 3
_DIFFERENCE = 6e-6  # the cube root of rounding, best for central differences
_ENOUGH = 90  # residuals of a group that can show a longer autocorrelation time than the small groups share
_ALONE = 500  # and of one that shows its own time, shorter or longer
_SINGULAR = 1e-10  # of the largest singular value: the differences of the Jacobian are no better
# A group's noise is estimated from few residuals: none is trusted to be much quieter than the typical one.
_QUIETEST = 0.2


@dataclass(frozen=True)
class Fit:
    """`values`, the first of which have `names`, and their `covariance`; the `residuals` of each stretch.

    `groups` lists the stretches of each group; `deviations` and correlation `times` [samples] are the groups'.
    """

    names: Sequence[str]
    values: Array
    covariance: Array
    residuals: tuple[Array, ...]
    groups: Sequence[Sequence[int]]
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


def correlation_time(residuals: Sequence[Array]) -> float:
    """Return the integrated autocorrelation time, in samples, pooled over stretches; 1 for white noise."""
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
    """Return central differences of residuals whose parameters are of the order of one."""
    changes = np.diag(_DIFFERENCE * np.maximum(np.abs(x), 1.0))
    jacobian: Array = np.array([(residuals(x + change) - residuals(x - change)) / (2.0 * change.max())
                                for change in changes]).T
    return jacobian


def solve(residuals: Callable[[Array], Array], start: Array) -> tuple[Array, Array]:
    """Return the least-squares parameters by Levenberg and Marquardt (MINPACK), and the Jacobian there.

    Raises RecordError where it comes to numbers that are not finite.
    """
    try:
        with np.errstate(over="ignore", invalid="ignore"):
            x = least_squares(residuals, start, jac=lambda x: _jacobian(residuals, x), method="lm", x_scale="jac",
                              xtol=1e-12, ftol=1e-12, gtol=1e-12, max_nfev=200).x
            return x, _jacobian(residuals, x)
    except (ValueError, ArithmeticError, np.linalg.LinAlgError) as error:
        raise RecordError(f"no parameters fit the records ({error}): check units and signs in the headers, and that "
                          "the columns belong together") from error


def _times(groups: Sequence[Sequence[Array]], deviations: Array) -> Array:
    """Return each group's correlation time [samples], that of small groups from all of them."""
    lengths = np.array([sum(map(len, stretches)) for stretches in groups])
    times = np.array([correlation_time(stretches) for stretches in groups])
    small = lengths < _ALONE
    if small.any():
        shared = correlation_time([r / (s or 1.0) for stretches, s, few in zip(groups, deviations, small) if few
                                   for r in stretches])
        times = np.where(lengths < _ENOUGH, shared, np.where(small, np.maximum(times, shared), times))
    return times


def _deviations(stretches: Sequence[Array], groups: Sequence[Sequence[int]], jacobian: Array) -> Array:
    """Return each group's noise: its residuals over its own degrees of freedom, what the hat matrix leaves of it.

    A group that alone decides a parameter bends the fit towards itself, and its residuals shrink.
    """
    leverage = np.split(np.sum(np.linalg.qr(jacobian)[0] ** 2, axis=1), np.cumsum([len(r) for r in stretches])[:-1])
    powers = [sum(float(stretches[i] @ stretches[i]) for i in members) for members in groups]
    freedom = [max(sum(float(np.sum(1.0 - leverage[i])) for i in members), 1.0) for members in groups]
    deviations: Array = np.sqrt(np.array(powers) / np.array(freedom))
    return deviations


def weighted_fit(names: Sequence[str], residuals: Callable[[Array], Sequence[Array]], start: Array, scale: Array,
                 groups: Sequence[Sequence[int]], least_time: float = 1.0) -> Fit:
    """Minimise the residual stretches that `residuals` gives for a parameter vector, the first of them with `names`.

    `scale` has each parameter's typical size. `groups` lists, for each group of common noise, the
    indices of its stretches. `least_time` is the correlation time the residuals have of white noise.
    """
    weights = np.ones(len(groups))
    values = start / scale
    group = {index: g for g, members in enumerate(groups) for index in members}

    def weighted(x: Array) -> Array:
        return np.concatenate([r * weights[group[i]] for i, r in enumerate(residuals(x * scale))])

    for _ in range(_PASSES):
        values, jacobian = solve(weighted, values)
        stretches = residuals(values * scale)
        deviations = _deviations(stretches, groups, jacobian)
        times = np.maximum(_times([[stretches[i] for i in members] for members in groups], deviations), least_time)
        least = _QUIETEST * float(np.median(deviations)) or 1.0
        weights = 1.0 / (np.maximum(deviations, least) * np.sqrt(times))
    jacobian = _jacobian(weighted, values)  # with the weights last found
    # By singular values: the normal equations would square the conditioning of a sixth-order polynomial.
    _, singular, rows = np.linalg.svd(jacobian, full_matrices=False)
    if not singular.min() > _SINGULAR * singular.max():
        raise RecordError("the records leave some combination of the parameters undetermined: they are too alike, or "
                          "what they excite is too little; vary speeds, levels and range more")
    inverse = rows.T / singular
    covariance = (inverse @ inverse.T) * np.outer(scale, scale)
    return Fit(names, values * scale, covariance, tuple(stretches), groups, deviations, times)
