"""The experiments of a campaign: their excitations (motion and other inputs), and the figures of each kind of motion.

Figures are in SI and are measured from the start of the command.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, lru_cache
from math import degrees, inf, isnan, pi
from typing import Any

import numpy as np

from ...actuators import get
from ...bench.excitation import COMMAND, Excitation, motion
from ...bench.frequency_response import sweep_response, swept
from ...bench.metrics import Figure, figures_of, leap_weights, motion_figures, power_figures, usage_figures
from ...bench.runs import Run
from ...bench.subject import Subject, left_out
from ...motions import EXCITATIONS, FIELDS, LONGEST_MOTION, STEP
from ...parameters.schema import In
from ...simulation import Array

REQUIREMENT = "requirement"  # begins the names of the requirements' columns; no experiment may have this name
SAME, _TIME = None, In("s", -LONGEST_MOTION, LONGEST_MOTION)
PROFILES: Mapping[str, Mapping[str, In | None]] = {
    "constant": {"value": SAME},
    "step": {"before": SAME, "after": SAME, "at": _TIME},
    "window": {"value": SAME, "begin": _TIME, "end": _TIME, "outside": SAME},
    "sine": {"amplitude": SAME, "frequency": FIELDS["frequency"], "offset": SAME},
    "spring": {"stiffness": In("N.m/rad", -1e6, 1e6), "offset": SAME},  # its moment is computed once per row
}
"""Formats of the fields of each kind of input profile; SAME is that of the input."""
OPTIONAL_FIELDS = ("before", "outside", "offset")  # fields whose default is the input's start value
POWER = "supply_power"
# Rows of power for each row of the other outputs: the drive has short transients after each sample of the controllers.
POWER_ROWS = 5
_PERIOD = "controller.sample_time"


@dataclass(frozen=True)
class Profile:
    """One input over time; the numbers of its fields are named ``PREFIX.FIELD``."""

    variable: str
    kind: str
    prefix: str


@dataclass(frozen=True)
class Experiment:
    """A run that is made for every sample: a kind of motion, its `duration` [s] from the command, and other inputs."""

    name: str
    kind: str
    duration: float
    profiles: tuple[Profile, ...] = ()

    @property
    def prefix(self) -> str:
        """The beginning of the names of the motion's numbers."""
        return f"experiments.{self.name}"


def excitation(experiment: Experiment, values: Mapping[str, Any], numbers: Mapping[str, Any], model: str) -> Excitation:
    """Return the excitation of an experiment; times of profiles count from the command.

    `values` are the parameters of the `model` (flat, SI), `numbers` the numbers of motions and profiles (SI) by name.
    Values that differ between samples are arrays [samples]. Raises ValueError for numbers that contradict each other,
    such as a window that ends before it begins.
    """
    number = _finder(numbers, experiment.prefix, 0.0)
    amplitude, *shape = (number(field) for field in ("amplitude", *EXCITATIONS[experiment.kind].shape))
    each = zip(*(np.ravel(x).tolist() for x in np.broadcast_arrays(*shape)), strict=True) if shape else [()]
    motions = [_of_unit_amplitude(experiment.kind, experiment.duration, *fields) for fields in each]
    one, time = motions[0], motions[0].time - motions[0].begin
    command = one.command if len(motions) == 1 else np.stack([each.command for each in motions])
    columns: dict[str, Any] = {COMMAND: amplitude * command + 0.0}  # no -0.0 for a negative amplitude
    inputs = {v.name: v for v in get(model).inputs}
    spring: Any = 0.0
    for profile in experiment.profiles:
        v = inputs[profile.variable]
        number = _finder(numbers, profile.prefix, v.initial(values))
        if profile.kind == "spring":
            columns[v.name], spring = number("offset"), number("stiffness")
        else:
            columns[v.name] = _SHAPES[profile.kind](time, number)
    size = "" if np.ndim(amplitude) else f" of {degrees(amplitude):.6g} deg"
    return replace(one.holding(columns), title=experiment.kind + size,
                   spring=np.ravel(spring) if np.ndim(spring) else spring)


Number = Callable[[str], Any]


def _finder(numbers: Mapping[str, Any], prefix: str, start: Any) -> Number:
    """Return a function of a field that returns its number, [samples, 1] if samples differ; the default is `start`."""
    def number(field: str) -> Any:
        value = numbers.get(f"{prefix}.{field}", start)
        return np.asarray(value, dtype=float)[:, np.newaxis] if np.ndim(value) else float(value)
    return number


@lru_cache(maxsize=64)
def _of_unit_amplitude(kind: str, duration: float, *shape: float) -> Excitation:
    return motion(kind, 1.0, duration, **dict(zip(EXCITATIONS[kind].shape, shape, strict=True)))


def _from(time: Array, instant: Any) -> Any:
    """Return whether each row is at or after an `instant` [s], which is rounded to the nearest row."""
    return time > instant - STEP / 2


def _window(time: Array, number: Number) -> Any:
    begin, end = number("begin"), number("end")
    for first, last in np.broadcast(begin, end):
        if last < first:
            raise ValueError(f"a window's end = {last:g} s is before its begin = {first:g} s")
    return np.where(_from(time, begin) & ~_from(time, end), number("value"), number("outside"))


_SHAPES: Mapping[str, Callable[[Array, Number], Any]] = {
    "constant": lambda time, number: number("value"),
    "step": lambda time, number: np.where(_from(time, number("at")), number("after"), number("before")),
    "window": _window,
    # The sine is computed sample by sample: NumPy's vectorised sine could depend on the other samples.
    "sine": lambda time, number: number("offset") + number("amplitude") * np.apply_along_axis(
        np.sin, -1, 2.0 * pi * number("frequency") * np.maximum(time, 0.0)),
}


@cache
def figures(kind: str, model: str) -> Mapping[str, Figure]:
    """Return the figures in experiments of a `kind` for which the actuator has the outputs, by name."""
    outputs = {v.name for v in get(model).outputs}
    return {name: figure for name, figure in figures_of(*EXCITATIONS[kind].runs).items()
            if outputs.issuperset(figure.needs)}


def lacking(model: str) -> dict[str, list[str]]:
    """Return, by reason, the names of the figures that an actuator does not have."""
    return left_out(figures_of("jump", "sweep", "usage"), [v.name for v in get(model).outputs])


def measured(experiment: Experiment, numbers: Mapping[str, Any], run: Run, leaps: Sequence[Array]) -> dict[str, Any]:
    """Return the figures [runs] of finished runs by name; nan for a level that is never reached.

    The column POWER has POWER_ROWS values for each row. The power jumps at the times `leaps` [s] after the command: one
    array for all runs, or one for each run. Raises ValueError for a step without height.
    """
    columns = {name: column for name, column in run.columns.items() if name != POWER}
    rows = replace(run, columns=columns)
    begin = int(np.argmax(run.excitation.judged(columns["time"])))
    measures = usage_figures(rows)
    if POWER in run.columns:
        power = run.columns[POWER][..., begin * POWER_ROWS:]
        weights = [leap_weights(power.shape[-1], run.excitation.step / POWER_ROWS, each) for each in leaps]
        measures |= power_figures(power, weights[0] if len(weights) == 1 else np.stack(weights))
    if EXCITATIONS[experiment.kind].jumps:
        command, moves = run.excitation.command, run.excitation.moves
        before = moves[-2].level if len(moves) > 1 else command[..., 0]
        if np.any((command[..., -1] == before) | (command[..., -1] == columns["fin_angle"][..., begin])):
            raise ValueError("the step has no height: its command is the previous command or the fin's initial angle")
        measures |= motion_figures(rows, -1)  # the last move: a slew jumps to its starting end first
        measures["steady_error"] = np.abs(measures["steady_error"])
    if EXCITATIONS[experiment.kind].sweeps:
        count = len(columns["fin_angle"])
        ends = [np.broadcast_to(numbers[f"{experiment.prefix}.{side}"], count).tolist() for side in ("low", "high")]
        each = [_bandwidths(swept(sweep_response(rows.of(k), *band))) for k, band in enumerate(zip(*ends, strict=True))]
        measures |= {name: np.array([one[name] for one in each]) for name in each[0]}
    return measures


def _bandwidths(measures: dict[str, float]) -> dict[str, float]:
    """Return a sweep's figures; a bandwidth beyond the sweep is infinite, or 0 if the gain is always below -3 dB."""
    follows = measures["peak_gain"] >= -3.0
    beyond = inf if follows else 0.0
    gain, phase = measures["bandwidth_3db"], measures["bandwidth_90deg"]
    return {**measures, "bandwidth_3db": beyond if isnan(gain) or not follows else gain,
            "bandwidth_90deg": beyond if isnan(phase) else phase}


def leaps(subject: Subject, changes: Mapping[str, Any], run: Run) -> list[Array]:
    """Return the times [s] after the command at which a new reference reaches the drive: each sample plus the delay.

    The list has one array if the times are the same in all runs, otherwise one for each run. An array is empty if the
    sample time is shorter than two rows of power.
    """
    period, delay = changes.get(_PERIOD, subject.values[_PERIOD]), subject.transport_delay(changes)
    periods, delays = np.broadcast_arrays(np.atleast_1d(period), delay)
    pairs = [*zip(periods.tolist(), delays.tolist(), strict=True)]
    return [_leaps(*pair, run.excitation) for pair in (pairs if len(set(pairs)) > 1 else pairs[:1])]


def _leaps(period: float, delay: float, excitation: Excitation) -> Array:
    if period < 2.0 * excitation.step / POWER_ROWS:
        return np.empty(0)
    begin = excitation.begin
    first = np.ceil((begin - delay) / period - 1e-6)
    return np.arange(first, (excitation.stop - delay) / period) * period + delay - begin
