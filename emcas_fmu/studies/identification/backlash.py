"""Backlash from the fin angle measured directly and through the motor, section 3.4.

Slow sweeps both ways. The indirect fin angle is the motor angle through lever and screw. The direct one
lags it by half the gap in whichever direction the motor drives, so that their difference jumps by the gap at
reversals. What is common to both directions (zero, errors of the geometry) is a cubic in the fin angle.
The model has no backlash: the figure is reported, and no parameter is made of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from math import degrees, radians
from pathlib import Path
from typing import Any

import numpy as np

from ...parameters import ParameterSet
from . import motion, pictures
from .estimation import METHOD, Fit, fit
from .records import Array, Record, RecordError, grouped, read_records, refuse_magnitude
from .result import Estimate, Identification, Picture, noise

GAP = "backlash"
_CLEAR = radians(0.5)  # of indirect motion after a reversal before the gap counts as crossed
_RANGE = radians(5.0)  # least range of a sweep
_LEAST_SWEEPS = 2
_BLOCKS = 40  # means per sweep, over which an encoder's steps average out
_GIVEN = ("kinematics.moment_arm", "kinematics.initial_angle", "screw.lead")


def identify(paths: Sequence[Path], base: ParameterSet) -> Identification:
    """Backlash at the fin from records with motor_angle and fin_angle. Raises RecordError."""
    records = read_records(paths, ("motor_angle", "fin_angle"))
    p = base.nested()
    sweeps, groups = grouped(records, lambda record: _sweeps(record, p))
    for direction, word in ((1, "positive"), (-1, "negative")):
        if not any(d == direction for d, _, _ in sweeps):
            raise RecordError(f"no sweep of at least {degrees(_RANGE):g} deg in the {word} direction: the gap shows "
                              "between the two directions; sweep there and back")
    found_fit = _fit(sweeps, groups)
    gap, sigma = float(found_fit.values[0]), float(found_fit.sigmas[0])
    if gap < -3.0 * sigma:
        raise RecordError(f"the backlash is found as {degrees(gap):.3g} deg, below 0: the direct angle leads the "
                          "motor's; check the columns' signs, that they are sampled at the same instants, and that the "
                          "motor drives the fin in both directions (a load may hold it against one side)")
    notes = [
        f"{len(sweeps)} sweeps over {degrees(min(float(f.min()) for _, f, _ in sweeps)):.3g} to "
        f"{degrees(max(float(f.max()) for _, f, _ in sweeps)):.3g} deg; the first {degrees(_CLEAR):g} deg after each "
        "reversal are left out.",
        "The model has no backlash: this is no parameter and nothing computes with it.",
        f"Zero of one encoder against the other: {degrees(float(found_fit.values[1])):.3g} deg; part of it may be half "
        "a count.",
    ]
    if gap < 2.0 * sigma:
        notes.append(f"Not distinguishable from no backlash; below {degrees(max(gap, 0.0) + 2.0 * sigma):.2g} deg at "
                     "2 sigma.")
    estimates = [Estimate(GAP, degrees(gap), degrees(sigma), "deg", False, None)]
    return Identification("backlash", "Backlash", records, estimates, {n: float(base.values[n]) for n in _GIVEN},
                          METHOD, notes, _pictures(sweeps, [(r, _indirect(r, p)) for r in records], found_fit),
                          (_names(), found_fit.correlation), noise(records, found_fit, groups, "rad"))


def _names() -> list[str]:
    return [GAP, *(f"difference[{n}]" for n in range(4))]


def _indirect(record: Record, p: Any) -> Array:
    indirect = motion.fin_angle(p, record["motor_angle"])
    refuse_magnitude(record, "motor_angle", 1.25 * motion.motor_travel(p), "1.25 times the travel to fin.stop_angle")
    refuse_magnitude(record, "fin_angle", 1.25 * p.fin.stop_angle, "1.25 times fin.stop_angle")
    if np.ptp(indirect) < _RANGE:
        raise record.fail(f"there is no motion to speak of: the fin turns by {degrees(np.ptp(indirect)):.3g} deg by "
                          f"the motor's angle; sweep at least {degrees(_RANGE):g} deg there and back")
    slope = float(np.polyfit(indirect, record["fin_angle"], 1)[0])
    if not 0.9 < slope < 1.1:
        raise record.fail(f"fin_angle moves {slope:.3g} times as much as the motor's angle lets expect: check the "
                          "units in the header (1 rad is 57.3 deg), and kinematics.moment_arm and screw.lead of the "
                          "parameters")
    return indirect


def _sweeps(record: Record, p: Any) -> list[tuple[int, Array, Array]]:
    """Direction, fin angle and difference in blocks, of each sweep once the gap is crossed."""
    indirect = _indirect(record, p)
    # A reversal is a turn by more than the gap could be: extremes by hysteresis.
    turns, extreme, direction = [0], 0, 0
    for k, angle in enumerate(indirect.tolist()):
        ahead = angle - indirect[extreme]
        if direction == 0:
            if abs(ahead) > _CLEAR:
                direction = 1 if ahead > 0.0 else -1
                extreme = k
        elif ahead * direction > 0.0:
            extreme = k
        elif -ahead * direction > _CLEAR:
            turns.append(extreme)
            direction, extreme = -direction, k
    turns.append(len(indirect) - 1)
    found = []
    for begin, end in pairwise(turns):
        way = indirect[end] - indirect[begin]
        if abs(way) < _RANGE:
            continue
        side = 1 if way > 0.0 else -1
        along = side * (indirect[begin:end] - indirect[begin])
        # Rest at either end would weigh one angle alone.
        inside = np.arange(begin, end)[(along > _CLEAR) & (along < abs(way) - 0.02 * _CLEAR)]
        if len(inside) < 2 * _BLOCKS:
            raise record.fail(f"a sweep of {degrees(abs(way)):.3g} deg has {len(inside)} samples; at least "
                              f"{2 * _BLOCKS} "
                              "are needed for the counts of the encoders to average out: log faster or sweep slower")
        difference = record["fin_angle"] - indirect
        blocks = np.array_split(inside, _BLOCKS)
        found.append((side, np.array([indirect[b].mean() for b in blocks]),
                      np.array([difference[b].mean() for b in blocks])))
    return found


def _model(x: Array, direction: int, fin: Array, reach: float) -> Array:
    z = fin / reach
    found: Array = -0.5 * direction * x[0] + x[1] + z * (x[2] + z * (x[3] + z * x[4]))
    return found


def _reach(sweeps: Sequence[tuple[int, Array, Array]]) -> float:
    return max(float(np.abs(f).max()) for _, f, _ in sweeps)


def _fit(sweeps: Sequence[tuple[int, Array, Array]], groups: Sequence[Sequence[int]]) -> Fit:
    reach = _reach(sweeps)
    return fit(lambda x: [d - _model(x, side, f, reach) for side, f, d in sweeps], np.zeros(5), np.full(5, 1e-3),
               groups)


def _pictures(sweeps: Sequence[tuple[int, Array, Array]], traces: Sequence[tuple[Record, Array]],
              found: Fit) -> list[Picture]:
    reach = _reach(sweeps)

    def against_fin() -> Any:
        series = []
        for direction, word in ((1, "positive direction"), (-1, "negative direction")):
            mine = [(f, d) for side, f, d in sweeps if side == direction]
            fin, difference = (np.concatenate(c) for c in zip(*mine, strict=True))
            grid = np.linspace(fin.min(), fin.max(), 100)
            series.append(pictures.Series(word, np.degrees(fin), np.degrees(difference), np.degrees(grid),
                                          np.degrees(_model(found.values, direction, grid, reach)), None))
        return pictures.panels([("", series)], "fin angle [deg]", "direct less indirect fin angle [deg]")

    def against_time() -> Any:
        parts = []
        for record, indirect in traces:
            time = record["time"] - record["time"][0]
            difference = np.degrees(record["fin_angle"] - indirect)
            parts.append((record.name, [pictures.Series("direct less indirect", time, difference, time[:1],
                                                        difference[:1], None)]))
        return pictures.panels(parts, "time [s]", "difference [deg]", height=2.6)

    return [
        Picture("Direct and indirect fin angle", "Their difference in blocks of each sweep, by direction, and the "
                                                 "fitted "
                f"curves: {degrees(float(found.values[0])):.3g} deg apart, the backlash.", against_fin),
        Picture("Difference against time", "As measured, with the encoders' counts.", against_time),
        pictures.residuals(lambda: [("positive" if s > 0 else "negative", np.degrees(f), np.degrees(r))
                                    for (s, f, _), r in zip(sweeps, found.residuals, strict=True)],
                           "fin angle [deg]", "residual [deg]", found),
    ]
