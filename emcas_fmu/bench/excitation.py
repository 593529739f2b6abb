"""The excitations of the bench: rows of inputs that are given to an actuator, each held until the next.

Angles are in rad, moments in N.m, times in s, frequencies in Hz. Every motion begins after a rest (LEAD_IN; a slew
after SETTLE at its starting end), and every load comes on within LOAD_RISE of the command, as in the reference cases.
"""

from __future__ import annotations

import csv
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from math import degrees, log, pi
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ..actuators import NONLINEAR, get
from ..errors import EmcasError
from ..reference.cases import CASES, LEAD_IN, LOAD_RISE, SWEEP
from ..simulation import MOST_POINTS, Array

STEP = 1e-3  # s
SETTLE = 1.0  # s at the starting end of a slew, unloaded: three times what the settling of a large step takes
COMMAND, LOAD = "fin_command", "aero_torque"


class Move(NamedTuple):
    """A jump of the command: its instant [s], the level [rad], and when the next one comes or the rows end [s]."""

    start: float
    level: float
    end: float


@dataclass(frozen=True, kw_only=True)
class Excitation(ABC):
    """Rows of inputs `step` [s] apart from 0, and parameters that differ with them.

    A `spring` [N.m/rad] takes its moment, by the fin angle at the beginning of each row, off the hinge moment.
    """

    step: float = STEP
    start_values: Mapping[str, Any] = field(default_factory=dict, hash=False)
    spring: float = 0.0

    @property
    @abstractmethod
    def title(self) -> str:
        """What is done, in a few words."""

    @property
    def begin(self) -> float:
        """When what is judged begins [s]."""
        return LEAD_IN

    @property
    @abstractmethod
    def stop(self) -> float:
        """The time of the last row [s]."""

    @abstractmethod
    def rows(self, time: Array) -> Mapping[str, Array]:
        """Columns of the inputs that are given, at these times [s]."""

    @cached_property
    def time(self) -> Array:
        """Times of the rows [s]: the floats a host gets that counts its steps."""
        return np.arange(round(self.stop / self.step) + 1) * self.step

    @cached_property
    def columns(self) -> Mapping[str, Array]:
        """Columns of the inputs that are given, by name, SI."""
        return self.rows(self.time)

    @property
    def command(self) -> Array:
        """The column of the command [rad]."""
        return self.columns.get(COMMAND, np.zeros(len(self.time)))

    @cached_property
    def moves(self) -> tuple[Move, ...]:
        """The jumps of a command that moves in steps."""
        jumps = np.flatnonzero(np.diff(self.command)) + 1
        ends = [*self.time[jumps].tolist(), float(self.time[-1])]
        return tuple(Move(start, float(self.command[row]), end)
                     for row, (start, end) in zip(jumps, pairwise(ends), strict=True))

    def after(self, time: Array, instant: float) -> Any:
        """Whether each row is at an instant [s] or later; one that is a rounding short of it is."""
        return time > instant - self.step / 2

    def holding(self, columns: Mapping[str, Any]) -> Inputs:
        """The same with further inputs, each a column or a constant."""
        held = {name: np.broadcast_to(np.asarray(column, dtype=float), self.time.shape).copy()
                for name, column in columns.items()}
        return Inputs(self.title, {**self.columns, **held}, self.begin, step=self.step,
                      start_values=self.start_values, spring=self.spring)

    def with_start_values(self, values: Mapping[str, Any]) -> Any:
        """The same with further parameters that differ."""
        return replace(self, start_values={**self.start_values, **values})


@dataclass(frozen=True)
class Inputs(Excitation):
    """Columns as they are."""

    name: str
    given: Mapping[str, Array] = field(hash=False)
    judged_from: float = 0.0

    @property
    def title(self) -> str:
        return self.name

    @property
    def begin(self) -> float:
        return self.judged_from

    @property
    def stop(self) -> float:
        return (len(next(iter(self.given.values()))) - 1) * self.step

    def rows(self, time: Array) -> Mapping[str, Array]:
        return self.given


@dataclass(frozen=True)
class Step(Excitation):
    """From rest at zero to a level [rad], held for `duration`; a `load` [N.m] comes on with the command."""

    level: float
    duration: float
    load: float = 0.0

    @property
    def title(self) -> str:
        return f"step to {degrees(self.level):+.6g} deg{_with(self.load)}"

    @property
    def stop(self) -> float:
        return self.begin + self.duration

    def rows(self, time: Array) -> Mapping[str, Array]:
        return {COMMAND: np.where(self.after(time, self.begin), self.level, 0.0), **_rising(self, time)}


@dataclass(frozen=True)
class Slew(Step):
    """From rest at -level to +level [rad], as `Step`."""

    @property
    def title(self) -> str:
        return f"slew from {-degrees(self.level):+.6g} to {degrees(self.level):+.6g} deg{_with(self.load)}"

    @property
    def begin(self) -> float:
        return SETTLE

    def rows(self, time: Array) -> Mapping[str, Array]:
        command = np.where(self.after(time, self.begin), self.level, -self.level)
        command[0] = 0.0
        return {COMMAND: command, **_rising(self, time)}


def _with(load: float) -> str:
    return f" with {load:+g} N.m" if load else ""


def _rising(step: Step, time: Array) -> dict[str, Array]:
    return {LOAD: step.load * np.clip((time - step.begin) / LOAD_RISE, 0.0, 1.0)} if step.load else {}


@dataclass(frozen=True)
class Sweep(Excitation):
    """Logarithmic sine sweep of the command between two frequencies."""

    amplitude: float
    duration: float
    low: float = SWEEP[0]
    high: float = SWEEP[1]

    def __post_init__(self) -> None:
        if not self.low < self.high:
            raise ValueError(f"the sweep's low = {self.low:g} Hz is not below its high = {self.high:g} Hz")

    @property
    def title(self) -> str:
        return f"sine sweep of {degrees(self.amplitude):.6g} deg"

    @property
    def stop(self) -> float:
        return self.begin + self.duration

    def rows(self, time: Array) -> Mapping[str, Array]:
        growth = log(self.high / self.low) / self.duration
        since = np.maximum(time - self.begin, 0.0)
        return {COMMAND: self.amplitude * np.sin(2.0 * pi * self.low * np.expm1(growth * since) / growth)}


@dataclass(frozen=True)
class Sine(Excitation):
    """Sine of the command: `settle` is cycles, and at least s, of transient before the `cycles` to be looked at."""

    amplitude: float
    frequency: float
    cycles: float = 6.0
    settle: tuple[float, float] = (4.0, 0.5)

    @property
    def title(self) -> str:
        return f"sine of {degrees(self.amplitude):.6g} deg at {self.frequency:g} Hz"

    @property
    def begin(self) -> float:
        return max(self.settle[0] / self.frequency, self.settle[1])

    @property
    def stop(self) -> float:
        return self.begin + self.cycles / self.frequency

    def rows(self, time: Array) -> Mapping[str, Array]:
        return {COMMAND: self.amplitude * np.sin(2.0 * pi * self.frequency * time)}

    def looked_at(self, time: Array) -> Any:
        """Whether each row is one of the last whole cycles."""
        return time > time[-1] - self.cycles / self.frequency - self.step / 2


@dataclass(frozen=True)
class LoadSine(Sine):
    """Cosine of the hinge moment [N.m], command at zero: it gives a free inertia at rest no drift, as a sine would."""

    @property
    def title(self) -> str:
        return f"hinge moment of {self.amplitude:g} N.m at {self.frequency:g} Hz"

    def rows(self, time: Array) -> Mapping[str, Array]:
        return {LOAD: self.amplitude * np.cos(2.0 * pi * self.frequency * time)}


@dataclass(frozen=True)
class LoadRamp(Excitation):
    """The hinge moment from zero to `moment` [N.m] in `duration`."""

    moment: float
    duration: float

    @property
    def title(self) -> str:
        return f"hinge moment up to {self.moment:+g} N.m"

    @property
    def stop(self) -> float:
        return self.duration

    def rows(self, time: Array) -> Mapping[str, Array]:
        return {LOAD: self.moment * time / self.duration}


@dataclass(frozen=True)
class Staircase(Excitation):
    """The command at each level [rad] for its time [s]; judged is the last."""

    levels: tuple[float, ...]
    holds: tuple[float, ...]

    @property
    def title(self) -> str:
        return f"{len(self.levels)} levels of the command"

    @property
    def begin(self) -> float:
        return sum(self.holds[:-1])

    @property
    def stop(self) -> float:
        return sum(round(hold / self.step) for hold in self.holds) * self.step

    def rows(self, time: Array) -> Mapping[str, Array]:
        held = np.repeat(self.levels, [round(hold / self.step) for hold in self.holds])
        return {COMMAND: np.append(held, held[-1])}


def reference_case(name: str, exact: bool = True) -> Inputs:
    """A reference case by name. Raises EmcasError, naming those there are.

    Trajectories are compared with true angle and speed fed back (`exact`); performance is that with the encoder.
    """
    found = {case.name: case for case in CASES}.get(name)
    if found is None:
        raise EmcasError(f"there is no case {name}; there is {', '.join(case.name for case in CASES)}")
    columns = {variable: column for variable, column in found.inputs().items() if variable != "time"}
    return Inputs(found.title, columns, LEAD_IN, step=found.step,
                  start_values={key: value for key, value in found.overrides.items()
                                if exact or not key.startswith("encoder.")})


def csv_file(path: Path, step: float = STEP, stop: float | None = None, model: str = NONLINEAR) -> Inputs:
    """A CSV file with a column ``time`` [s] and columns of inputs of a model, SI, as fmpy reads it.

    Between its rows inputs are interpolated; where two rows have the same time they jump. The run
    begins at 0: inputs before the first row are those of it.
    Raises EmcasError for what is no such file.
    """
    found = _read(path)
    inputs = [v.name for v in get(model).inputs]
    if "time" not in found:
        raise EmcasError(f"{path}: has no column time; its columns are {', '.join(found)}")
    if unknown := [name for name in found if name not in (*inputs, "time")]:
        raise EmcasError(f"{path}: {', '.join(unknown)} is no input; inputs are {', '.join(inputs)}")
    if len(found) < 2:
        raise EmcasError(f"{path}: has no column of an input; inputs are {', '.join(inputs)}")
    time = np.atleast_1d(found.pop("time"))
    if not np.isfinite(time).all() or np.any(np.diff(time) < 0.0) or time[0] < 0.0:
        raise EmcasError(f"{path}: time must be finite, begin at 0 or later and not run backwards")
    end = float(time[-1]) if stop is None else stop
    check_span(str(path), step, end)
    points = np.arange(round(end / step) + 1) * step
    columns = {}
    for name, column in found.items():
        if not np.isfinite(column).all():
            raise EmcasError(f"{path}: {name} has an empty or non-finite value")
        columns[name] = _sampled(points, time, np.atleast_1d(column))
    return Inputs(path.name, columns, step=step)


def _read(path: Path) -> dict[str, Array]:
    """Columns of a CSV file with one line of names, quoted or not."""
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            header, *lines = [row for row in csv.reader(file, skipinitialspace=True) if row]
        table = np.array([[float(cell) for cell in row] for row in lines])
        if not lines or table.ndim != 2 or table.shape[1] != len(header):
            raise ValueError("it needs a line of names, and below it lines of as many numbers")
    except (OSError, ValueError) as error:
        raise EmcasError(f"{path}: cannot be read as a table of numbers: {error}") from error
    names = [name.strip() for name in header]
    if twice := sorted({name for name in names if names.count(name) > 1}):
        raise EmcasError(f"{path}: column {', '.join(twice)} is given twice")
    return dict(zip(names, table.T, strict=True))


def check_span(what: str, step: float, stop: float) -> None:
    """Raise EmcasError where rows `step` [s] apart do not end at `stop` [s], or are too many."""
    if not step <= stop <= MOST_POINTS * step:
        raise EmcasError(f"{what}: the end at {stop:g} s must be 1 to {MOST_POINTS:g} steps of {step:g} s from 0; "
                         "see --stop and --interval")
    if abs(stop / step - round(stop / step)) > 1e-6:
        raise EmcasError(f"{what}: the end at {stop:g} s is no whole number of steps of {step:g} s; see --stop and "
                         "--interval")


def _sampled(points: Array, time: Array, column: Array) -> Array:
    """Linear between rows, from the right at a jump, held outside."""
    after = np.searchsorted(time, points * (1.0 + 1e-12), side="right")  # a point a rounding short of a row is on it
    low, high = np.clip(after - 1, 0, len(time) - 1), np.clip(after, 0, len(time) - 1)
    span = time[high] - time[low]
    share = np.where(span > 0.0, (points - time[low]) / np.where(span > 0.0, span, 1.0), 0.0)
    sampled: Array = column[low] + np.clip(share, 0.0, 1.0) * (column[high] - column[low])
    return sampled
