"""Figures of responses, each defined once, as pure functions of uniformly sampled columns.

A column is an array [rows] of one run, or [runs, rows] of many; a figure is a number, or an array [runs]. The figure of
a run does not depend on the other runs: the rows of each run are contiguous and reduced separately.
Everything is in SI: angles in rad, rates in rad/s, times in s, frequencies in Hz, shares as numbers; `shown` returns
the units for display. FIGURES lists all figures with their units.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import degrees, inf, nan, radians
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..units import RPM
from ..variables import Variable
from .runs import Run

Array = NDArray[np.floating[Any]]

ACCURACY = radians(0.2)  # Yerlikaya (2016), Table 2
HELD = 1.0 / 3.0  # share of a hold, at its end, in which its figures are measured
CREPT = 1e-8  # rad, largest change of the angle that does not count as motion


@dataclass(frozen=True)
class Figure:
    """A figure's unit (SI or dB), its definition, its runs, and the outputs that it `needs`.

    `runs` has the kinds of run that have the figure: "jump" (of the command), "rest" (at command 0 under a load),
    "sweep", "usage" (any run), and kinds of test. `reduction` is the one of REDUCTIONS that computes the figure from
    the output that it needs, if there is one. `bad` is 1 if a larger value is worse, -1 if a smaller one is.
    """

    unit: str
    title: str
    runs: str = ""
    needs: tuple[str, ...] = ("fin_angle",)
    reduction: str = ""
    bad: float = 1.0


_ERROR, _CURRENT, _POWER = ("tracking_error",), ("motor_current",), ("supply_power",)
_LOOP = "loop broken at the controllers' output"
FIGURES: Mapping[str, Figure] = {
    "rise_time": Figure("s", "time from 10 to 90 % of the commanded change, each reached for the first time", "jump"),
    "settling_time": Figure("s", "time after which the angle is within 2 % of the change from the command", "jump"),
    "time_to_accuracy": Figure(
        "s", f"time after which the angle is within {degrees(ACCURACY):g} deg of the command", "jump rest"),
    "time_to_90_percent": Figure("s", "time until 90 % of the commanded change is reached", "jump"),
    "overshoot": Figure("1", "largest excess over the command, as a share of the change", "jump"),
    "steady_error": Figure(
        "rad", "distance of the mean angle from the command over the last third of the hold", "jump rest"),
    "held_error": Figure("rad", "largest distance from the command over the last third of the hold", "jump rest"),
    "held_angle": Figure(
        "rad", "smallest magnitude of the angle over the last third of the hold", "jump rest", bad=-1.0),
    "ripple": Figure("rad", "peak to peak of the angle over the last third of the hold", "jump rest"),
    "rebound": Figure("rad", "largest angle against the direction of a load, after it is removed", "rest"),
    "current_ripple": Figure(
        "A", "largest standard deviation of the motor current in a second of the last third", "jump rest", _CURRENT),
    "repeat_error": Figure(
        "rad", "largest difference between the responses of a used and of a fresh actuator", "repeat"),
    "sustained_rate": Figure("rad/s", "mean rate over the middle 60 % of the travel", "jump", bad=-1.0),
    "rate_asymmetry": Figure(
        "1", "difference of the sustained rates in both directions, as a share of the larger", "slew"),
    "peak_rate": Figure("rad/s", "largest magnitude of the fin rate", "jump usage", ("fin_rate",), "peak", -1.0),
    "peak_angle": Figure("rad", "largest magnitude of the fin angle", "usage", reduction="peak"),
    "bandwidth_3db": Figure("Hz", "lowest frequency where the fundamental is 3 dB down", "sine sweep", bad=-1.0),
    "bandwidth_90deg": Figure("Hz", "lowest frequency where the fundamental lags 90 deg", "sine sweep", bad=-1.0),
    "gain_margin": Figure("dB", f"smaller of the margins up and down, {_LOOP}", "linear", (), bad=-1.0),
    "phase_margin": Figure("rad", f"margin of the {_LOOP}", "linear", (), bad=-1.0),
    "delay_margin": Figure("s", "additional delay that makes the loop unstable, at the controllers' output", "linear",
                           (), bad=-1.0),
    "peak_gain": Figure("dB", "largest gain of the fundamental at the examined frequencies", "sweep"),
    "lowest_coherence": Figure("1", "smallest ordinary coherence up to the -3 dB frequency", "sweep", bad=-1.0),
    "peak_tracking_error": Figure("rad", "largest distance from the clipped command", "usage", _ERROR, "peak"),
    "rms_tracking_error": Figure("rad", "root mean square distance from the clipped command", "usage", _ERROR, "rms"),
    "peak_current": Figure("A", "largest magnitude of the motor current", "usage", _CURRENT, "peak"),
    "rms_current": Figure("A", "root mean square of the motor current", "usage", _CURRENT, "rms"),
    "peak_power": Figure("W", "largest power from the supply", "usage", _POWER),
    "peak_returned_power": Figure("W", "largest power returned to the supply", "usage", _POWER),
    "mean_power": Figure("W", "net energy divided by the duration", "usage", _POWER),
    "rms_power": Figure("W", "root mean square of the power", "usage", _POWER),
    "net_energy": Figure("J", "energy from the supply less energy returned", "usage", _POWER),
    "energy_drawn": Figure("J", "integral of the power from the supply", "usage", _POWER),
    "energy_returned": Figure("J", "integral of the power returned", "usage", _POWER),
    "saturated_share": Figure("1", "share of the time in which a limit is active", "usage", ("saturated",), "share"),
    "at_stop_share": Figure(
        "1", "share of the time in which the fin is at a mechanical stop", "usage", ("at_stop",), "share"),
}


def figures_of(*runs: str) -> dict[str, Figure]:
    """Return the figures of any of these kinds of run, by name in the order of FIGURES."""
    return {name: figure for name, figure in FIGURES.items() if not {*runs}.isdisjoint(figure.runs.split())}


_SHOWN = {"rad": ("deg", degrees(1.0)), "rad/s": ("deg/s", degrees(1.0)), "s": ("ms", 1e3), "1": ("%", 100.0),
          "Pa": ("MPa", 1e-6), "m3/s": ("l/min", 6e4)}


def shown(unit: str) -> tuple[str, float]:
    """Return the unit in which people read a figure, and the factor from SI."""
    return _SHOWN.get(unit, (unit, 1.0))


def shown_output(v: Variable) -> tuple[str, float]:
    """Return the unit in which people read an output, and the factor from SI."""
    return ("rpm", RPM) if v.display == "rpm" else shown(v.unit)


# Units by the endings of figures' names in results; longer endings first.
_ENDINGS = {"_n_m_per_rad": "N.m/rad", "_deg_per_s": "deg/s", "_l_per_min": "l/min", "_percent": "%",
            "_n_m": "N.m", "_deg": "deg", "_mpa": "MPa", "_hz": "Hz", "_db": "dB", "_s": "s", "_v": "V", "_a": "A",
            "_w": "W", "_j": "J"}


def unit_of(key: str) -> str:
    """Return the unit at the end of a figure's name in a result; 1 for a pure number."""
    return next((unit for ending, unit in _ENDINGS.items() if key.endswith(ending)), "1")


def in_words(key: str) -> str:
    """Return a figure's name in a result as words, without the unit."""
    return key.removesuffix(next((ending for ending in _ENDINGS if key.endswith(ending)), "")).replace("_", " ")


def result_name(name: str) -> tuple[str, float]:
    """Return a figure's name in a result, which ends with its unit, and the factor from SI; times stay in s."""
    return named(name, FIGURES[name].unit)


def named(name: str, si_unit: str) -> tuple[str, float]:
    """Return the name in a result, and the factor from SI, of any figure in an SI unit."""
    unit, factor = ("s", 1.0) if si_unit == "s" else shown(si_unit)
    return name + next((ending for ending, each in _ENDINGS.items() if each == unit), ""), factor


def displayed(figures: Mapping[str, float]) -> dict[str, float]:
    """Return the figures of one run by their names in a result, in the units of these names."""
    return {key: float(value) * factor for name, value in figures.items() for key, factor in [result_name(name)]}


@dataclass(frozen=True)
class Errors:
    """Largest magnitude and root mean square of response - reference, in the variable's `unit`."""

    maximum: float
    rms: float
    unit: str


def errors(response: Array, reference: Array, unit: str = "1") -> Errors:
    """Return the errors of a response against a reference at the same times; nan if one contains nan or has no rows."""
    difference = np.asarray(response, dtype=float) - reference
    largest, mean = (float(np.max(np.abs(difference))), rms(difference)) if len(difference) else (nan, nan)
    return Errors(largest, mean, unit)


def rms(values: Array) -> Any:
    """Return the root mean square over the rows of `values` [rows] or [runs, rows], in their unit."""
    return np.sqrt(np.mean(np.square(values), axis=-1))


def _at(values: NDArray[Any], row: Any) -> Any:
    """Return the values [] at a row, or [runs] at a row for each run."""
    return np.take_along_axis(values, row[..., np.newaxis], -1)[..., 0]


def crossing(time: Array, values: Array, level: float) -> Any:
    """Return the first time [s] at which `values` are at or above `level`, linearly interpolated; nan if never."""
    above = values >= level
    k = np.argmax(above, axis=-1)
    before = np.maximum(k - 1, 0)
    low, high = _at(values, before), _at(values, k)
    with np.errstate(divide="ignore", invalid="ignore"):  # the first row has no row before it
        between = time[before] + (level - low) / (high - low) * (time[k] - time[before])
    return np.where(_at(above, k), np.where(k == 0, time[0], between), nan)[()]


def settling(time: Array, distance: Array, band: float) -> Any:
    """Return the time [s], from the first row, after which `distance` stays within `band` until the end.

    It is interpolated linearly; 0 if `distance` is never outside, inf if it is outside at the end.
    """
    outside = ~(distance <= band)
    last = len(time) - 1
    k = last - np.argmax(outside[..., ::-1], axis=-1)
    after = np.minimum(k + 1, last)
    here = _at(distance, k)
    with np.errstate(divide="ignore", invalid="ignore"):  # the last row has no row after it
        inside = (here - band) / (here - _at(distance, after))
        within = time[k] - time[0] + inside * (time[after] - time[k])
    return np.where(_at(outside, k), np.where(k == last, inf, within), 0.0)[()]


def settled(time: Array, distance: Array, band: float) -> Any:
    """Return `settling`, or inf if it is in the last third of the record: the rest is too short to show settling."""
    after = settling(time, distance, band)
    return np.where(after > (1.0 - HELD) * (time[-1] - time[0]), inf, after)[()]


def since(start: float, time: Array, *columns: Array) -> tuple[Array, ...]:
    """Return the rows of time and columns from `start` [s] on."""
    # Times of rows have rounding errors: a row that is a nanosecond early counts.
    begin = int(np.searchsorted(time, start - 1e-9))
    return (time[begin:], *(column[..., begin:] for column in columns))


def step_metrics(time: Array, response: Array, start: float, command: Any) -> dict[str, Any]:
    """Return the figures of the response [rad] to a command that steps to a level at `start` [s] and stays there.

    `steady_error` is signed. A time is nan if its level is never reached; for settling times see :func:`settled`.

    Levels are shares of the commanded change, from the response at `start` to the command; they are not shares of the
    change to the final value, since a servo has to reach its command. Other definitions are those of Ogata, "Modern
    Control Engineering", 5th ed., section 5-3. `time_to_accuracy` is the settling time to within ACCURACY.
    """
    time, response = since(start, time, response)
    level = np.asarray(command)[..., np.newaxis]
    share = (response - response[..., :1]) / (level - response[..., :1])
    tenth, most = (crossing(time, share, reached) for reached in (0.1, 0.9))
    return {"rise_time": most - tenth, "settling_time": settled(time, np.abs(share - 1.0), 0.02),
            "time_to_90_percent": most - start, "overshoot": np.maximum(np.max(share, axis=-1) - 1.0, 0.0),
            **hold_figures(time, response, command)}


def hold_figures(time: Array, response: Array, command: Any) -> dict[str, Any]:
    """Return the figures of a response [rad] under a constant command [rad] at these times [s]."""
    error = response - np.asarray(command)[..., np.newaxis]
    last = _last(time)
    return {"time_to_accuracy": settled(time, np.abs(error), ACCURACY),
            "steady_error": np.mean(error[..., last], axis=-1), "held_error": np.max(np.abs(error[..., last]), axis=-1),
            "held_angle": np.min(np.abs(response[..., last]), axis=-1), "ripple": np.ptp(response[..., last], axis=-1)}


def _last(time: Array) -> slice:
    """Return the rows of the last third of a hold."""
    return slice(int(np.searchsorted(time, time[-1] - HELD * (time[-1] - time[0]) - 1e-9)), None)


def sustained_rate(time: Array, angle: Array, start: float, command: Any) -> Any:
    """Return the mean rate [rad/s] over the middle 60 % of the travel that is commanded at `start` [s].

    The middle of the travel excludes acceleration and braking, and a spike hardly changes a mean: a guidance loop can
    rely on this rate, but not on the largest one. It is nan if 80 % of the travel is not reached.
    """
    time, angle = since(start, time, angle)
    first = angle[..., :1]
    travel = command - angle[..., 0]
    share = (angle - first) / travel[..., np.newaxis]
    return np.abs(travel) * 0.6 / (crossing(time, share, 0.8) - crossing(time, share, 0.2))


def motion_figures(run: Run, number: int = 0) -> dict[str, Any]:
    """Return the figures of a finished run after the jump of its command with an index, up to the next jump."""
    move, columns = run.excitation.moves[number], run.columns
    rows = int(np.searchsorted(columns["time"], move.end + 1e-9, side="right"))
    of_move = {name: column[..., :rows] for name, column in columns.items()}
    time, angle = of_move["time"], of_move["fin_angle"]
    return {**step_metrics(time, angle, move.start, move.level), **_current_ripple(of_move, move.start),
            "peak_rate": np.max(np.abs(since(move.start, time, of_move["fin_rate"])[1]), axis=-1),
            "sustained_rate": sustained_rate(time, angle, move.start, move.level)}


def rest_figures(run: Run) -> dict[str, Any]:
    """Return the figures of a rest of a finished run at command 0 under a hinge moment."""
    load = run.excitation.columns["aero_torque"]
    time, angle = since(run.excitation.begin, run.columns["time"], run.columns["fin_angle"])
    against = -np.sign(np.sum(load, axis=-1, keepdims=True)) * angle
    return {**hold_figures(time, angle, 0.0), **_current_ripple(run.columns, run.excitation.begin),
            "rebound": np.max(against, axis=-1, initial=0.0)}


def _current_ripple(columns: Mapping[str, Array], start: float) -> dict[str, Any]:
    if "motor_current" not in columns:
        return {}
    time, current = since(start, columns["time"], columns["motor_current"])
    held = current[..., _last(time)]
    second = max(round((len(time) - 1) / max(time[-1] - time[0], 1e-9)), 1)  # rows; a slower change is a drift
    ends = range(held.shape[-1], min(second, held.shape[-1] - 1), -second)
    deviations = [np.std(held[..., max(end - second - 1, 0):end], axis=-1) for end in ends]
    return {"current_ripple": np.max(deviations, axis=0)}


REDUCTIONS: Mapping[str, Callable[[Array], Any]] = {
    "peak": lambda column: np.max(np.abs(column), axis=-1), "rms": rms,
    "share": lambda column: np.mean(column > 0.5, axis=-1)}
"""Functions of an output's column [runs, rows] that return a figure."""


def usage_figures(run: Run) -> dict[str, Any]:
    """Return the usage figures of the recorded outputs, from the excitation's `begin` on."""
    at = dict(zip(run.columns, since(run.excitation.begin, *run.columns.values()), strict=True))
    figures = {name: REDUCTIONS[figure.reduction](at[figure.needs[0]]) for name, figure in figures_of("usage").items()
               if figure.reduction and figure.needs[0] in at}
    if "supply_power" in at:
        steps = np.diff(at["time"], prepend=at["time"][0], append=at["time"][-1])
        figures |= power_figures(at["supply_power"], (steps[:-1] + steps[1:]) / 2.0)  # the trapezoidal rule
    return figures


def power_figures(power: Array, weights: Array) -> dict[str, Any]:
    """Return the usage figures of a power [W] whose rows have these weights [s] in its integral."""
    drawn, returned = np.maximum(power, 0.0), np.maximum(0.0 - power, 0.0)
    net, consumed, supplied, square, duration = (np.sum(column, axis=-1) for column in (
        weights * power, weights * drawn, weights * returned, weights * power * power, weights))
    with np.errstate(invalid="ignore"):  # a single row has no duration
        return {"peak_power": np.max(drawn, axis=-1), "peak_returned_power": np.max(returned, axis=-1),
                "energy_drawn": consumed, "energy_returned": supplied, "net_energy": net,
                "mean_power": net / duration, "rms_power": np.sqrt(square / duration)}


def leap_weights(count: int, step: float, leaps: Array) -> Array:
    """Return the weights of `count` rows, `step` [s] apart, in the integral of a power that jumps between the rows.

    The jumps are at `leaps` [s] after the first row, at least two rows apart. In an interval with a jump, except the
    first and the last, the power is extrapolated from either side up to the jump, along the line through the nearest
    two rows: with the trapezoidal rule, jumps that are synchronous with the rows would bias the integral.
    """
    weights = np.full(count, step)
    weights[[0, -1]] /= 2.0
    last = np.floor(leaps / step + 1e-6).astype(int)  # row before the leap
    inside = (last >= 1) & (last <= count - 3)
    before = last[inside]
    left = leaps[inside] - before * step
    for row, inner, length in ((before, -1, left), (before + 1, 1, step - left)):
        line = length**2 / (2.0 * step)
        weights[row] += length - step / 2.0 + line
        weights[row + inner] -= line
    return weights


def breakaway(moment: Array, angle: Array) -> float:
    """Return the magnitude of the moment at which the angle first leaves its start value; nan if it never does."""
    moved = np.flatnonzero(np.abs(angle - angle[0]) > CREPT)
    return float(abs(moment[moved[0]])) if len(moved) else nan


def bidirectional(below: Array, above: Array) -> dict[str, Any]:
    """Return the figures of errors [targets, cycles] of approaches from below and above, in the unit of the errors.

    Missing approaches are nan. `means` has the shape [sides, targets], `reversal` [targets]; both are nan where a side
    has no approach. Source: ISO 230-2 (2014), "Determination of accuracy and repeatability of positioning of
    numerically controlled axes".
    """
    errors = np.stack([below, above])  # side, target, cycle
    approached = ~np.isnan(errors).all(axis=2)
    means, spreads = np.full(approached.shape, np.nan), np.full(approached.shape, np.nan)
    means[approached] = errors[approached].mean(axis=1)
    spreads[approached] = errors[approached].std(axis=1, ddof=1) if errors.shape[2] > 1 else 0.0
    reversal = means[0] - means[1]
    both = ~np.isnan(reversal)
    return {"largest_error": float(np.nanmax(np.abs(errors))),
            "hysteresis": float(np.max(np.abs(reversal[both]), initial=0.0)),
            "repeatability": float(4.0 * np.nanmax(spreads)),
            "bidirectional_accuracy": float(np.nanmax(means + 2.0 * spreads) - np.nanmin(means - 2.0 * spreads)),
            "mean_error": float(np.nanmean(errors)), "means": means, "reversal": reversal}
