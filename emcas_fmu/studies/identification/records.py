"""Read measurements from CSV files: a header with names and units, then one row for each of equally spaced samples.

A header cell is ``name [unit]``; without a unit, values are in the unit of `quantities`. Columns that the caller does
not name are ignored. Unusable data raise RecordError with the file and, where they apply, column and row.
"""

from __future__ import annotations

import csv
import hashlib
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from decimal import Decimal
from difflib import get_close_matches
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from ...errors import EmcasError, unreadable
from ...units import UnitError, convert

Array = NDArray[np.float64]
T = TypeVar("T")

COLUMNS: Mapping[str, tuple[str, str]] = {
    "time": ("s", "time of the sample"),
    "motor_angle": ("rad", "motor angle, zero at fin angle zero"),
    "motor_speed": ("rad/s", "motor speed"),
    "motor_current": ("A", "motor current, positive along positive motor torque"),
    "drive_reference": ("V", "analogue reference at the drive's input"),
    "fin_angle": ("rad", "fin angle, measured directly on the fin shaft"),
    "temperature": ("degC", "ambient temperature; bare numbers are degC, as in parameter files"),
}
"""The unit (SI, degC for temperatures) and the meaning of each column."""
DIRECTIONS = ((1, "positive"), (-1, "negative"))
FEWEST_ROWS = 20
# Largest jitter of the interval between a logger's time stamps, as a share of the mean interval. Estimates depend on
# differences between neighbouring samples, whose relative error is the same. A stamp may be off by half an interval.
_JITTER = 0.05
_FLAT = 6  # fewest successive equal values at an extreme that show a clipped record
_NOISY = 0.5  # share of samples equal to their neighbour, below which a record is noisy
_HEADER = re.compile(r"\s*([A-Za-z_][A-Za-z0-9_.]*)\s*(?:\[([^\]]*)\])?\s*")


class RecordError(EmcasError):
    """The measurements are unusable or do not identify the parameters; the message gives reason and remedy."""


def require(condition: object, problem: str) -> None:
    """Raise RecordError with the `problem` unless the condition holds."""
    if not condition:
        raise RecordError(problem)


@dataclass(frozen=True)
class RecordFile:
    """A file of measurements: `columns` by name, the sample interval `step` [s], the columns' `units` in the file.

    Columns are converted to the units of `quantities`, which are as QUANTITIES. `unused` are the names of columns that
    are not read.
    """

    path: Path
    step: float
    columns: Mapping[str, Array]
    units: Mapping[str, str]
    sha256: str
    quantities: Mapping[str, tuple[str, str]] = field(default_factory=lambda: COLUMNS)
    unused: Sequence[str] = ()

    def __getitem__(self, name: str) -> Array:
        return self.columns[name]

    def __len__(self) -> int:
        return len(self.columns["time"])

    @property
    def name(self) -> str:
        """Name of the file without its folder, for notes and reports."""
        return self.path.name

    def late(self, column: Array, delay: float) -> Array:
        """Return a column of this record after a `delay` [s] of either sign, interpolated; its end values are held."""
        time = np.arange(len(self)) * self.step
        return column if delay == 0.0 else np.interp(time - delay, time, column)

    def require(self, condition: object, problem: str) -> None:
        """Raise RecordError with this file and the `problem` unless the condition holds."""
        require(condition, f"{self.path}: {problem}")


def read_records(paths: Sequence[Path], required: Sequence[str], optional: Sequence[str],
                 quantities: Mapping[str, tuple[str, str]] = COLUMNS) -> list[RecordFile]:
    """Read ``time``, the `required` columns and existing `optional` columns from each file.

    Raises RecordError for the first unusable file, for files with the same contents, and if there is no file.
    """
    require(paths, "there is no file: give at least one CSV file of measurements")
    records = [_record(path, ("time", *required), optional, quantities) for path in paths]
    seen: dict[str, RecordFile] = {}
    for record in records:
        first = seen.setdefault(record.sha256, record)
        record.require(first is record, f"has the same contents as {first.path}, and a measurement must count once; "
                       "leave one of them out")
    return records


def divided(records: Sequence[RecordFile], divide: Callable[[RecordFile], Iterable[T]]) -> tuple[list[T], list[int]]:
    """Return the parts into which `divide` divides the records, and the index of each part's record."""
    pairs = [(part, i) for i, record in enumerate(records) for part in divide(record)]
    return [part for part, _ in pairs], [i for _, i in pairs]


def _record(path: Path, required: Sequence[str], optional: Sequence[str],
            quantities: Mapping[str, tuple[str, str]]) -> RecordFile:
    try:
        raw = path.read_bytes()
        text = raw.decode("utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise RecordError(unreadable(path, error)) from error
    lines = [line for line in text.splitlines() if line.strip() and not line.lstrip().startswith("#")]
    require(lines, f"{path}: is empty; expected a header such as  time [s],motor_current [A]  and rows")
    header, *rows = csv.reader(lines, delimiter=max(",;\t", key=lines[0].count))
    for i, row in enumerate(rows, 1):
        if len(row) != len(header):
            raise RecordError(f"{path}: data row {i} has {len(row)} cells, the header {len(header)}; "
                              "separate cells by commas and write decimals with a point")
    columns, units = {}, {}
    for name, (index, unit) in _indices_and_units(path, header, required, optional, quantities).items():
        columns[name] = _values(path, name, unit, quantities[name][0], [row[index] for row in rows], header[index])
        units[name] = unit
    require(len(rows) >= FEWEST_ROWS, f"{path}: has {len(rows)} rows; at least {FEWEST_ROWS} are needed")
    return RecordFile(path, _interval(path, columns["time"]), columns, units, hashlib.sha256(raw).hexdigest(),
                  quantities, [name for cell in header if (name := cell.partition("[")[0].strip()) not in columns])


def _indices_and_units(path: Path, header: Sequence[str], required: Sequence[str], optional: Sequence[str],
                       quantities: Mapping[str, tuple[str, str]]) -> dict[str, tuple[int, str]]:
    """Return each column's index and unit in the file, by name."""
    cells = [match.groups() if (match := _HEADER.fullmatch(cell)) else (cell.strip(), None) for cell in header]
    names = [name for name, _ in cells]
    for name in required:
        if name not in names:
            unit, meaning = quantities[name]
            close = get_close_matches(name, names, 1)
            hint = f"; if {close[0]} is meant, rename it to {name}" if close else ""
            raise RecordError(f"{path}: has no column {name} ({meaning}, in {unit} or with its unit as in {name} "
                              f"[{unit}]); its columns are {', '.join(names)}{hint}")
    used = {name: (i, unit) for i, (name, unit) in enumerate(cells) if name in (*required, *optional)}
    for name in used:
        require(names.count(name) == 1, f"{path}: has two columns {name}; leave one of them out")
    return {name: (i, quantities[name][0] if unit is None else unit.strip()) for name, (i, unit) in used.items()}


def _values(path: Path, name: str, unit: str, si: str, cells: Sequence[str], head: str) -> Array:
    """Return a column's values, converted from their unit in the file to `si`."""
    try:
        zero, one = (convert(Decimal(x), unit, si) for x in (0, 1))
    except UnitError as error:
        raise RecordError(f"{path}: column {head.strip()}: {error}") from error
    values = np.full(len(cells), np.nan)
    for i, cell in enumerate(cells):
        with suppress(ValueError):
            values[i] = float(cell)
        if not np.isfinite(values[i]):
            raise RecordError(f"{path}: {name}, data row {i + 1}: {cell.strip() or '(empty)'} is not a finite number; "
                              "remove the rows up to this gap, or those after it")
    return values if unit == si else zero + (one - zero) * values


def _interval(path: Path, time: Array) -> float:
    """Return the sample interval [s]. Raises RecordError for samples that are not equally spaced."""
    steps = np.diff(time)
    if np.any(steps <= 0.0):
        row = int(np.argmax(steps <= 0.0)) + 2
        raise RecordError(f"{path}: time does not increase at data row {row} ({time[row - 2]:.9g} s, then "
                          f"{time[row - 1]:.9g} s); sort the rows and remove repeated ones")
    step = float(time[-1] - time[0]) / len(steps)
    # Deviations up to 2e-9 of the largest time come from time stamps with nine digits.
    if np.abs(time - time[0] - step * np.arange(len(time))).max() > 0.5 * step \
            or np.abs(steps - step).max() > max(_JITTER * step, 2e-9 * np.abs(time).max()):
        row = int(np.argmax(np.abs(steps - step))) + 2
        raise RecordError(f"{path}: samples are not equally spaced: {steps[row - 2]:.6g} s before data row {row}, "
                          f"{step:.6g} s on average; cut the file at the gap or resample it in the logger")
    return step


def refuse_clipped(record: RecordFile, name: str) -> None:
    """Raise RecordError for a clipped column.

    A clipped signal stays constant at its largest or smallest value for far longer than at other values. If noise
    brings it back into the range, this value is far more frequent than its neighbours; without noise, frequent values
    are no evidence.
    """
    values = record[name]
    equal = np.diff(values) == 0.0
    noisy = float(np.mean(equal)) < _NOISY
    levels, counts = np.unique(values, return_counts=True)
    if len(levels) < 3:
        return
    for extreme, count, neighbours in ((levels[-1], counts[-1], counts[-3:-1]), (levels[0], counts[0], counts[1:3])):
        at_extreme, elsewhere = longest(values == extreme), longest(equal & (values[1:] != extreme))
        constant = at_extreme >= _FLAT and at_extreme > 4 * (elsewhere + 1)
        frequent = noisy and count >= 2 * _FLAT and count > 4 * (int(neighbours.max()) + 1)
        record.require(not (constant or frequent), f"{name} is clipped: {count} samples are exactly at its extreme, "
                       f"{extreme:.6g} {record.quantities[name][0]}; widen the measuring range, or excite less")


def refuse_magnitude(record: RecordFile, name: str, largest: float, meaning: str) -> None:
    """Raise RecordError for a magnitude above `largest`: a wrong unit is likely. `meaning` is `largest` in words."""
    reached, unit = float(np.abs(record[name]).max()), record.quantities[name][0]
    record.require(reached <= largest, f"{name} reaches {reached:.4g} {unit}, more than {largest:.4g} {unit} "
                   f"({meaning}); it was read as {record.units[name]}: write its unit into the header, as in "
                   f"{name} [{unit}]")


def distinct(numbers: Iterable[float], apart: float = 0.0) -> list[float]:
    """Return the numbers in rising order, without those that are within `apart` (0: 15 %) of the last one kept."""
    levels: list[float] = []
    for number in sorted(numbers):
        if not levels or number - levels[-1] > (apart or 0.15 * abs(levels[-1])):
            levels.append(float(number))
    return levels


def sequences(mask: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Return the first index of each sequence of True, and the index after its last, as an array [sequences, 2]."""
    return np.flatnonzero(np.diff(mask.astype(int), prepend=0, append=0)).reshape(-1, 2)


def longest(mask: NDArray[np.bool_]) -> int:
    """Return the length of the longest sequence of True."""
    return int(np.diff(sequences(mask)).max(initial=0))
