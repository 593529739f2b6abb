"""The thesis's Table 2 as data, and what is measured for each of its rows.

Section 3.1 of Yerlikaya (2016) lists the figures; it does not say how they are measured. The
ways chosen here are in each requirement's `how`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from math import degrees
from typing import Any, Literal

import numpy as np

from . import metrics
from .results import Criterion, Series

TABLE_2 = "Yerlikaya (2016), Table 2"
ACCURACY = 0.2  # deg
# A hundredth of the accuracy: differences to the reference must not show in any figure judged by Table 2.
TRAJECTORY_LIMIT = ACCURACY / 100.0  # deg
SWEPT = (0.5, 24.0)  # Hz; above, the sweep to 30 Hz ends within half a segment of the estimate

# Holds that outlast the integral action, whose time constant is kp/ki (1 s with the default gains).
HOLD = 3.0  # s
HOLDS: Mapping[str, tuple[float, float]] = {
    # name: command [deg], aerodynamic moment [N.m]
    "hold_plus20": (20.0, 0.0), "hold_minus20": (-20.0, 0.0), "hold_plus1": (1.0, 0.0), "hold_minus1": (-1.0, 0.0),
    "hold_loaded": (20.0, -100.0),
}
STEP_AT = 0.05  # s, of the holds

Runs = Mapping[str, Series]


def step_at(series: Series, number: int = 0) -> tuple[float, float, float]:
    """Instant [s], level [deg] and end [s] of the nth jump of a command that moves in steps."""
    time, command = series.inputs["time"], series.inputs["fin_command"]
    jumps = np.flatnonzero(np.diff(command)) + 1
    ends = np.append(time[jumps[1:]], time[-1])
    return float(time[jumps[number]]), degrees(command[jumps[number]]), float(ends[number])


def columns(series: Series, end: float) -> tuple[metrics.Array, metrics.Array, metrics.Array]:
    """Time [s], fin angle [deg] and rate [deg/s] up to a time."""
    time = series.run.columns["time"]
    upto = time <= end + 1e-9
    return (time[upto], np.degrees(series.run.columns["fin_angle"][upto]),
            np.degrees(series.run.columns["fin_rate"][upto]))


def step_of(series: Series, number: int = 0) -> metrics.StepMetrics:
    """Figures [deg] of the nth step, judged until the next."""
    start, level, end = step_at(series, number)
    time, angle, _ = columns(series, end)
    return metrics.step_metrics(time, angle, start, level)


def slew_of(series: Series, number: int = 0) -> metrics.Slew:
    """Rates [deg/s] of the nth step."""
    start, level, end = step_at(series, number)
    return metrics.slew(*columns(series, end), start, level)


def response_of(series: Series) -> metrics.FrequencyResponse:
    """Frequency response of a swept case."""
    run = series.run.columns
    return metrics.frequency_response(run["time"], series.inputs["fin_command"], run["fin_angle"], *SWEPT)


def held_error(series: Series) -> float:
    """Mean fin angle - command [deg] over the last 0.1 s."""
    time, angle, _ = columns(series, np.inf)
    return float(np.mean(angle[time > time[-1] - 0.1])) - step_at(series)[1]


def _range(runs: Runs) -> float:
    reached = [abs(step_at(runs[name])[1] + held_error(runs[name])) for name in ("hold_plus20", "hold_minus20")]
    return min(reached)


def _accuracy(runs: Runs) -> float:
    return max(abs(held_error(runs[name])) for name in ("hold_plus20", "hold_minus20", "hold_plus1", "hold_minus1"))


def _unloaded(runs: Runs) -> float:
    return min(slew_of(runs[name]).sustained for name in ("step_plus20", "step_minus20"))


def _loaded(runs: Runs) -> float:
    return slew_of(runs["load_opposing"], 1).sustained


def _bandwidth(name: str, runs: Runs) -> float:
    response = response_of(runs[name])
    if np.isnan(response.bandwidth) and np.all(np.isfinite(response.gain)):
        return float(response.frequency[-1])  # the gain does not fall by 3 dB within the sweep
    return response.bandwidth


@dataclass(frozen=True)
class Requirement:
    """A row of Table 2: the `needs` are the runs `measure` takes its figure [unit] from."""

    name: str
    title: str
    sense: Literal["<=", ">="]
    limit: float
    unit: str
    how: str
    needs: tuple[str, ...]
    measure: Callable[[Runs], float]


REQUIREMENTS = (
    Requirement("range", "Operating range of the fin", ">=", 20.0 - ACCURACY, "deg",
                f"smaller angle held at commands of +20 and -20 deg after {HOLD:g} s; the range is ±20 deg, "
                "its ends are met to the accuracy", ("hold_plus20", "hold_minus20"), _range),
    Requirement("accuracy", "Position accuracy of the fin", "<=", ACCURACY, "deg",
                f"largest error held after {HOLD:g} s at ±20 and ±1 deg, no load",
                ("hold_plus20", "hold_minus20", "hold_plus1", "hold_minus1"), _accuracy),
    Requirement("unloaded_rate", "Unloaded fin rate", ">=", 220.0, "deg/s",
                "mean over the middle 60 % of steps to ±20 deg, the slower of the two", ("step_plus20", "step_minus20"),
                _unloaded),
    Requirement("loaded_rate", "Fin rate against 100 N.m", ">=", 200.0, "deg/s",
                "mean over the middle 60 % of a slew from -20 to +20 deg", ("load_opposing",), _loaded),
    *(Requirement(f"bandwidth_{label}deg", f"Bandwidth at {amplitude} deg", ">=", 10.0, "Hz",
                  f"-3 dB of the fundamental, sine sweep of {amplitude} deg", (f"chirp_{label}deg",),
                  partial(_bandwidth, f"chirp_{label}deg"))
      for label, amplitude in (("1", "1"), ("3p5", "3.5"))),
)


def judge(requirement: Requirement, runs: Runs) -> Criterion:
    """The requirement's criterion; skipped where a run was not made, failed where it ended early."""
    r = requirement
    absent = [name for name in r.needs if name not in runs]
    broken = [name for name in r.needs if name in runs and runs[name].run.stopped is not None]
    measured, note = None, r.how
    if absent:
        note = f"needs {', '.join(absent)}, not run"
    elif broken:
        note = f"{', '.join(broken)} did not run to the end"
    else:
        measured = r.measure(runs)
        note = r.how if np.isfinite(measured) else f"the response never reaches what is measured: {r.how}"
    return Criterion("table2", r.name, r.title, measured, r.sense, r.limit, r.unit, TABLE_2, note, skipped=bool(absent))


def trajectory(name: str, title: str, series: Series, maximum: float) -> Criterion:
    """The fin angle's largest error [deg] to the reference."""
    note = ""
    measured: float | None = maximum
    run = series.exact
    if run.stopped is not None:
        last = run.messages[-1] if run.messages else "it gave no reason"
        measured, note = None, f"the FMU went no further than {run.stopped:.6g} s: {last}"
    return Criterion("trajectory", name, title, measured, "<=", TRAJECTORY_LIMIT, "deg",
                     f"1 % of the accuracy of {TABLE_2}", note)


def figures(kind: str, series: Series) -> dict[str, float]:
    """Performance figures of a case; empty where its run ended early."""
    if series.run.stopped is not None:
        return {}
    found: dict[str, Any] = {}
    if kind == "chirp":
        response = response_of(series)
        found = {"bandwidth_hz": response.bandwidth, "phase_bandwidth_hz": response.phase_bandwidth,
                 "lowest_coherence": float(np.min(response.coherence, initial=1.0))}
    elif kind in ("step", "cold", "sag", "load"):
        number = 1 if kind == "load" else 0
        step, rates = step_of(series, number), slew_of(series, number)
        found = {"rise_time_s": step.rise_time, "settling_time_s": step.settling_time,
                 "overshoot_percent": step.overshoot, "end_error_deg": step.steady_error,
                 "peak_rate_deg_per_s": rates.peak, "sustained_rate_deg_per_s": rates.sustained}
    return {name: float(value) for name, value in found.items()}


def time_to_accuracy(series: Series, number: int = 0) -> float:
    """Time [s] from a step until the angle stays within the accuracy of the command; inf if it does not."""
    start, level, end = step_at(series, number)
    time, angle, _ = columns(series, end)
    return metrics.time_to_accuracy(time, angle, start, level, ACCURACY)
