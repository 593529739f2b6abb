"""The current-mode drive from records of its reference and current, section 3.2.2.

The current loop, (2.46) with its PI controller, is linear while neither current nor voltage is limited:

    L di/dt = K_p (i_ref - i) + xi - R i - K_e w        dxi/dt = K_i (i_ref - i)        i_ref = K_v u(t - T_d) + i_off

A row's reference holds until the next row, as a DAC's does, and arrives T_d later, in general between two
rows: the exact discretisation is cut there (the modified z-transform), so that the delay is found to a
fraction of the sample interval. The steady gain right after a step is K_v K_p/(R + K_p), which creeps
towards K_v with the slow mode of the integral; a fast record tells delay and K_p, a slow one K_v and K_i.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ...actuators.electromechanical import nonlinear
from ...parameters import ParameterSet
from ...physics import drive
from . import pictures
from .current_loop import response
from .estimation import METHOD, Fit, fit
from .motion import ARRAYS
from .records import Array, Record, RecordError, read_records, refuse_clipped, refuse_magnitude
from .result import Estimate, Identification, Picture, noise

NAMES = ("drive.current_gain", "drive.current_offset", "drive.transport_delay", "drive.kp", "drive.ki")
GAIN, OFFSET, DELAY, KP, KI = range(5)
UNITS = ("A/V", "A", "s", "V/A", "V/(A.s)")
_GIVEN = ("motor.resistance", "motor.inductance", "motor.back_emf_constant")

FAST = 10.0  # samples of a fast record in the delay, at least
LONGEST_DELAY = 0.1  # s, of the parameter's range
FEWEST_LEVELS = 3
_LENGTH = 0.1  # of the integral's time that the longest record must last
_SETTLED = 5e-3  # s after an arrival from which a slow record, which cannot show a transient, counts again
_WORST = 0.25  # relative 1 sigma of gain, delay or K_p beyond which there is no answer
_LAG = 40.0  # V, a step of the reference is told from its noise by this many of its deviations


@dataclass(frozen=True)
class _Run:
    """One record with what the fit uses of it: rows `used`, and whether it is `fast`."""

    record: Record
    reference: Array
    current: Array
    speed: Array | None
    used: Any
    fast: bool


def identify(paths: Sequence[Path], base: ParameterSet) -> Identification:
    """The drive's parameters from records with drive_reference and motor_current, and motor_speed unless clamped.

    Raises RecordError.
    """
    records = read_records(paths, ("drive_reference", "motor_current"), ("motor_speed",))
    values = base.values
    for record in records:
        _check(record, values)
    fast = [r for r in records if _is_fast(r)]
    if not fast:
        found = min(r.step for r in records)
        raise RecordError("the sample rate is too low for the transport delay and the current loop: the fastest record "
                          f"has a sample every {found * 1e3:.3g} ms; log at least one record with steps of the "
                          f"reference every {_needed(values) * 1e3:.2g} ms or less (a few L/(R + Kp), and a tenth of "
                          "the delay)")
    start = _delay(fast, values)
    _require_rate(start + 2.0 * _needed(values), min(r.step for r in fast))
    runs = [_run(r, start) for r in records]
    _require_levels(runs)
    _require_slopes(runs, start, values)
    _require_length(runs, values)
    found_fit = _fit(runs, start, values)
    _require_answer(found_fit, runs, values)
    estimates = [Estimate(name, float(value), float(sigma), unit, True, float(values[name]))
                 for name, value, sigma, unit in zip(NAMES, found_fit.values, found_fit.sigmas, UNITS)]
    groups = [[i] for i in range(len(runs))]
    return Identification(
        "drive", "Drive: current gain, offset, transport delay and current loop", records, estimates,
        {name: float(values[name]) for name in _GIVEN}, METHOD, _notes(runs, found_fit, values),
        _pictures(runs, found_fit, values), (NAMES, found_fit.correlation[:5, :5]),
        noise(records, found_fit, groups, "A"))


def _needed(values: Mapping[str, Any]) -> float:
    """The longest sample interval [s] of a fast record, for the base set's current loop."""
    return float(values["motor.inductance"] / (values["motor.resistance"] + values["drive.kp"]))


def _is_fast(record: Record) -> bool:
    # Its own current tells later whether it was fast enough; 1 ms is slower than any current loop.
    return record.step <= 1e-3


def _check(record: Record, values: Mapping[str, Any]) -> None:
    refuse_magnitude(record, "drive_reference", 1.1 * values["drive.reference_limit"], "1.1 times "
                                                                                       "drive.reference_limit")
    refuse_magnitude(record, "motor_current", 2.0 * values["drive.current_limit"], "2 times drive.current_limit")
    refuse_clipped(record, "motor_current")
    reference, current = record["drive_reference"], record["motor_current"]
    if np.abs(reference).max() > 0.999 * values["drive.reference_limit"]:
        raise record.fail(f"drive_reference is saturated: it reaches drive.reference_limit = "
                          f"{values['drive.reference_limit']:g} V; excite less")
    if np.abs(current).max() > 0.98 * values["drive.current_limit"]:
        raise record.fail(f"motor_current is saturated: it reaches {np.abs(current).max():.3g} A at a "
                          f"drive.current_limit of {values['drive.current_limit']:g} A; excite less")
    if np.ptp(reference) < 20.0 * _restless(reference):
        raise record.fail(f"drive_reference hardly moves ({np.ptp(reference):.3g} V): there is nothing to answer to; "
                          "step it, over a few tenths of a volt at least")


def _restless(x: Array) -> float:
    """Noise of a signal that steps now and then: robust deviation of its differences, with a floor at rounding."""
    steps = np.diff(x)
    return float(1.4826 * np.median(np.abs(steps - np.median(steps))) / 2.0**0.5) + 1e-9


def _changes(reference: Array) -> Any:
    """Rows at which the reference takes another level."""
    return np.flatnonzero(np.abs(np.diff(reference)) > max(_LAG * _restless(reference) / 5.0, 1e-3)) + 1


def _run(record: Record, delay: float) -> _Run:
    reference, current = record["drive_reference"], record["motor_current"]
    fast = _is_fast(record)
    used = np.ones(len(record), dtype=bool)
    if not fast:
        after = int(np.ceil((delay + _SETTLED) / record.step)) + 1
        for change in _changes(reference):
            used[change - 1:change + after] = False
    speed = record.columns.get("motor_speed")
    return _Run(record, reference, current, speed, used, fast)


def _delay(fast: Sequence[Record], values: Mapping[str, Any]) -> float:
    """A first delay: that shift of the reference which fits the current best, over the fast records."""
    step = min(r.step for r in fast)
    shifts = np.arange(0.0, min(LONGEST_DELAY, 0.5 * min(len(r) * r.step for r in fast)), step)
    lost = np.zeros(len(shifts))
    for r in fast:
        u, i = r["drive_reference"], r["motor_current"]
        time = np.arange(len(r)) * r.step
        for k, shift in enumerate(shifts):
            u_late = np.interp(time - shift, time, u)
            line = np.column_stack([u_late, np.ones(len(u_late))])
            lost[k] += float(np.sum((i - line @ np.linalg.lstsq(line, i, rcond=None)[0]) ** 2) / np.var(i))
    best = int(np.argmin(lost))
    share = 1.0 - lost[best] / sum(len(r) for r in fast)
    if share < 0.5:
        raise fast[0].fail(f"motor_current does not follow drive_reference: at the best delay it explains {share:.0%} "
                           "of the current; check that the columns belong together, that the drive was enabled, and "
                           "the units in the header")
    return max(float(shifts[best]) - _needed(values), 0.0)


def _require_levels(runs: Sequence[_Run]) -> None:
    levels: list[float] = []
    for run in runs:
        for level in sorted(run.reference[run.used]):
            if all(abs(level - known) > 0.05 for known in levels):
                levels.append(float(level))
    if len(levels) < FEWEST_LEVELS or min(levels) >= 0.0 or max(levels) <= 0.0:
        raise RecordError(f"the reference takes {len(levels)} level(s) ({min(levels):.3g} to {max(levels):.3g} V): "
                          f"gain and offset need at least {FEWEST_LEVELS}, of both signs")


def _require_slopes(runs: Sequence[_Run], delay: float, values: Mapping[str, Any]) -> None:
    """Each record's own slope of current against the late reference: near the base set's, and near each other."""
    slopes = []
    for run in runs:
        time = np.arange(len(run.record)) * run.record.step
        late = np.interp(time - delay - _needed(values), time, run.reference)[run.used]
        slopes.append(float(np.polyfit(late, run.current[run.used], 1)[0]))
        if slopes[-1] <= 0.0:
            raise run.record.fail(f"motor_current falls with drive_reference ({slopes[-1]:.3g} A/V): one of them has "
                                  "the wrong sign")
        if not 0.1 < slopes[-1] / values["drive.current_gain"] < 10.0:
            raise run.record.fail(f"motor_current rises by {slopes[-1]:.4g} A per volt of drive_reference, "
                                  f"{slopes[-1] / values['drive.current_gain']:.3g} times what the base parameters "
                                  "say: check the units of both in the header")
        if not 0.6 < slopes[-1] / slopes[0] < 1.7:
            raise run.record.fail(f"motor_current rises by {slopes[-1]:.4g} A per volt of drive_reference, but by "
                                  f"{slopes[0]:.4g} in {runs[0].record.name}: check the units of both files' headers, "
                                  "and that they are of one drive")


def _fit(runs: Sequence[_Run], start: float, values: Mapping[str, Any]) -> Fit:
    slow = [r for r in runs if not r.fast] or list(runs)
    u = np.concatenate([r.reference[r.used] for r in slow])
    i = np.concatenate([r.current[r.used] for r in slow])
    slope, offset = np.polyfit(u, i, 1)
    lowest = np.array([-np.inf, -np.inf, 0.0, 1e-3 * values["drive.kp"], *[-np.inf] * (1 + len(runs))])
    sizes = np.array([slope, 0.1, 1e-3, values["drive.kp"], max(values["drive.ki"], 1e-2), *[0.1] * len(runs)])

    def residuals(x: Array) -> list[Array]:
        x = np.maximum(x, lowest)
        return [(r.current - response(x[:5], float(x[5 + k]), r.reference, r.speed, r.record.step, values))[r.used]
                for k, r in enumerate(runs)]

    # The fit is flat between samples far from the delay: the best of a few starts, kp's among them.
    tried = []
    for delay in start + np.array([0.0, 0.5, 1.0, 1.5]) * _needed(values):
        for kp in np.array([0.3, 1.0, 3.0]) * values["drive.kp"]:
            x = np.array([slope * (1.0 + values["motor.resistance"] / kp), offset, delay, kp, values["drive.ki"],
                          *[0.0] * len(runs)])
            tried.append((sum(float(r @ r) / len(r) for r in residuals(x)), x))
    begin = min(tried, key=lambda pair: pair[0])[1]
    return fit(residuals, begin, sizes, [[k] for k in range(len(runs))])


def _require_rate(delay: float, step: float) -> None:
    if delay < FAST * step:
        raise RecordError(f"the sample rate is too low for the delay: {delay * 1e3:.3g} ms is {delay / step:.2g} "
                          f"samples of the fastest record; log at {FAST / max(delay, 1e-4):.3g} Hz or more")


def _require_length(runs: Sequence[_Run], values: Mapping[str, Any]) -> None:
    """A record within the integral's first moments shows the proportional part alone, and calls it the whole."""
    if values["drive.ki"] <= 0.0:
        return
    slow = (values["motor.resistance"] + values["drive.kp"]) / values["drive.ki"]
    longest = max(len(r.record) * r.record.step for r in runs)
    if longest < _LENGTH * slow:
        raise RecordError(
            f"the longest record lasts {longest:.3g} s, but by the base parameters the drive's integral takes "
            f"(R + Kp)/Ki = {slow:.3g} s to act: gain and Ki cannot be told from it. Add a slow staircase of "
            f"{_LENGTH * slow:.3g} s or more, or give base parameters whose drive.ki is nearer the truth (0: no "
            "integral)")


def _require_answer(found: Fit, runs: Sequence[_Run], values: Mapping[str, Any]) -> None:
    gain, offset, delay, kp, ki = found.values[:5]
    step = min(r.record.step for r in runs)
    tau = values["motor.inductance"] / (values["motor.resistance"] + kp)
    _require_rate(delay, step)
    if tau < 0.7 * step:
        raise RecordError(f"the sample rate is too low for the current loop: the current settles within "
                          f"{tau * 1e3:.2g} ms, between two samples {step * 1e3:.2g} ms apart, so that delay and Kp "
                          f"cannot be told apart; log at {1.0 / tau:.3g} Hz or more")
    for index in (GAIN, DELAY, KP):
        if not found.sigmas[index] < _WORST * abs(found.values[index]):
            raise RecordError(f"{NAMES[index]} is not supported by the data: {found.values[index]:.3g} +- "
                              f"{found.sigmas[index]:.2g} {UNITS[index]}; record more and larger steps, fast logged")
    if ki < 0.0 and ki < -2.0 * found.sigmas[KI]:
        raise RecordError(f"drive.ki is found as {ki:.3g} V/(A.s), below 0: the current creeps away from its "
                          "reference; check that the winding did not heat up, and motor.resistance")
    supply = float(values["drive.supply_voltage"])
    for k, run in enumerate(runs):
        if not run.fast:
            continue
        x = found.values
        current = response(x[:5], x[5 + k], run.reference, run.speed, run.record.step, values)
        shift = np.interp(np.arange(len(run.record)) * run.record.step - delay,
                          np.arange(len(run.record)) * run.record.step, run.reference)
        p = nonlinear.ACTUATOR.namespace(
            {**values, "drive.current_gain": gain, "drive.current_offset": offset, "drive.kp": kp})
        demand = np.abs(drive.voltage_demand(p, drive.current_reference(ARRAYS, p, shift), current, x[5 + k]))
        if demand.max() > supply:
            raise run.record.fail(f"the drive's voltage is saturated: the steps ask for {demand.max():.3g} V of a "
                                  f"supply of {supply:g} V, so that their rise tells the supply and not Kp; take steps "
                                  f"below {0.9 * supply / (kp * gain):.2g} V")


def _notes(runs: Sequence[_Run], found: Fit, values: Mapping[str, Any]) -> list[str]:
    _, _, delay, kp, ki = found.values[:5]
    step = min(r.record.step for r in runs)
    resistance, inductance = values["motor.resistance"], values["motor.inductance"]
    slow = (resistance + kp) / ki if ki > 0.0 else float("inf")
    lines = [
        f"The delay is {delay / step:.2f} samples of the fastest record; it includes whatever the two channels of the "
        "logger differ in, and counts from the row at which a reference first stands.",
        f"Current loop: {inductance / (resistance + kp) * 1e3:.3g} ms, then {slow:.3g} s for the integral; right after "
        f"a step {kp / (resistance + kp):.1%} of the current demanded flow.",
        "Kp scales with motor.inductance and motor.resistance, whose own uncertainty is not included.",
    ]
    if found.sigmas[KI] > 0.3 * abs(ki):
        lines.append("drive.ki is poorly known: hold the reference for a good part of the integral's time, slowly "
                     "logged.")
    if all(r.speed is None for r in runs):
        lines.append("No record has motor_speed: the rotor was taken as clamped.")
    return lines


def _pictures(runs: Sequence[_Run], found: Fit, values: Mapping[str, Any]) -> list[Picture]:
    x = found.values

    def modelled(k: int) -> Array:
        r = runs[k]
        return response(x[:5], x[5 + k], r.reference, r.speed, r.record.step, values)

    def overlay() -> Any:
        parts = []
        for k, r in enumerate(runs):
            time = r.record["time"] - r.record["time"][0]
            stop = np.searchsorted(time, 0.03) if r.fast else len(time)
            parts.append((r.record.name, [pictures.Series("model", time[:stop], r.current[:stop], time[:stop],
                                                          modelled(k)[:stop], None)]))
        return pictures.panels(parts, "time [s]", "motor current [A]", sharey=False)

    def line() -> Any:
        series = []
        for r in runs:
            order = np.argsort(r.reference[r.used])
            u, i = r.reference[r.used][order], r.current[r.used][order]
            if not r.fast:
                series.append(pictures.Series(r.record.name, u, i, u, x[GAIN] * u + x[OFFSET], None))
        return pictures.panels([("", series)], "reference [V]", "motor current [A]")

    def one_step() -> Any:
        """All steps of the fast records on each other, as shares of the step, in time from the arrival."""
        parts = []
        for k, r in enumerate(runs):
            if not r.fast:
                continue
            model = modelled(k)
            h = r.record.step
            before, after = int(0.3e-3 / h) + 1, int(1.2e-3 / h) + 1
            times, shares = [], []
            for change in _changes(r.reference):
                at = change + int(x[DELAY] / h)
                if at - before < 0 or at + after > len(model):
                    continue
                size = model[at + after - 1] - model[at - 1]
                if abs(size) < 0.3 * np.ptp(r.current) / 2.0:
                    continue
                rows = np.arange(at - before, at + after)
                times.append((rows - change) * h * 1e3)
                shares.append((r.current[rows] - model[at - 1]) / size)
            if not times:
                continue
            t, s = np.concatenate(times), np.concatenate(shares)
            grid = np.linspace(t.min(), t.max(), 300)
            tau = values["motor.inductance"] / (values["motor.resistance"] + x[KP]) * 1e3
            curve = np.where(grid > x[DELAY] * 1e3, 1.0 - np.exp(-np.maximum(grid - x[DELAY] * 1e3, 0.0) / tau), 0.0)
            parts.append((r.record.name, [pictures.Series("model", t, s, grid, curve, None)]))
        return pictures.panels(parts or [("no single steps", [])], "time since the step of the reference [ms]",
                               "share of the step")

    def residual_series() -> list[tuple[str, Array, Array]]:
        # Records of a tenth of a second and of a minute are shown on one axis.
        return [(r.record.name, (t := r.record["time"][r.used]) / t[-1], res)
                for r, res in zip(runs, found.residuals, strict=True)]

    return [
        Picture("Current against time", "Measured current and the fitted current loop; of fast records the first 30 "
                                        "ms.",
                overlay),
        Picture("Steps of the reference", "The larger steps of the fast records, scaled and laid on each other: the "
                                          "delay is where the rise begins, L/(R + Kp) its time constant.", one_step),
        Picture("Steady current against reference", "Slow records, transients left out; the line has the identified "
                                                    "gain "
                "and offset. Points lie off it by what the integral has not yet made up for.", line),
        pictures.residuals(residual_series, "share of the record's time", "residual current [A]", found),
    ]
