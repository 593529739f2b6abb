"""Calibration of the servo on records: a search from the data sheet's values, with priors."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from math import pi, sqrt

import numpy as np

from emcas_fmu.api import EmcasError, ParameterSet

from .evolution import minimised
from .records import LATENCY, TILT_NAME, Array, Record, error, simulated

# Data sheet: stall current 1.47 A at 5 V, no-load speed 103 rev/min at 5 V, torque 0.42 N.m at 1.11 A and 3.7 V.
# Friction makes the constant from speed too large and the one from torque too small: their geometric mean is used.
_VOLTAGE = 7.3  # V, in the records
_RESISTANCE = 5.0 / 1.47  # Ohm
_CONSTANT = sqrt(5.0 / (103.0 * pi / 30.0) * 0.42 / 1.11)  # V.s/rad or N.m/A, at the output


@dataclass(frozen=True)
class Prior:
    """The prior of a parameter: a typical value and 1 sigma, which is that of the logarithm for a `ratio`."""

    typical: float
    sigma: float
    ratio: bool = True

    def at(self, deviation: Array) -> Array:
        """Return the values at a `deviation` from the typical value, in sigmas."""
        change = self.sigma * deviation
        values: Array = self.typical * np.exp(change) if self.ratio else self.typical + change
        return values


# Motor from the data sheet, rotor from its size (3 g, radius 3.5 mm); plastic gear and bench are wide estimates.
FREE: Mapping[str, Prior] = {
    "motor.stall_torque": Prior(_CONSTANT * _VOLTAGE / _RESISTANCE, 0.15),
    "motor.no_load_speed": Prior(_VOLTAGE / _CONSTANT, 0.15),
    "motor.asymmetry": Prior(0.0, 0.1, ratio=False),
    "inertia.motor": Prior(2e-8, 0.5),
    "friction.gear": Prior(0.01, 0.7),
    "friction.gear_load": Prior(0.15, 0.6),
    "friction.gear_load_rise": Prior(0.3, 0.6),
    "friction.gear_viscous": Prior(0.005, 0.7),
    "friction.stribeck_share": Prior(0.2, 0.6),
    "friction.stribeck_speed": Prior(0.3, 0.7),
    LATENCY: Prior(0.003, 0.001, ratio=False),
    TILT_NAME: Prior(0.0, 0.03, ratio=False)}
# Cost [mrad] of a squared sigma: half the mean error of 17 mrad over the number of independent errors. This number is
# about four for each of twelve records, since an error lasts as long as the servo sticks (an estimate).
_WEIGHT = 0.2
_SPREAD, _FARTHEST = 0.5, 3.0  # sigmas: standard deviation of the first samples, largest deviation
GENERATIONS, _SAMPLES, _SEEDS = 80, 24, (1, 2)
_COARSE = {"solver.max_tick": 1e-3}  # changes the mean error by 0.05 mrad
_LOST = 1e3  # mrad, error of a simulation that does not reach its end
# Order of the trajectories in which the four published records that were never used are one group.
_ORDER = ("sin_time_square", "up_and_down", "sin_sin", "lift_and_drop")
Report = Callable[[int, float], None]
"""A function that is called with the number of the generation and its smallest cost [mrad]."""


def calibrated(runs: Sequence[Record], base: ParameterSet, report: Report = lambda *_: None) -> dict[str, float]:
    """Return the values [SI] of FREE, with three digits, that minimise the mean absolute error and the priors' cost.

    They are the better result of two searches with different random numbers. Where the servo sticks, the error jumps
    and has no useful slopes: least squares from eight starts end at 19 to 25 mrad on all records, differential
    evolution with three times as many simulations at 17 to 19.
    """
    coarse = base.with_values(_COARSE)
    with ThreadPoolExecutor(os.cpu_count()) as threads:
        def cost(deviations: Array) -> Array:
            values = values_of(deviations)
            errors = list(threads.map(lambda run: error(run, simulated(run, coarse, values)), runs))
            mean: Array = np.mean(np.nan_to_num(errors, nan=_LOST), axis=0)
            mean += _WEIGHT * np.sum(deviations**2, axis=0)
            return mean

        ends = np.array([minimised(cost, np.zeros(len(FREE)), _SPREAD, _FARTHEST, GENERATIONS, _SAMPLES, seed, report)
                         for seed in _SEEDS])
        best = ends[np.argmin(cost(ends.T))]
    return {name: float(f"{value:.3g}") for name, value in values_of(best).items()}


def values_of(deviations: Array) -> dict[str, Array]:
    """Return the values [SI] of FREE at `deviations` [parameters, ...] from the typical values, in sigmas."""
    return {name: prior.at(column) for (name, prior), column in zip(FREE.items(), deviations, strict=True)}


def typical() -> dict[str, float]:
    """Return the typical values [SI] of FREE, at which a calibration starts."""
    return {name: prior.typical for name, prior in FREE.items()}


def groups(runs: Sequence[Record]) -> list[list[Record]]:
    """Return groups of records; with at most four gains and trajectories a group has each of them at most once."""
    names = list(dict.fromkeys((*_ORDER, *sorted(run.trajectory for run in runs))))
    gains = sorted({run.gain for run in runs})
    count = max(len(_ORDER), len(gains))
    parts: dict[int, list[Record]] = {}
    for run in runs:
        parts.setdefault((names.index(run.trajectory) - gains.index(run.gain)) % count, []).append(run)
    return [parts[key] for key in sorted(parts)]


def unseen(runs: Sequence[Record], base: ParameterSet, held_out: Sequence[Record],
           report: Report = lambda *_: None) -> dict[str, float]:
    """Return the errors [mrad] of the records `held_out` by file, with the values calibrated on the others.

    Raises EmcasError without other records.
    """
    others = [run for run in runs if run not in held_out]
    if not others:
        raise EmcasError(f"{held_out[0].path}: is the only record; pass more, so that one can be left out")
    values = calibrated(others, base, report=report)
    return {run.path.name: float(error(run, simulated(run, base, values))) for run in held_out}
