"""Calibration on one record: least squares of force in closed loops and of position in open-loop windows."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy.optimize import least_squares

from emcas_fmu.support.progress import Progress, silent

from .records import SAMPLE_TIME, Array, Record
from .simulated import BORDER, WINDOW, Values, force, in_windows, percent, under_loops

# Orders of magnitude of the free parameters, in SI.
FREE = {"inertia.fin": 100.0, "friction.dry": 10.0, "friction.build_up": 10.0, "friction.build_up_rate": 0.02,
        "friction.viscous_positive": 100.0, "friction.viscous_negative": 100.0, "friction.load_positive": 0.1,
        "friction.load_negative": 0.1, "friction.slope_positive": 1.0, "friction.slope_negative": 1.0,
        "friction.curvature_positive": 10.0, "friction.curvature_negative": 10.0, "axis.offset": 1.0,
        "drive.lag": 1e-3}
# Limits within those of the actuator, by at least the step of the slopes.
LIMITS = {"friction.build_up_rate": (1e-3, 1.0), "friction.load_positive": (1e-4, 0.5),
          "friction.load_negative": (1e-4, 0.5), "drive.lag": (2e-6, 5e-3)}
# RMS errors of force and of position in windows after a fit, by which the residuals are divided.
FORCE, POSITION = 1.2, 0.3e-3  # N, m
STAGES, STAGE = 8, round(0.78 / SAMPLE_TIME)  # number of stages in a period of 6.24 s, and samples of a stage
TERMS: Mapping[str, Values] = {
    "all terms": {}, "no lag of the drive": {"drive.lag": 1e-6},
    "no friction that builds up": {"friction.build_up": 0.0, "friction.build_up_rate": 1.0},
    "no friction by load": {"friction.load_positive": 0.0, "friction.load_negative": 0.0},
    "no friction by position": {f"friction.{name}_{side}": 0.0 for name in ("slope", "curvature")
                                for side in ("positive", "negative")}}
_STEP = 1e-4  # step of the slopes over the order of magnitude; with a tenth of it they differ by at most 1e-5


def calibrated(record: Record, start: Values, free: Mapping[str, float] = FREE, kept: Array | None = None,
               evaluations: int = 25) -> dict[str, float]:
    """Return `start` with the `free` parameters that fit the samples `kept` (default: all) of a record best."""
    scales = np.array(list(free.values()))
    kept = np.ones(len(record), dtype=bool) if kept is None else kept
    inner = kept & (np.arange(len(record)) >= BORDER)
    windows = np.array([kept[at:at + WINDOW].all() for at in range(0, len(record) - WINDOW + 1, WINDOW)])

    def residuals(points: Array) -> Array:
        sets = [{**start, **dict(zip(free, (point * scales).tolist(), strict=True))} for point in points]
        _, voltage = under_loops(record, sets)
        return np.hstack((force((voltage - record.voltage)[:, inner]) / FORCE,
                          in_windows(record, sets)[:, windows].reshape(len(sets), -1) / POSITION))

    def slopes(point: Array) -> Array:
        steps = _STEP * np.eye(len(point))
        higher, lower = np.split(residuals(np.vstack((point + steps, point - steps))), 2)
        slope: Array = (higher - lower).T / (2.0 * _STEP)
        return slope

    lower, upper = np.array([LIMITS.get(name, (-np.inf, np.inf)) for name in free]).T / scales
    begin = np.clip(np.array([start[name] for name in free]) / scales, lower, upper)
    fit = least_squares(lambda point: residuals(point[np.newaxis])[0], begin, slopes, bounds=(lower, upper),
                        xtol=1e-5, ftol=1e-6, max_nfev=evaluations)
    return {**start, **dict(zip(free, (fit.x * scales).tolist(), strict=True))}


def cross_validation(record: Record, start: Values, progress: Progress = silent,
                     ) -> dict[str, tuple[float, float, float]]:
    """Return three errors for each of TERMS: of the force fitted [%] and held out [%], and of windows held out [mm].

    Each of the eight stages of the command's period, from one stop to the next, is held out in turn, with the windows
    that contain a part of it, and is simulated with the parameters fitted to the others.
    """
    stage = np.arange(len(record)) // STAGE % STAGES
    results = {}
    for done, (words, neutral) in enumerate(TERMS.items()):
        progress(words, done, len(TERMS))
        free = {name: scale for name, scale in FREE.items() if name not in neutral}
        whole = calibrated(record, {**start, **neutral}, free)
        squares, window_squares = np.zeros(2), np.zeros(2)
        for held_out in range(STAGES):
            values = calibrated(record, whole, free, stage != held_out, 6)
            out = (stage == held_out) & (np.arange(len(record)) >= BORDER)
            _, voltage = under_loops(record, [values])
            squares += np.sum((voltage[0] - record.voltage)[out] ** 2), np.sum(record.voltage[out] ** 2)
            windows = [at for at in range(len(record) // WINDOW) if (stage[at * WINDOW:][:WINDOW] == held_out).any()]
            errors = in_windows(record, [values])[0, windows]
            window_squares += np.sum(errors ** 2), errors.size
        _, voltage = under_loops(record, [whole])
        results[words] = (percent(voltage[0], record.voltage), 100.0 * float(np.sqrt(squares[0] / squares[1])),
                          1e3 * float(np.sqrt(window_squares[0] / window_squares[1])))
    return results
