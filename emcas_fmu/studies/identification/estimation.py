"""Weighted least squares whose covariance accounts for unequal noise of records and residuals correlated in time.

A first fit gives each record's noise s. The next fit weights the record's residuals by 1/(s sqrt(tau)). Their
autocorrelation time is tau = 1 + 2 sum rho_k, at least that of white noise: n samples are worth n/tau independent ones.
The sum ends at the first lag of at least five tau (Sokal 1997, "Monte Carlo methods in statistical mechanics", section
3). Records with few residuals share one tau, as that of one record is too uncertain. The covariance is (sum J'J/(s^2
tau))^-1 with the records' residual variances s^2, corrected for degrees of freedom. If residuals are simultaneous, as
those of several outputs of an actuator, the covariance includes the correlation of their sums over five tau by the
sandwich formula (White 1980): outputs that show the same signal count once. The covariance of a robust fit is Huber's
(1981, section 7.6), with the mean square and the mean slope of the influence function of r/s.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from scipy.optimize import least_squares, lsq_linear
from scipy.stats import median_abs_deviation

from .records import Array, RecordError, require

METHOD = ("weighted least squares; 1 sigma from the covariance scaled by each file's residuals and by their "
          "autocorrelation time")
Stretches = Sequence[Array]  # residuals, an array for each stretch of successive samples
_WINDOW = 5.0  # multiple of tau at which its sum ends, and over which simultaneous residuals are summed
_PASSES = 3  # fits, each with the weights from the residuals of the last one
_SUMS = 20  # smallest number of sums of residuals from which a correlation is estimated
_DIFFERENCE = 6e-6  # relative step of central differences: the cube root of the rounding error is best
# The same for simulations, which round delays by up to a thousandth of a sample: for a smooth function, and the largest
# for a rough function, whose change must exceed its roughness.
_SMOOTH_DIFFERENCE, _ROUGH_DIFFERENCE = 3e-3, 3e-2
# For `descend`: longest relative step; number of last points and steps that are averaged for a rough function; mean
# step [sigma] below which the iteration ends; most trials of a step, each half as long as the last; ratio of the sum of
# squares to the lowest one below which a trial is accepted, more than the effect of roughness.
_LONGEST, _LAST, SETTLED, _HALVINGS, _WORSE = 0.3, 4, 0.2, 6, 1.1
_ROUNDING = 1e-9  # smallest relative sigma of a parameter: records without noise leave no residuals
_SIGMAS = 10.0  # step of differences [sigma]: roughness as large as the noise then changes slopes by a twentieth
_ENOUGH = 90  # residuals from which a small record has its own correlation time if it is longer than the shared time
_ALONE = 500  # residuals from which a record is not small and has its own time
_SINGULAR = 1e-10  # smallest relative singular value: the accuracy of the Jacobian's differences
_QUIETEST = 0.2  # smallest noise of a record relative to the median, since few residuals may give far too little


@dataclass(frozen=True)
class Fit:
    """Estimated `values`, the first of which have `names`, with their `covariance`; the `residuals` of each stretch.

    `owners` has the index of each stretch's record. Of each record, `deviations` has the standard deviation of the
    residuals, `times` their correlation time [samples].
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
        """1-sigma uncertainties of the values."""
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
        return [int(count) for count in np.bincount(self.owners, [len(r) for r in self.residuals])]


def correlation_time(residuals: Sequence[Array]) -> float:
    """Return the autocorrelation time [samples] of all stretches of residuals, at least that of white noise, 1."""
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


def each(residuals: Callable[[Array], Stretches]) -> Callable[[Array], list[Stretches]]:
    """Return a function of several points [points, parameters] from a function that returns residuals at one point."""
    return lambda points: [residuals(point) for point in points]


def _jacobian(residuals: Callable[[Array], Array], x: Array, difference: Array | float) -> Array:
    """Return the Jacobian [residuals, parameters] by central differences of `difference` times max(|x|, 1)."""
    changes = np.diag(difference * np.maximum(np.abs(x), 1.0))
    after, before = np.split(residuals(np.concatenate([x + changes, x - changes])), 2)
    jacobian: Array = ((after - before) / (2.0 * changes.max(axis=1))[:, None]).T
    return jacobian


def solve(residuals: Callable[[Array], Array], start: Array, **options: Any) -> tuple[Array, Array]:
    """Return the least-squares parameters, of the order of one, and the Jacobian at them [residuals, parameters].

    `residuals` maps points [points, parameters] to residuals [points, residuals]; it is called with all points of the
    central differences at once. `options` are those of SciPy's least_squares, by default Levenberg and Marquardt's
    method (MINPACK). Raises RecordError if the iteration leads to numbers that are not finite.
    """
    slopes = partial(_jacobian, residuals, difference=_DIFFERENCE)
    try:
        with np.errstate(over="ignore", invalid="ignore"):
            x = least_squares(lambda x: residuals(x[None])[0], start, jac=slopes, x_scale="jac", **{
                "method": "lm", "max_nfev": 200, "xtol": 1e-12, "ftol": 1e-12, "gtol": 1e-12, **options}).x
            return x, slopes(x)
    except (ValueError, ArithmeticError, np.linalg.LinAlgError) as error:
        raise RecordError(f"no parameters fit the records ({error}): check units and signs in the headers, and that "
                          "the columns belong together") from error


def descend(residuals: Callable[[Array], Array], start: Array, bounds: tuple[Array, Array], steps: int,
            smooth: Callable[[Array], Array] | None = None, ratios: Array | float = 0.0) -> tuple[Array, Array, Array]:
    """Return least-squares parameters by Gauss-Newton steps, a Jacobian near them, and the last step's size [sigma].

    If residuals are a rough function of the parameters, their sum of squares has many minima, and their differences are
    noise; `smooth` is then a smooth function with nearly the same derivatives. With these derivatives Z as instruments,
    the steps lead to Z'r = 0. Roughness of a share of the noise moves this point by that share of 1 sigma. The Jacobian
    is that of the residuals, projected on Z; the covariance is that of instrumental variables (Soderstrom and Stoica
    1983, section 4). A step that leads to more than 1.1 times the lowest sum of squares is halved, up to five times.
    After `steps` steps, or when steps are short, the result is the last point and step; of a rough function, the mean
    of the last four. `ratios` convert `residuals` to multiples of their noise; where they are not 0, large residuals
    count in proportion to their size, as in soft L1 (Triggs et al. 2000, section 4). Other arguments are those of
    `solve`.
    """
    def weight_root(r: Array) -> Array:
        root: Array = (1.0 + (ratios * r) ** 2) ** -0.25
        return root

    x, r, reached, changes, last = start, residuals(start[None])[0], [start], [], _LAST if smooth else 1
    lowest, difference = np.inf, np.full(len(x), _ROUGH_DIFFERENCE)
    while True:
        root = weight_root(r)
        lowest = min(lowest, float(np.sum((root * r) ** 2)))
        jacobian = _jacobian(smooth or residuals, x, _SMOOTH_DIFFERENCE) * root[:, None]
        if smooth:
            instruments = np.linalg.qr(jacobian)[0]
            jacobian = instruments @ (instruments.T @ (_jacobian(residuals, x, difference) * root[:, None]))
        noise = np.sqrt(np.mean((root * r) ** 2))
        sigma = np.linalg.norm(np.linalg.pinv(jacobian), axis=1) * noise + _ROUNDING * np.maximum(np.abs(x), 1.0)
        change = lsq_linear(jacobian, -r * root, (bounds[0] - x, bounds[1] - x)).x
        changes.append(change)
        left = np.abs(np.mean(changes[-last:], axis=0)) / sigma
        if len(changes) > steps or (len(changes) > last and np.all(left < SETTLED)):
            return np.mean(reached[-last:], axis=0), jacobian / root[:, None], left
        change = change / max(1.0, float(np.abs(change / np.maximum(np.abs(x), 1.0)).max()) / _LONGEST)
        for share in 0.5 ** np.arange(_HALVINGS):
            to = np.clip(x + share * change, *bounds)
            r = residuals(to[None])[0]
            if np.sum((weight_root(r) * r) ** 2) < _WORSE * lowest:
                break
        x = to
        reached.append(x)
        difference = np.clip(_SIGMAS * sigma / np.maximum(np.abs(x), 1.0), _SMOOTH_DIFFERENCE, _ROUGH_DIFFERENCE)


def _times(records: Sequence[Sequence[Array]], deviations: Array) -> Array:
    """Return each record's correlation time [samples]; small records use at least that of all small records."""
    lengths = np.array([sum(map(len, stretches)) for stretches in records])
    times = np.array([correlation_time(stretches) for stretches in records])
    small = lengths < _ALONE
    if small.any():
        shared = correlation_time([r / (s or 1.0) for stretches, s, few in zip(records, deviations, small) if few
                                   for r in stretches])
        times = np.where(lengths < _ENOUGH, shared, np.where(small, np.maximum(times, shared), times))
    return times


def _common(influences: Array, time: float) -> Array:
    """Return the correlation matrix of simultaneous residuals [outputs, rows], summed over five times `time` [rows].

    With fewer than 20 sums, they are over fewer rows. Sums also show the correlation of outputs with different delays.
    """
    samples = max(min(round(_WINDOW * time), influences.shape[1] // _SUMS), 1)
    rows = influences.shape[1] // samples * samples
    sums = influences[:, :rows].reshape(len(influences), -1, samples).sum(axis=2)
    norms = np.linalg.norm(sums, axis=1)
    correlation: Array = sums @ sums.T / np.outer(norms, norms).clip(np.finfo(float).tiny)
    np.fill_diagonal(correlation, 1.0)
    return correlation


def weighted_fit(names: Sequence[str], residuals: Callable[[Array], Sequence[Stretches]], start: Array, scale: Array,
                 owners: Sequence[int], least_time: float = 1.0, prior: tuple[Array, Array] | None = None,
                 minimise: Callable[..., tuple[Array, Array]] = solve, robust: bool = False,
                 smooth: Callable[[Array], Sequence[Stretches]] | None = None, together: Sequence[int] = ()) -> Fit:
    """Fit parameters, the first of which have `names`, to stretches of residuals by weighted least squares.

    `residuals` maps points [points, parameters] to the stretches at each point. `scale` has each parameter's typical
    size. `owners` has the index of each stretch's record: a record's stretches have the same noise. `least_time`
    [samples] is the correlation time that white noise gives the residuals, the smallest that is used. A `prior` has
    each parameter's mean and finite 1 sigma. `minimise` has the arguments and result of `solve`. The noise follows from
    the rms residual. With `robust` it follows from the median absolute deviation, and large residuals are weighted as
    in `descend`; for `smooth` see there. Stretches with the same number in `together`, with different owners, are
    simultaneous and may have common noise, as outputs of one actuator. Raises RecordError if the parameters cannot be
    determined.
    """
    count, values = max(owners) + 1, start / scale
    weights, times = np.ones(count), np.ones(count)
    mean, sigma = prior or (start, np.full(len(start), np.inf))
    lengths = [len(r) for r in residuals(values[None] * scale)[0]]
    ends, record_of = np.cumsum(lengths), np.repeat(owners, lengths)

    def weighted(points: Array, by: Callable[[Array], Sequence[Stretches]] = residuals) -> Array:
        return np.array([np.append(np.concatenate(stretches) * weights[record_of], (point * scale - mean) / sigma)
                         for point, stretches in zip(points, by(points * scale), strict=True)])

    def by_record(stretches: Stretches) -> list[list[Array]]:
        return [[each for each, owner in zip(stretches, owners, strict=True) if owner == k] for k in range(count)]

    options: dict[str, Any] = {"smooth": partial(weighted, by=smooth)} if smooth else {}
    for _ in range(_PASSES):
        if robust:
            options["ratios"] = np.append(np.sqrt(times)[record_of], np.zeros(len(start)))
        values, jacobian = minimise(weighted, values, **options)
        stretches = residuals(values[None] * scale)[0]
        if robust:
            deviations = np.array([median_abs_deviation(np.concatenate(of_one), scale="normal")
                                   for of_one in by_record(stretches)])
        else:
            # Degrees of freedom from the diagonal of the hat matrix: a record that alone determines a parameter pulls
            # the fit towards itself, and its residuals shrink.
            free = np.split(1.0 - np.sum(np.linalg.qr(jacobian)[0] ** 2, axis=1), ends)[:-1]
            power, freedom = (np.bincount(owners, each) for each in ([r @ r for r in stretches], [*map(np.sum, free)]))
            deviations = np.sqrt(power / np.maximum(freedom, 1.0))
        smallest = _QUIETEST * float(np.median(deviations)) or 1.0
        noise = np.maximum(deviations, smallest)
        influences, slopes = [r / noise[k] for r, k in zip(stretches, owners, strict=True)], np.ones(count)
        if robust:
            slopes = np.array([np.mean((1.0 + np.concatenate(z) ** 2) ** -1.5) for z in by_record(influences)])
            influences = [z / np.sqrt(1.0 + z**2) for z in influences]
        times = np.maximum(_times(by_record(influences), np.ones(count)) if robust else
                           _times(by_record(stretches), deviations), least_time)
        fitted_with, weights = weights, 1.0 / (noise * np.sqrt(times))
    # The Jacobian gets the final weights, and the mean slopes of the influences.
    jacobian[:len(record_of)] *= (weights / fitted_with * np.sqrt(slopes))[record_of, None]
    # Singular values, since the normal equations would square the condition number of a sixth-order polynomial.
    left, singular, rows = np.linalg.svd(jacobian, full_matrices=False)
    require(prior or singular.min() > _SINGULAR * singular.max(), "the records leave a combination of "
            "parameters undetermined: they are too alike, or excite too little; vary speeds, levels and range more")
    inverse = rows.T / singular
    covariance = inverse @ inverse.T
    parts = np.split(inverse @ left.T, ends, axis=1)
    for group in set(together):
        members = [k for k, each in enumerate(together) if each == group]
        sizes = np.sqrt([np.mean(influences[k] ** 2) / slopes[owners[k]] if robust else 1.0 for k in members])
        common = _common(np.array([influences[k] for k in members]), max(times[owners[k]] for k in members))
        excess = common * np.outer(sizes, sizes) - np.eye(len(members))
        of_group = np.array([parts[k] for k in members])
        covariance += np.einsum("cpt,cd,dqt->pq", of_group, excess, of_group, optimize=True)
    return Fit(names, values * scale, covariance * np.outer(scale, scale), tuple(stretches), owners, deviations, times)
