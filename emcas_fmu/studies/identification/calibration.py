"""Calibration: fit parameters of any actuator so that its simulation follows recorded outputs.

A record's inputs drive the simulation, and its outputs are compared. The unknowns are the free parameters, the initial
fin angle of each fitted record if fin angles are compared and, on request, the delay of each measured output.

Quantisation of measured angles makes the response a rough function of the parameters, and the error has many minima.
The fit therefore compares the mean response from several close initial angles, which is less rough. It ends where the
error is orthogonal to the derivatives of the response without quantisation. At the true parameters the error, which is
then noise only, meets this condition on average.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import groupby
from math import inf, sqrt
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import qmc

from ...parameters import MeasuredRecord, ParameterSet
from ...plotting.plots import Drawing, column, legend, time_axis
from ...support.progress import Progress, silent
from . import pictures
from .estimation import SETTLED, Fit, Stretches, descend, solve, weighted_fit
from .records import Array, RecordFile, longest, require
from .replay import Replay as Replay
from .replay import ReplayedOutput, columns_used, misspelt, read
from .result import Estimate, Identification, IdentificationExperiment
from .unknowns import Unknown, free_parameters

METHOD = ("simulation error over all records, weighted by the noise of each output; 1 sigma from the covariance scaled "
          "by the residuals, by their autocorrelation time and by their correlation among outputs")
_CANDIDATES, _TRIED = 64, 3  # number of simulated starting points, and of those from which a fit starts
_EVALUATIONS, _STEPS = 30, 24  # most evaluations in each of these fits; most Gauss-Newton steps in a pass of the last
_MEAN = 10  # samples that are averaged in the first fits: a controller that reacts at every sample causes many minima
_FAINT = 1e-6  # weight of the prior in the fits from starting points, which only need to end near the result
_OPPOSITE = -0.5  # correlation of measured and simulated values, below which a sign is wrong
_STILL = 1e-3  # ratio of simulated to measured deviation, below which an input is missing
_WIDE, _RATIO = 30.0, 5.0  # largest plausible ratio of measured to simulated deviation: before and after the first fits
_FLAT, _BEYOND = 6, 3.0  # clipping: successive samples at the extreme; sigmas by which the simulation exceeds them
_POOR = 0.05  # largest share of a measured deviation that a good model leaves in addition to noise
_DRIFT, _CERTAIN = 5e-4, 6.0  # smallest clock drift that is reported: relative, and in sigmas
# A combination of parameters is undetermined if more than this share of the prior's variance remains; the message names
# the parameters whose effect exceeds this share of the largest effect.
_OPEN, _PART = 0.5, 0.3
_CONTRADICTED = 4.0  # distance from a prior [sigma] that is a contradiction; by chance, one of 16,000 priors exceeds it
_AT_BOUND = 1e-3  # distance to a bound that counts as at the bound: share of the interval between the bounds


@dataclass(frozen=True)
class Calibration(Identification):
    """The result of a calibration.

    `calibrated` is the base set with the estimates. `comparisons` has each compared output of each record.
    `undetermined` lists combinations of parameters that the records do not determine, `at_bound` the parameters at a
    bound. `stopped` says that Ctrl-C ended the fit. `faults` are messages on the fit, the priors and the records, one
    line each.
    """

    calibrated: ParameterSet
    comparisons: Sequence[ReplayedOutput]
    undetermined: Sequence[tuple[str, ...]]
    at_bound: Sequence[str]
    stopped: bool
    faults: Sequence[str]
    method = METHOD
    template = "studies/identification/calibration.html.j2"

    @property
    def problems(self) -> list[str]:
        """Messages, one line each: an early end, undetermined parameters, parameters at bounds, and the `faults`."""
        lines = ["stopped before the end of the fit: these are the best values so far"] if self.stopped else []
        for names in self.undetermined:
            unknown = names[0] if len(names) == 1 else f"a combination of {', '.join(names)}"
            lines.append(f"not determined: the records say little more about {unknown} than the prior does; do not "
                         f"free {'it' if len(names) == 1 else 'all of them'}, give a prior, or excite more")
        lines += [f"{name} is at a bound: the best value may be beyond; give wider bounds, or look for a missing effect"
                  for name in self.at_bound]
        return [*lines, *self.faults]

    @property
    def used(self) -> list[tuple[RecordFile, str]]:
        """The records, each with its use: fitted or held out."""
        return list({c.record.sha256: (c.record, c.use) for c in self.comparisons}.values())

    @property
    def noise(self) -> list[dict[str, Any]]:
        """Standard deviation, number and correlation time [samples] of residuals, by output and fitted record."""
        fitted = [c for c in self.comparisons if not c.held_out]
        return [{"file": c.record.name, "output": c.variable.name, "residual": float(deviation),
                 "unit": c.variable.unit, "residuals": count, "correlation_time": float(time)}
                for c, deviation, count, time in zip(fitted, self.fit.deviations, self.fit.counts, self.fit.times,
                                                     strict=True)]

    @property
    def measured(self) -> list[MeasuredRecord]:
        """The records with their use and the error of each simulated output, for comments in a parameter file."""
        return [MeasuredRecord("", record.name, record.sha256, "; ".join([use, *(
            f"{c.variable.name} rms {c.figures['rms']:.3g} {c.unit}, largest {c.figures['largest']:.3g} {c.unit}"
            for c in self.comparisons if c.record.sha256 == record.sha256)])) for record, use in self.used]

    def document(self) -> Mapping[str, Any]:
        """Return the result for JSON, without the plots."""
        return {**super().document(), "undetermined": self.undetermined, "at_bound": self.at_bound,
                "stopped": self.stopped, "problems": self.problems,
                "comparisons": [{"file": c.record.name, "sha256": c.record.sha256, "held_out": c.held_out,
                                 "output": c.variable.name, "unit": c.unit, **c.figures} for c in self.comparisons]}


def calibrate(paths: Sequence[Path], base: ParameterSet, free: Sequence[str], hold_out: Sequence[Path] = (),
              compare: Sequence[str] = (), priors: Sequence[str] = (), delays: bool = False, robust: bool = False,
              seed: int = 1, progress: Progress = silent) -> Calibration:
    """Fit parameters of an actuator to records, and judge them by the records in `hold_out`.

    A file in `paths` that is also in `hold_out` is not fitted. A record is a CSV file with ``time`` and columns of the
    actuator's inputs and outputs, with their units; `compare` chooses among the outputs. For the texts `free` and
    `priors` see :func:`.unknowns.free_parameters`. With `delays` the delay of each measured output is fitted. With
    `robust` large errors, as from stick and slip, count in proportion to their size instead of its square (soft L1).
    Fits start at the base set and at the two best of 63 random points between the bounds (`seed`); the best result is
    refined. Ctrl-C ends the fit at the best point so far. Raises RecordError for a record that cannot be used,
    EmcasError for other invalid arguments.
    """
    unknown = free_parameters(base, free, priors)
    apart = {path.resolve() for path in hold_out}
    fitted = [path for path in paths if path.resolve() not in apart]
    require(fitted or not paths, f"{paths[0] if paths else ''}: is held out, and there is no other record to fit")
    records, outputs = read(fitted, base, compare)
    others = read(hold_out, base, [v.name for v in outputs])[0] if hold_out else []
    for record in others:
        require(record.sha256 not in {r.sha256 for r in records}, f"{record.path}: has the contents of a record that "
                "is fitted; hold out a different record")
    replay = Replay(base, unknown, records, outputs, delays)
    _require_plausible(replay, replay.residuals(np.array([[u.start for u in replay.unknowns]]))[0], _WIDE)
    search = _Search(replay, seed, progress)
    near = replay.residuals(search.best[None])[0]
    _require_plausible(replay, near, _RATIO)
    fit = search.fit(near, robust)
    estimates = [Estimate(u.name, float(x), float(s), u.unit, float(base.values[u.name]) if u in unknown else None,
                          u in unknown) for u, x, s in zip(replay.unknowns, fit.values, fit.sigmas, strict=True)]
    units = {v.name: v.unit for v in base.actuator.parameters}
    estimates += [replace(e, name=u.follower, unit=units[u.follower]) for u, e in zip(unknown, estimates) if u.follower]
    calibrated = base.with_values({e.name: e.value for e in estimates if e.parameter})
    comparisons = list(replay.comparisons(fit.values, others))
    at_bound = [u.name for u, x in zip(unknown, fit.values)
                if min(x - u.lower, u.upper - x) < _AT_BOUND * (u.upper - u.lower)]
    notes = [*columns_used([*records, *others], base, outputs), _correlation(fit.times, comparisons)]
    faults = [*search.unsettled(), *_contradicted(fit, unknown), *replay.moving(fit.values, others),
              *_poor(comparisons), *_faults(replay, fit), *misspelt([*records, *others], base)]
    return Calibration(
        IdentificationExperiment("calibration", f"Calibration of {base.model}", [], [], (), ""), records, base, fit,
        estimates, notes, lambda: _drawings(comparisons, fit), calibrated, comparisons, [*_undetermined(fit, unknown)],
        at_bound, search.stopped, faults)


def _correlation(times: Array, comparisons: Sequence[ReplayedOutput]) -> str:
    """Return a note on the correlation `times` [samples] of the residuals, and on the errors beyond white noise."""
    ends = " to ".join(dict.fromkeys(f"{time:.3g}" for time in (times.min(), times.max())))
    return (f"Residuals are correlated over {ends} samples; white noise, over 1. Errors without white noise are up to "
            f"{100.0 * max(c.unexplained for c in comparisons):.2g} % of a measured deviation. Long correlation times "
            "come from encoder counts, rounded digits or, if these errors are large, from an effect that the model "
            "lacks. The uncertainties account for the correlation, but not for fixed parameters that are wrong.")


def _undetermined(fit: Fit, free: Sequence[Unknown]) -> Iterator[tuple[str, ...]]:
    """Yield combinations of parameters that the records hardly determine, as the names of the main parameters.

    The combinations are eigenvectors of the covariance relative to the priors' covariance. A parameter's part is its
    effect on the simulation along the eigenvector: parameters that the records cannot distinguish have equal parts,
    whatever their sizes.
    """
    count, spread = len(free), np.array([u.sigma for u in free])
    shares, directions = np.linalg.eigh(fit.covariance[:count, :count] / np.outer(spread, spread))
    effects = np.sqrt(np.maximum(np.diag(np.linalg.inv(fit.covariance))[:count] * spread**2 - 1.0, 1e-12))
    for direction in directions.T[shares > _OPEN]:
        parts = np.abs(direction) * effects
        yield tuple(u.name for u, part in zip(free, parts, strict=True) if part > _PART * parts.max())


class _Search:
    """The search from several starting points for `best`, the point of smallest error, and the fit from there."""

    def __init__(self, replay: Replay, seed: int, progress: Progress) -> None:
        self._replay, self._progress = replay, progress
        unknowns = replay.unknowns
        self._size, self._mean, self._sigma, lower, upper = (np.array(column) for column in zip(*(
            (u.size, u.mean, u.sigma, u.lower, u.upper) for u in unknowns), strict=True))
        self._bounds = lower / self._size, upper / self._size
        self._deviations = [float(np.std(replay.records[i][replay.outputs[j].name])) or 1.0 for i, j in replay.owners]
        self._units = np.ones(len(replay.outputs))
        self.best, self._lowest, self.stopped = np.array([u.start for u in unknowns]), inf, False
        candidates = np.repeat(self.best[None], _CANDIDATES, axis=0)
        draws = qmc.LatinHypercube(replay.free, rng=np.random.default_rng(seed)).random(_CANDIDATES - 1)
        candidates[1:, :replay.free] = [[u.between(share) for u, share in zip(unknowns, row)] for row in draws]
        try:
            progress("trying starting points", 0, _TRIED + 1)
            costs = [np.linalg.norm(self._relative(each[None])) for each in candidates / self._size]
            for k, index in enumerate([0, *(i for i in np.argsort(costs).tolist() if i)][:_TRIED]):
                progress("fitting from starting points", k + 1, _TRIED + 1)
                point = candidates[index] / self._size
                for samples in (_MEAN, 1):
                    point = solve(partial(self._relative, smooth=True, samples=samples), point, method="trf",
                                  bounds=self._bounds, max_nfev=_EVALUATIONS, xtol=1e-6, ftol=1e-4)[0]
                    self._scaled(point[None] * self._size)
        except KeyboardInterrupt:
            self.stopped = True

    def fit(self, near: Stretches, robust: bool) -> Fit:
        """Return the fit from the best point (after Ctrl-C, at it); `near` are the residuals [SI] at that point."""
        owners, count = self._replay.owners, len(self._units)
        self._units = np.array([float(np.sqrt(np.mean(np.concatenate(near[j::count]) ** 2))) or 1.0
                                for j in range(count)])

        def from_best(steps: int) -> Fit:
            return weighted_fit(
                [u.name for u in self._replay.unknowns], self._scaled, self.best, self._size,
                [i * count + j for i, j in owners], prior=(self._mean, self._sigma), robust=robust,
                together=[i for i, _ in owners],
                smooth=partial(self._scaled, smooth=True) if self._replay.rough else None,
                minimise=partial(self._descend, steps=steps))

        self._progress("fitting", _TRIED + 1, _TRIED + 1)
        try:
            fit = from_best(0 if self.stopped else _STEPS)
        except KeyboardInterrupt:
            self.stopped, fit = True, from_best(0)
        units = self._units[[j for _, j in owners]]
        return replace(fit, residuals=tuple(r * u for r, u in zip(fit.residuals, units, strict=True)),
                       deviations=fit.deviations * units)

    def unsettled(self) -> Iterator[str]:
        """Yield a message on the unknown with the largest mean of the last steps if the fit has not settled."""
        step, name = max(zip(self._left, (u.name for u in self._replay.unknowns), strict=True))
        if step >= SETTLED and not self.stopped:
            yield (f"not settled: {name} still changes by {step:.2g} sigma per step after {_STEPS} steps: values are "
                   "less certain than stated; compare only measured outputs, give narrower bounds, or free fewer "
                   "parameters")

    def _descend(self, residuals: Callable[[Array], Array], start: Array, **options: Any) -> tuple[Array, Array]:
        """Return the parameters and Jacobian of `descend`, and store the size of its last step."""
        values, jacobian, self._left = descend(residuals, start, bounds=self._bounds, **options)
        return values, jacobian

    def _scaled(self, points: Array, smooth: bool = False) -> list[Stretches]:
        """Return residuals [SI] divided by `_units`; without `smooth`, store the best of all points so far."""
        residuals = self._replay.residuals(points, smooth)
        for point, stretches in zip(points, residuals, strict=True) if not smooth else ():
            cost = sum(float(np.mean(r**2)) / s**2 for r, s in zip(stretches, self._deviations, strict=True))
            if cost < self._lowest:
                self.best, self._lowest = point, cost
        return [[r / self._units[j] for r, (_, j) in zip(stretches, self._replay.owners, strict=True)]
                for stretches in residuals]

    def _relative(self, points: Array, smooth: bool = False, samples: int = 1) -> Array:
        """Return residuals over deviations, means of `samples`, and a faint prior's; `points` are over `_size`."""
        return np.array([np.concatenate([
            *(mean / (s * sqrt(len(mean))) for r, s in zip(stretches, self._deviations, strict=True)
              for mean in (r[:len(r) // samples * samples].reshape(-1, samples).mean(axis=1),)),
            _FAINT * (point * self._size - self._mean) / self._sigma])
            for point, stretches in zip(points, self._scaled(points * self._size, smooth), strict=True)])


def _require_plausible(replay: Replay, residuals: Stretches, largest: float) -> None:
    """Raise RecordError for a column that no parameters explain: its sign or unit is wrong, or an input is missing.

    `residuals` are those at one point. `largest` is the largest plausible ratio of measured to simulated standard
    deviations, or of its inverse.
    """
    for r, (i, j) in zip(residuals, replay.owners, strict=True):
        record, v = replay.records[i], replay.outputs[j]
        measured = record[v.name]
        simulated = measured + r
        size, expected = float(np.std(measured)), float(np.std(simulated))
        if not size:
            continue
        record.require(expected > _STILL * size, f"{v.name} varies, but hardly in simulation: an input's column is "
                       f"missing or constant; the columns used are {', '.join(record.columns)}")
        agreement = float(np.corrcoef(measured, simulated)[0, 1])
        record.require(agreement > _OPPOSITE, f"{v.name} is opposite to its simulation (correlation "
                       f"{agreement:.2f}): its sign, or that of an input, is wrong; change it in the file")
        record.require(1.0 / largest < size / expected < largest, f"{v.name} varies by {size:.3g} {v.unit or '1'} (1 "
                       f"sigma), its simulation by {expected:.3g}: it was read as {record.units[v.name]}; write its "
                       f"unit into the header, as in {v.name} [{v.unit}]; if the unit is right, give wider bounds")


def _contradicted(fit: Fit, free: Sequence[Unknown]) -> Iterator[str]:
    """Yield a message for each parameter whose prior the records contradict.

    The estimate is a weighted mean of the prior and the records. The variance of its distance from the prior is the
    prior's variance minus the estimate's.
    """
    for u, value, sigma in zip(free, fit.values, fit.sigmas):
        expected = sqrt(max(u.sigma**2 - sigma**2, 0.01 * u.sigma**2))
        if u.has_prior and abs(value - u.mean) > _CONTRADICTED * expected:
            yield (f"{u.name} = {value:.6g} {u.unit} differs from its prior, {u.mean:.6g}, by "
                   f"{abs(value - u.mean) / expected:.2g} sigma of this difference: the records contradict the prior; "
                   "correct it, or look for an effect that the model lacks")


def _poor(comparisons: Sequence[ReplayedOutput]) -> Iterator[str]:
    """Yield a message for each output whose error without noise exceeds a small share of its measured deviation."""
    for c in comparisons:
        if c.unexplained > _POOR:
            yield (f"{c.record.name}: {c.variable.name} ({c.use}) is explained poorly: {100.0 * c.unexplained:.0f} % "
                   "of its deviation remains in addition to noise; look for a wrong input, unit or fixed value, free "
                   "more parameters, try another seed, or choose a model with the missing effect")


def _faults(replay: Replay, fit: Fit) -> Iterator[str]:
    """Yield a message for each fault of a column: a measuring range that is too small, or a clock that drifts."""
    for r, time, (i, j) in zip(fit.residuals, fit.times, replay.owners, strict=True):
        record, v = replay.records[i], replay.outputs[j]
        measured = record[v.name]
        for extreme, sign in ((measured.max(), 1.0), (measured.min(), -1.0)):
            extremes = measured == extreme
            excess = sign * float(np.mean(r[extremes]))
            flat = not extremes.all() and longest(extremes) >= _FLAT
            if flat and excess > _BEYOND * float(np.std(r[~extremes])):
                yield (f"{record.name}: {v.name} is clipped at {extreme:.6g} {v.unit}, which the simulation exceeds by "
                       f"{excess:.3g}: widen the range of the measurement, or cut the file")
        drift, sigma = _drift(measured + r, r, record.step, time)
        if abs(drift) > max(_DRIFT, _CERTAIN * sigma):
            yield (f"{record.name}: the clock of {v.name} drifts by {100.0 * drift:.2g} % (1 sigma {100.0 * sigma:.1g} "
                   "%) against that of the inputs: log both with one clock")


def _drift(simulated: Array, error: Array, step: float, time: float) -> tuple[float, float]:
    """Return the relative drift b of a measurement's clock, and its 1 sigma, from the error of simulation.

    A measurement that is late by d + b t has the error (d + b t) dy/dt; an offset is also fitted. `step` [s] is the
    sample interval, `time` [samples] the correlation time of the error.
    """
    slope = np.gradient(simulated, step)
    elapsed = step * np.arange(len(simulated))
    inverse = np.linalg.pinv(np.stack([elapsed * slope, slope, np.ones(len(elapsed))], axis=1))
    drift, delay, offset = inverse @ error
    residual = error - drift * elapsed * slope - delay * slope - offset
    return float(drift), float(np.std(residual)) * sqrt(time) * float(np.linalg.norm(inverse[0]))


def _drawings(compared: Sequence[ReplayedOutput], fit: Fit) -> Iterator[Drawing]:
    """Yield a picture of each record, measured and simulated, then one of the residuals of the fitted records."""
    for (name, purpose), group in groupby(compared, key=lambda c: (c.record.name, c.use)):
        panels_of = list(group)
        elapsed = panels_of[0].record["time"] - panels_of[0].record["time"][0]
        label, unit_of_time = time_axis(float(elapsed[-1]))
        plot, axes = column(*(f"{c.variable.name} [{c.unit}]" for c in panels_of), x=label, height=2.4)
        for panel, c in zip(axes, panels_of, strict=True):
            time, measured, simulated = pictures.thinned(elapsed * unit_of_time, c.measured, c.simulated)
            panel.plot(time, measured, ".", markersize=3, label="measured")
            panel.plot(time, simulated, label="simulated")
        legend(axes[0], loc="best")
        yield Drawing(f"{name}, {purpose}", plot, "Measured and simulated: " + "; ".join(
            f"{c.variable.name} {c.figures['rms']:.3g} {c.unit} rms, {'constant' if c.constant else f'fit {c.fit} %'}"
            for c in panels_of) + ".")
    series = [(f"{c.record.name} {c.variable.name}", c.record["time"]) for c in compared if not c.held_out]
    relative = tuple(r / (s or 1.0) for r, s in zip(fit.residuals, fit.deviations, strict=True))
    yield pictures.residuals(series, replace(fit, residuals=relative), "time [s]", "residual / 1 sigma")
