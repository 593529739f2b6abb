"""The excitations of the bench: rows of an actuator's inputs, each held until the next row.

Angles are in rad, moments in N.m, times in s, frequencies in Hz. The kinds of `motions.py` begin after LEAD_IN at rest,
a slew by default after SETTLE at its starting end; the load of a step or slew rises within LOAD_RISE after the command.
"""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from math import degrees, inf, pi
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ..actuators import NONLINEAR, get
from ..errors import ArgumentError, EmcasError, unreadable
from ..fmi.interface import FmuInterface
from ..motions import EXCITATIONS, FASTEST, LEAD_IN, SETTLE, STEP, SWEEP
from ..reference.cases import CASES, SUPPLY_START, select, with_supply
from ..simulation import MOST_POINTS, Array
from ..support.arguments import brief, checked

HOLD = 3.0  # s, time at a constant command: many time constants kp/ki of the integral action (default: 0.24 s)
COMMAND, LOAD = "fin_command", "aero_torque"


class Move(NamedTuple):
    """A jump of the command at `start` [s] to a `level` [rad], for many runs an array [runs].

    The level ends at the next jump or in the last row, at `end` [s].
    """

    start: float
    level: Any
    end: float


@checked
@dataclass(frozen=True, eq=False)
class Excitation:
    """Inputs over time: `columns` by name, SI, with rows every `step` [s] from 0.

    For many runs a column is an array [runs, rows], or broadcasts to one. Rows are judged from `begin` [s] on. `spring`
    is a stiffness [N.m/rad], a number or an array [runs]: this stiffness times the fin angle at each row is
    subtracted from the hinge moment until the next row. `start_values` are parameters by name that replace those of the
    subject. Raises ArgumentError unless all columns have the same number of rows, 2 or more, and `step` is above 0.
    """

    title: str
    columns: Mapping[str, Array] = field(repr=False)
    begin: float = 0.0
    step: float = STEP
    start_values: Mapping[str, Any] = field(default_factory=dict)
    spring: float | Array = 0.0

    def __post_init__(self) -> None:
        shapes = {name: np.shape(column) for name, column in self.columns.items()}
        try:
            rows = next(iter(shapes.values()), ())[-1:]
            sound = all(shapes.values()) and rows > (1,) and np.broadcast_shapes(*shapes.values())[-1:] == rows
        except ValueError:
            sound = False
        if not (sound and self.step > 0.0):
            raise ArgumentError(f"{self.title}: columns of shapes {brief(shapes)}, rows {self.step:g} s apart: "
                                "expected columns with the same number of rows, 2 or more, and a step above 0")

    @cached_property
    def time(self) -> Array:
        """The times of the rows [s]: multiples of the step, without accumulated rounding."""
        return np.arange(next(iter(self.columns.values())).shape[-1]) * self.step

    @property
    def stop(self) -> float:
        """The time of the last row [s]."""
        return float(self.time[-1])

    @property
    def command(self) -> Array:
        """The column of the command [rad], zeros without one."""
        return self.columns.get(COMMAND, np.zeros(len(self.time)))

    @cached_property
    def moves(self) -> tuple[Move, ...]:
        """The changes of the command from row to row; for many runs those in any run."""
        differ = np.diff(self.command) != 0.0
        jumps = np.flatnonzero(differ.any(axis=tuple(range(differ.ndim - 1)))) + 1
        ends = [*self.time[jumps].tolist(), self.stop]
        return tuple(Move(start, self.command[..., row][()], end)
                     for row, (start, end) in zip(jumps, pairwise(ends), strict=True))

    def judged(self, time: Array) -> Any:
        """Return whether each time [s] is judged: at `begin` or later, with half a `step` of tolerance."""
        return np.asarray(time) > self.begin - self.step / 2

    def holding(self, columns: Mapping[str, Any]) -> Excitation:
        """Return the excitation with inputs added or replaced: columns, constants, or constants for runs [runs, 1]."""
        added = {name: np.broadcast_to(np.asarray(column, dtype=float),
                                         np.broadcast_shapes(np.shape(column), self.time.shape))
                   for name, column in columns.items()}
        return replace(self, columns={**self.columns, **added})

    def of(self, runs: int | Array) -> Excitation:
        """Return the excitation of the run with an index, or of the runs in an array of indices."""
        columns = {name: column[np.minimum(runs, len(column) - 1)] if column.ndim == 2 else column
                   for name, column in self.columns.items()}
        spring = np.asarray(self.spring)
        return replace(self, columns=columns, spring=spring[runs] if spring.ndim else self.spring)

    def with_start_values(self, values: Mapping[str, Any]) -> Excitation:
        """Return the excitation with additional `start_values`."""
        return replace(self, start_values={**self.start_values, **values})


@checked
def times(stop: float, step: float = STEP) -> Array:
    """Return the times [s] of rows every `step` [s] from 0 to the multiple of `step` that is nearest to `stop` [s].

    Raises ArgumentError unless there are 1 to MOST_POINTS steps, and `step` is above 0.
    """
    if not (step > 0.0 and step / 2 < stop <= MOST_POINTS * step):
        raise ArgumentError(f"rows every {step:g} s up to {stop:g} s: expected 1 to {MOST_POINTS:g} steps above 0")
    return np.arange(round(stop / step) + 1) * step


def _above_zero(name: str, value: float | Array, limit: float = inf) -> None:
    """Raise ArgumentError unless a number, or every number of an array, is above 0 and at most the limit."""
    if not (np.size(value) and np.all(np.greater(value, 0.0) & np.less_equal(value, limit) & np.isfinite(value))):
        raise ArgumentError(f"{name} = {brief(value)}: must be above 0" + (f" and at most {limit:g} Hz, which has two "
                            f"rows of {STEP:g} s in a cycle" if limit < inf else ""))


@checked
def motion(kind: str, amplitude: float, duration: float, torque: float = 0.0, settle: float = SETTLE,
           step: float = STEP, first: float | None = 0.0, **frequencies: float) -> Excitation:
    """Return the excitation of a kind of `motions.EXCITATIONS`, until `duration` [s] after the motion's beginning.

    `amplitude` [rad] is that of the command, `torque` [N.m] acts about the hinge. The command of a slew is that of the
    starting end for `settle` [s], except in row 0: there it is `first` [rad], unless this is None. The kind's
    `frequencies` [Hz] are those of FIELDS by default. Raises ArgumentError for an unknown kind or frequency, and for a
    value out of its range.
    """
    if kind not in EXCITATIONS or not {*EXCITATIONS[kind].shape}.issuperset(frequencies):
        known = "; ".join(" ".join((name, *each.shape)) for name, each in EXCITATIONS.items())
        raise ArgumentError(f"{' '.join((kind, *frequencies))}: kinds with their frequencies are {known}")
    each = EXCITATIONS[kind]
    fields = {**each.defaults, **frequencies}
    for name, value in fields.items():
        _above_zero(name, value, FASTEST)
    if each.sweeps:
        _above_zero("duration", duration)
        if not fields["low"] < fields["high"]:
            raise ArgumentError(f"the sweep's low = {fields['low']:g} Hz is not below its high = {fields['high']:g} Hz")
    begin = settle if "settle" in each.options else LEAD_IN
    if begin < 0.0 or duration < 0.0:
        raise ArgumentError(f"a motion that begins at {begin:g} s and lasts {duration:g} s: neither may be negative")
    since = times(begin + duration, step) - begin
    columns = {COMMAND: each.command(since, amplitude, duration=duration, step=step, **fields)}
    if "settle" in each.options and first is not None:
        columns[COMMAND][0] = first
    if torque:
        columns[LOAD] = each.torque(since, torque)
    size = degrees(amplitude)
    title = each.description.format(size=size, back=-size, **fields) + (f" with {torque:+g} N.m" if torque else "")
    return Excitation(title, columns, begin, step)


@checked
def step_to(level: float, duration: float, load: float = 0.0, step: float = STEP) -> Excitation:
    """Return a step from rest at zero to a level [rad], held for `duration` [s]; a `load` [N.m] rises after it."""
    return motion("step", level, duration, load, step=step)


@checked
def slew_to(level: float, duration: float, load: float = 0.0, settle: float = SETTLE) -> Excitation:
    """Return a step from -level, where the fin rests for `settle` [s], to +level [rad]; see `step_to`."""
    return motion("slew", level, duration, load, settle)


@checked
def sweep(amplitude: float, duration: float, low: float = SWEEP[0], high: float = SWEEP[1]) -> Excitation:
    """Return a logarithmic sine sweep of the command with an `amplitude` [rad] for `duration` [s].

    The frequency rises from `low` to `high` [Hz]. Raises ArgumentError for impossible frequencies or duration.
    """
    return motion("sweep", amplitude, duration, low=low, high=high)


@checked
def sine(amplitude: float, frequency: float | Array, cycles: float | Array = 6.0,
         settle: tuple[float, float] = (4.0, 0.5), variable: str = COMMAND, step: float = STEP) -> Excitation:
    """Return a sine of the command, or a cosine of another input `variable`, at a frequency [Hz].

    `amplitude` is in the input's unit. The last `cycles` are judged, after a transient of `settle`[0] cycles and at
    least `settle`[1] s. Under a cosine of the hinge moment a free inertia at rest does not drift, as it would under a
    sine. Arrays of frequencies and `cycles` define a run for each element; all runs have the longest
    duration and judged time of any. Raises ArgumentError for a frequency or a number of cycles out of its range.
    """
    _above_zero("frequency", frequency, FASTEST)
    _above_zero("cycles", cycles)
    if np.ndim(frequency) > 1 or np.shape(cycles) not in ((), np.shape(frequency)) or min(settle) < 0.0:
        raise ArgumentError(f"sine: frequency = {brief(frequency)}, cycles = {brief(cycles)}, settle = {settle}: "
                            "expected one frequency or a list, a number of cycles for all or for each, and a transient "
                            "of 0 or more")
    frequency, cycles = np.asarray(frequency, dtype=float)[()], np.asarray(cycles, dtype=float)[()]
    judged = np.max(cycles / frequency)
    time = times(np.max(np.maximum(settle[0] / frequency, settle[1]) + cycles / frequency), step)
    wave = (np.sin if variable == COMMAND else np.cos)(np.multiply.outer(2.0 * pi * frequency, time))
    span = f"{np.min(frequency):g}" + (f" to {np.max(frequency):g}" if np.ndim(frequency) else "")
    return Excitation(f"sine of {variable} at {span} Hz", {variable: amplitude * wave}, float(time[-1] - judged),
                      step)


@checked
def sine_from_rest(amplitude: float, frequency: float, duration: float) -> Excitation:
    """Return a sine of the command [rad] at a frequency [Hz] for `duration` [s], from rest at zero, judged in full."""
    return motion("sine", amplitude, duration, frequency=frequency)


@checked
def load_ramp(moment: float, duration: float) -> Excitation:
    """Return a ramp of the hinge moment from zero to `moment` [N.m] in `duration` [s], command at zero."""
    return Excitation(f"hinge moment up to {moment:+g} N.m", {LOAD: moment * times(duration) / duration})


@checked
def staircase(levels: Sequence[float], holds: Sequence[float], step: float = STEP) -> Excitation:
    """Return a command of levels [rad], each held for its time [s]; the last level is judged."""
    if not len(levels) == len(holds) > 0 or min(holds) < 0.0:
        raise ArgumentError(f"{len(levels)} levels for {brief(holds)} s: expected a hold of 0 s or more for each level")
    times(sum(holds), step)  # checks the number of rows
    command = np.repeat(levels, [round(hold / step) for hold in holds])
    return Excitation(f"{len(levels)} levels of the command", {COMMAND: np.append(command, command[-1])},
                      sum(holds[:-1]), step)


@checked
def reference_case(name: str, exact: bool = True, supply: float = SUPPLY_START) -> Excitation:
    """Return the excitation of the reference case `name`, for an actuator whose supply is `supply` [V] at the start.

    With `exact` the true angle and speed are fed back, for a comparison of trajectories, otherwise those of the
    encoder, for figures of performance. Raises EmcasError for an unknown name.
    """
    (case,) = select([name], {case.name: with_supply(case, supply) for case in CASES}).values()
    excitation = of_case(case.title, case.inputs(), case.step, case.overrides)
    return excitation if exact else with_encoder(excitation)


@checked
def of_case(title: str, inputs: Mapping[str, Array], step: float, start_values: Mapping[str, Any]) -> Excitation:
    """Return the excitation of a reference case from its columns in SI, including ``time``; `step` in s."""
    columns = {name: column for name, column in inputs.items() if name != "time"}
    return Excitation(title, columns, LEAD_IN, step, start_values)


@checked
def with_encoder(excitation: Excitation) -> Excitation:
    """Return the excitation without its changes of encoder parameters: performance is measured with the encoder."""
    return replace(excitation, start_values={name: value for name, value in excitation.start_values.items()
                                             if not name.startswith("encoder.")})


@checked
def csv_file(path: Path | str, step: float = STEP, stop: float | None = None, model: str = NONLINEAR,
             fins: int = 1) -> Excitation:
    """Return the inputs in a CSV file with a column ``time`` [s] and columns of a model's inputs, SI, as fmpy reads it.

    The excitation has rows every `step` [s] up to `stop` [s], by default up to the last row of the file. For several
    `fins` a column such as ``fin_command`` applies to all, ``fin[2].fin_command`` to one. Inputs are interpolated
    between the file's rows, jump between two rows of the same time, and are constant before the first and after the
    last row. Raises EmcasError for a file that cannot be read, and for other columns or values.
    """
    path = Path(path)
    table = read_columns(path)
    inputs = list(dict.fromkeys(v.name for v in (*get(model).inputs, *FmuInterface(fins, model).inputs)))
    if "time" not in table:
        raise EmcasError(f"{path}: has no column time; its columns are {', '.join(table)}")
    if unknown := [name for name in table if name not in (*inputs, "time")]:
        raise EmcasError(f"{path}: {', '.join(unknown)} is not an input; inputs are {', '.join(inputs)}")
    time = table.pop("time")
    if not table:
        raise EmcasError(f"{path}: has no column of an input; inputs are {', '.join(inputs)}")
    if not np.isfinite(time).all() or np.any(np.diff(time) < 0.0) or time[0] < 0.0:
        raise EmcasError(f"{path}: time must be finite, begin at 0 or later and not run backwards")
    end = float(time[-1]) if stop is None else stop
    check_span(str(path), step, end)
    if unsound := [name for name, column in table.items() if not np.isfinite(column).all()]:
        raise EmcasError(f"{path}: {unsound[0]} has an empty or non-finite value")
    return Excitation(path.name, {name: _sampled(times(end, step), time, column) for name, column in table.items()},
                      step=step)


def read_columns(path: Path) -> dict[str, Array]:
    """Return the columns of numbers in a CSV file by the names in its first line. Raises EmcasError for other files."""
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            reader = csv.reader(file, skipinitialspace=True)
            (_, header), *lines = [(reader.line_num, row) for row in reader if row] or [(0, [])]
        if not lines:
            raise ValueError("it needs a line of names, and below it lines with a number for each")
        if len(header) == 1 and ";" in header[0]:
            raise ValueError("separate columns by commas, not semicolons, with points in numbers")
        for number, row in lines:
            if len(row) != len(header):
                raise ValueError(f"line {number} has {len(row)} values for {len(header)} columns")
        table = np.array([[_number(cell, number) for cell in row] for number, row in lines])
    except (OSError, UnicodeDecodeError) as error:
        raise EmcasError(unreadable(path, error)) from error
    except (csv.Error, ValueError) as error:
        raise EmcasError(f"{path}: cannot be read as a table of numbers: {error}") from error
    names = [name.strip() for name in header]
    if twice := sorted({name for name in names if names.count(name) > 1}):
        raise EmcasError(f"{path}: column {', '.join(twice)} occurs twice; leave one out")
    return dict(zip(names, table.T, strict=True))


def _number(cell: str, line: int) -> float:
    try:
        return float(cell)
    except ValueError as error:
        raise ValueError(f"line {line}: {cell!r} is not a number") from error


def check_span(what: str, step: float, stop: float) -> None:
    """Raise EmcasError if rows every `step` [s] do not end at `stop` [s], or are too many."""
    if not step <= stop <= MOST_POINTS * step:
        raise EmcasError(f"{what}: the end at {stop:g} s must be 1 to {MOST_POINTS:g} steps of {step:g} s from 0")
    if abs(stop / step - round(stop / step)) > 1e-6:
        raise EmcasError(f"{what}: the end at {stop:g} s is not a whole number of steps of {step:g} s")


def _sampled(points: Array, time: Array, column: Array) -> Array:
    """Return a column at `points` [s]: linear between rows, the later value at a jump, constant outside the rows."""
    after = np.searchsorted(time, points * (1.0 + 1e-12), side="right")  # a point at a row, within rounding, is on it
    low, high = np.clip(after - 1, 0, len(time) - 1), np.clip(after, 0, len(time) - 1)
    span = time[high] - time[low]
    share = np.where(span > 0.0, (points - time[low]) / np.where(span > 0.0, span, 1.0), 0.0)
    sampled: Array = column[low] + np.clip(share, 0.0, 1.0) * (column[high] - column[low])
    return sampled
