"""Identify the backlash from the fin angle, measured directly and computed from the motor angle (section 3.4).

The records are slow sweeps in both directions. The indirect fin angle follows from the motor angle through screw and
lever. The direct angle lags behind the indirect one by half the gap in either direction, and their difference jumps by
the gap at reversals. Errors of zero and geometry are a cubic in the fin angle, common to both directions. The nonlinear
actuator has no backlash: no parameter is written. The report states the gap, and ``drive_line.backlash`` for actuators
with this parameter.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise
from math import degrees, radians
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.signal import find_peaks

from ...parameters import ParameterSet
from ...plotting.plots import Drawing
from . import motion, pictures
from .estimation import Fit, each, weighted_fit
from .records import DIRECTIONS, Array, RecordFile, divided, read_records, refuse_magnitude, require
from .result import Estimate, Identification, IdentificationExperiment

EXPERIMENT = IdentificationExperiment("backlash", "Backlash", ("motor_angle", "fin_angle"), (),
                                      ("kinematics.moment_arm", "kinematics.initial_angle", "screw.lead"), "rad")
GAP = "backlash"
_NAMES = (GAP, *(f"difference[{n}]" for n in range(4)))
_CLEAR = radians(0.5)  # indirect motion after a reversal within which the gap is crossed
_RANGE = radians(5.0)  # smallest range of a sweep
_BLOCKS = 40  # blocks of a sweep, within which an encoder's steps average out


class GapSweep(NamedTuple):
    """A sweep after the gap is crossed: `direction` (1, -1), means of `fin` angle and `difference` [rad] in blocks."""

    direction: int
    fin: Array
    difference: Array


def identify(paths: Sequence[Path], base: ParameterSet) -> Identification:
    """Identify the backlash at the fin. Raises RecordError."""
    records = read_records(paths, EXPERIMENT.required, EXPERIMENT.optional)
    p = base.nested()
    sweeps, owners = divided(records, lambda record: _sweeps(record, _indirect(record, p)))
    for direction, word in DIRECTIONS:
        require(any(s.direction == direction for s in sweeps), f"there is no sweep of at least {degrees(_RANGE):g} deg "
                f"in the {word} direction: the gap is the difference between the directions; sweep there and back")
    reach = max(float(np.abs(s.fin).max()) for s in sweeps)
    residuals = each(lambda x: [s.difference - _model(x, s.direction, s.fin, reach) for s in sweeps])
    fit = weighted_fit(_NAMES, residuals, np.zeros(5), np.full(5, 1e-3), owners)
    gap, sigma = float(fit.values[0]), float(fit.sigmas[0])
    require(gap >= -3.0 * sigma, f"the backlash is estimated as {degrees(gap):.3g} deg, below 0: the direct angle "
            "leads the indirect one; check the columns' signs, that they are sampled at the same instants, and that "
            "the motor drives the fin in both directions (a load may hold it against one side)")
    travel = p.kinematics.moment_arm / np.cos(p.kinematics.initial_angle) ** 2  # m/rad, of the nut at fin angle 0
    notes = [
        f"{len(sweeps)} sweeps over {degrees(min(float(s.fin.min()) for s in sweeps)):.3g} to "
        f"{degrees(max(float(s.fin.max()) for s in sweeps)):.3g} deg; the first {degrees(_CLEAR):g} deg after each "
        "reversal are left out.",
        f"The nonlinear actuator has no backlash, so no parameter is written. In elastic and habibi it is "
        f"drive_line.backlash = {1e3 * max(gap, 0.0) * travel:.2g} mm.",
        f"Difference between the encoders' zeros: {degrees(float(fit.values[1])):.3g} deg, of which half a count may "
        "be an effect of quantisation.",
    ]
    if gap < 2.0 * sigma:
        notes.append("The backlash cannot be distinguished from 0; it is below "
                     f"{degrees(max(gap, 0.0) + 2.0 * sigma):.2g} deg at 2 sigma.")
    return Identification(
        EXPERIMENT, records, base, fit, [Estimate(GAP, degrees(gap), degrees(sigma), "deg", parameter=False)], notes,
        lambda: _drawings(sweeps, [(r, _indirect(r, p)) for r in records], fit, reach))


def _indirect(record: RecordFile, p: Any) -> Array:
    """Return the fin angle [rad] from the motor angle. Raises RecordError if the measured fin angle contradicts it."""
    indirect = motion.fin_angle(p, record["motor_angle"])
    refuse_magnitude(record, "motor_angle", 1.25 * motion.motor_travel(p), "1.25 times the travel to fin.stop_angle")
    refuse_magnitude(record, "fin_angle", 1.25 * p.fin.stop_angle, "1.25 times fin.stop_angle")
    record.require(np.ptp(indirect) >= _RANGE, "there is hardly any motion: by the motor angle the fin turns by "
                   f"{degrees(np.ptp(indirect)):.3g} deg; sweep at least {degrees(_RANGE):g} deg there and back")
    slope = float(np.polyfit(indirect, record["fin_angle"], 1)[0])
    record.require(0.9 < slope < 1.1, f"fin_angle moves {slope:.3g} times as much as the motor angle implies: "
                   "check the units in the header (1 rad is 57.3 deg), and kinematics.moment_arm and screw.lead of the "
                   "parameters")
    return indirect


def _turns(angle: Array) -> list[int]:
    """Return the indices of both ends, and of the reversals with at least `_CLEAR` of motion on either side."""
    peaks = (find_peaks(side * angle, prominence=_CLEAR)[0] for side in (1.0, -1.0))
    return [0, *sorted(np.concatenate([*peaks]).tolist()), len(angle) - 1]


def _sweeps(record: RecordFile, indirect: Array) -> Iterator[GapSweep]:
    """Yield the sweeps of a record. Raises RecordError if one has too few samples."""
    difference = record["fin_angle"] - indirect
    for begin, end in pairwise(_turns(indirect)):
        travel = indirect[end] - indirect[begin]
        if abs(travel) < _RANGE:
            continue
        direction = 1 if travel > 0.0 else -1
        along = direction * (indirect[begin:end] - indirect[begin])
        # Samples at rest at the ends would give one angle too much weight.
        inside = np.arange(begin, end)[(along > _CLEAR) & (along < abs(travel) - 0.02 * _CLEAR)]
        record.require(len(inside) >= 2 * _BLOCKS, f"a sweep of {degrees(abs(travel)):.3g} deg has {len(inside)} "
                       f"samples; at least {2 * _BLOCKS} are needed to average the encoders' counts: log faster "
                       "or sweep slower")
        blocks = np.array_split(inside, _BLOCKS)
        yield GapSweep(direction, *(np.array([x[b].mean() for b in blocks]) for x in (indirect, difference)))


def _model(x: Array, direction: int, fin: Array, reach: float) -> Array:
    """Return the direct minus the indirect fin angle [rad]: half the gap, and a cubic in fin angle / `reach`."""
    z = fin / reach
    difference: Array = -0.5 * direction * x[0] + x[1] + z * (x[2] + z * (x[3] + z * x[4]))
    return difference


def _drawings(sweeps: Sequence[GapSweep], traces: Sequence[tuple[RecordFile, Array]], fit: Fit,
              reach: float) -> Iterator[Drawing]:
    series = []
    for direction, word in DIRECTIONS:
        fin, difference = (np.concatenate(columns) for columns in zip(
            *(s[1:] for s in sweeps if s.direction == direction), strict=True))
        grid = np.linspace(fin.min(), fin.max(), 100)
        series.append(pictures.Series(f"{word} direction", np.degrees(fin), np.degrees(difference), np.degrees(grid),
                                      np.degrees(_model(fit.values, direction, grid, reach))))
    yield pictures.panels(
        "Direct and indirect fin angle", [("", series)], "fin angle [deg]", "direct minus indirect fin angle [deg]",
        "Their difference in blocks of each sweep, by direction, and the fitted curves; the distance of the curves, "
        f"{degrees(float(fit.values[0])):.3g} deg, is the backlash.")
    measured = [(record.name, record["time"] - record["time"][0], np.degrees(record["fin_angle"] - indirect))
                for record, indirect in traces]
    parts = [(name, [pictures.Series("direct minus indirect", time, y, time[:1], y[:1])]) for name, time, y in measured]
    yield pictures.panels("Difference against time", parts, "time [s]", "difference [deg]",
                          "As measured, with the encoders' quantisation.", height=2.6)
    words = dict(DIRECTIONS)
    yield pictures.residuals([(words[s.direction], np.degrees(s.fin)) for s in sweeps], fit, "fin angle [deg]",
                             "residual [deg]", degrees(1.0))
