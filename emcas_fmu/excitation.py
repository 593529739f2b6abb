"""Inputs to simulate with: a reference case, a file, or a step."""

from __future__ import annotations

import csv
from collections.abc import Mapping
from dataclasses import dataclass
from math import radians
from pathlib import Path
from typing import Any

import numpy as np

from .actuators import NONLINEAR, get
from .errors import EmcasError
from .reference.cases import CASES
from .simulation import MOST_POINTS, Array

STEP_AT = 0.05  # s, after a look at rest


@dataclass(frozen=True)
class Excitation:
    """Columns of inputs at the communication points, `step` [s] apart, and parameters that go with them."""

    title: str
    step: float
    columns: Mapping[str, Array]
    overrides: Mapping[str, Any]

    @property
    def stop(self) -> float:
        """The last communication point [s]."""
        return (len(next(iter(self.columns.values()))) - 1) * self.step


def from_case(name: str) -> Excitation:
    """A reference case by name. Raises EmcasError, naming those there are."""
    found = {case.name: case for case in CASES}.get(name)
    if found is None:
        raise EmcasError(f"there is no case {name}; there is {', '.join(case.name for case in CASES)}")
    columns = {name: column for name, column in found.inputs().items() if name != "time"}
    return Excitation(found.title, found.step, columns, found.overrides)


def from_file(path: Path, step: float, stop: float | None, model: str = NONLINEAR) -> Excitation:
    """A CSV file with a column ``time`` [s] and columns of inputs of a model, SI, as fmpy reads it.

    Between its rows inputs are interpolated; where two rows have the same time they jump. The run
    begins at 0: inputs before the first row are those of it.
    Raises EmcasError for what is no such file.
    """
    found = _columns(path)
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
    _check_span(str(path), step, end)
    points = np.arange(round(end / step) + 1) * step
    columns = {}
    for name, column in found.items():
        if not np.isfinite(column).all():
            raise EmcasError(f"{path}: {name} has an empty or non-finite value")
        columns[name] = _sampled(points, time, np.atleast_1d(column))
    return Excitation(path.name, step, columns, {})


def _columns(path: Path) -> dict[str, Array]:
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


def _check_span(what: str, step: float, stop: float) -> None:
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


def from_step(degrees: float, torque: float, step: float, stop: float) -> Excitation:
    """A step to an angle [deg] at 50 ms under a constant hinge moment [N.m]."""
    _check_span("step", step, stop)
    if stop <= STEP_AT:
        raise EmcasError(f"step: it comes at {STEP_AT:g} s, the end at {stop:g} s is before that; see --stop")
    points = np.arange(round(stop / step) + 1) * step
    command = np.where(points > STEP_AT - 0.5 * step, radians(degrees), 0.0)
    return Excitation(f"Step to {degrees:+g} deg" + (f" with {torque:+g} N.m" if torque else ""), step,
                      {"fin_command": command, "aero_torque": np.full_like(points, torque)}, {})
