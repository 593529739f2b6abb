"""Measurements from CSV files: a header of names and units, a row per sample, equally spaced in time.

A header cell is ``name [unit]``; a bare name is in the SI unit of `QUANTITIES`. Columns
not asked for are left alone. What cannot be used is refused with file, column and row.
"""

from __future__ import annotations

import csv
import hashlib
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from decimal import Decimal
from difflib import get_close_matches
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from ...errors import EmcasError
from ...units import UnitError, convert

Array = NDArray[np.float64]
T = TypeVar("T")

QUANTITIES: Mapping[str, tuple[str, str]] = {
    "time": ("s", "time of the sample"),
    "motor_angle": ("rad", "motor angle, zero at fin angle zero"),
    "motor_speed": ("rad/s", "motor speed"),
    "motor_current": ("A", "motor current, positive along positive motor torque"),
    "drive_reference": ("V", "analogue reference at the drive's input"),
    "fin_angle": ("rad", "fin angle, measured directly on the fin shaft"),
    "temperature": ("degC", "ambient temperature; bare numbers are degC, as in parameter files"),
}
FEWEST_ROWS = 20
# Share of the sample interval by which a logger's time stamps may jitter: beyond it differences of neighbouring
# samples, which the estimates rest on, are wrong by more than that share.
_JITTER = 0.05
# A value repeated this often in a row at the extreme of a record that is otherwise restless is a rail.
_FLAT = 6
_RESTLESS = 0.5  # share of samples equal to their neighbour below which a record has noise of its own
_HEADER = re.compile(r"\s*([A-Za-z_][A-Za-z0-9_.]*)\s*(?:\[([^\]]*)\])?\s*")


class RecordError(EmcasError):
    """Measurements that cannot support the answer; the message says why and what to measure instead."""


@dataclass(frozen=True)
class Record:
    """One file: `columns` in SI by name, `step` [s] between rows, `written` the units of the file."""

    path: Path
    step: float
    columns: Mapping[str, Array]
    written: Mapping[str, str]
    sha256: str

    def __getitem__(self, name: str) -> Array:
        return self.columns[name]

    def __contains__(self, name: str) -> bool:
        return name in self.columns

    def __len__(self) -> int:
        return len(self.columns["time"])

    @property
    def name(self) -> str:
        """File name without its folder: what notes and reports cite."""
        return self.path.name

    def fail(self, problem: str) -> RecordError:
        """An error that names this file."""
        return RecordError(f"{self.path}: {problem}")


def read_records(paths: Sequence[Path], required: Sequence[str], optional: Sequence[str] = ()) -> list[Record]:
    """Each file's columns of these names and ``time``. Raises RecordError with the first file's problem."""
    if not paths:
        raise RecordError("no files: give at least one CSV file of measurements")
    records = [read_record(path, required, optional) for path in paths]
    seen: dict[str, Record] = {}
    for record in records:
        if record.sha256 in seen:
            raise record.fail(f"has the same contents as {seen[record.sha256].path}: a measurement counts once; "
                              "leave one of them out")
        seen[record.sha256] = record
    return records


def grouped(records: Sequence[Record], stretches: Callable[[Record], Sequence[T]]) -> tuple[list[T], list[list[int]]]:
    """The stretches of all records, and by record the indices of its own."""
    found: list[T] = []
    groups = []
    for record in records:
        begin = len(found)
        found += stretches(record)
        groups.append(list(range(begin, len(found))))
    return found, groups


def read_record(path: Path, required: Sequence[str], optional: Sequence[str] = ()) -> Record:
    """One file's columns of these names and ``time``, checked. Raises RecordError."""
    header, rows, digest = _cells(path)
    places, written = _places(path, header, required, optional)
    columns = {name: _column(path, name, written[name], [row[place] for row in rows], header[place])
               for name, place in places.items()}
    if len(rows) < FEWEST_ROWS:
        raise RecordError(f"{path}: has {len(rows)} rows; at least {FEWEST_ROWS} are needed")
    return Record(path, _step(path, columns["time"]), columns, written, digest)


def _cells(path: Path) -> tuple[list[str], list[list[str]], str]:
    try:
        raw = path.read_bytes()
        text = raw.decode("utf-8-sig")
    except OSError as error:
        raise RecordError(f"{path}: cannot be read: {error.strerror or error}") from error
    except UnicodeDecodeError as error:
        raise RecordError(f"{path}: is not a text file in UTF-8; export the measurements as CSV") from error
    lines = [line for line in text.splitlines() if line.strip() and not line.lstrip().startswith("#")]
    if not lines:
        raise RecordError(f"{path}: is empty; expected a header such as  time [s],motor_current [A]  and rows")
    delimiter = max(",;\t", key=lines[0].count)
    header, *rows = csv.reader(lines, delimiter=delimiter)
    for i, row in enumerate(rows, 1):
        if len(row) != len(header):
            raise RecordError(f"{path}: data row {i} has {len(row)} cells, the header {len(header)}; "
                              "separate cells by commas and write decimals with a point")
    return header, rows, hashlib.sha256(raw).hexdigest()


def _places(path: Path, header: Sequence[str], required: Sequence[str],
            optional: Sequence[str]) -> tuple[dict[str, int], dict[str, str]]:
    """Where the wanted columns are, and their units as written."""
    places: dict[str, int] = {}
    written: dict[str, str] = {}
    names = []
    for place, cell in enumerate(header):
        match = _HEADER.fullmatch(cell)
        name, unit = (match[1], match[2]) if match else (cell.strip(), None)
        names.append(name)
        if name not in ("time", *required, *optional):
            continue
        if name in places:
            raise RecordError(f"{path}: has two columns {name}; leave one of them out")
        places[name], written[name] = place, QUANTITIES[name][0] if unit is None else unit.strip()
    for name in ("time", *required):
        if name not in places:
            close = get_close_matches(name, names, 1)
            hint = f"; is {close[0]} meant? Call it {name}" if close else ""
            raise RecordError(f"{path}: has no column {name} ({QUANTITIES[name][1]}, in {QUANTITIES[name][0]} or with "
                              f"its unit as in {name} [{QUANTITIES[name][0]}]); its columns are "
                              f"{', '.join(names)}{hint}")
    return places, written


def _column(path: Path, name: str, unit: str, cells: Sequence[str], head: str) -> Array:
    wanted = QUANTITIES[name][0]
    try:
        zero, one = (convert(Decimal(x), unit, wanted) for x in (0, 1))
    except UnitError as error:
        raise RecordError(f"{path}: column {head.strip()}: {error}") from error
    values = np.empty(len(cells))
    for i, cell in enumerate(cells):
        try:
            values[i] = float(cell)
        except ValueError:
            values[i] = np.nan
        if not np.isfinite(values[i]):
            raise RecordError(f"{path}: {name}, data row {i + 1}: {cell.strip() or '(empty)'} is not a finite number; "
                              "remove what was measured up to the gap or after it")
    if wanted == unit:
        return values
    scaled: Array = zero + (one - zero) * values
    return scaled


def _step(path: Path, time: Array) -> float:
    steps = np.diff(time)
    if np.any(steps <= 0.0):
        row = int(np.argmax(steps <= 0.0)) + 2
        raise RecordError(f"{path}: time does not increase at data row {row} ({time[row - 2]:.9g} s, then "
                          f"{time[row - 1]:.9g} s); sort the rows and remove repeated ones")
    step = float(time[-1] - time[0]) / len(steps)
    # Time stamps are rounded to what the file shows: half a digit of the last place is no jitter.
    if np.abs(time - time[0] - step * np.arange(len(time))).max() > max(0.5, _JITTER) * step \
            or np.abs(steps - step).max() > max(_JITTER * step, 2e-9 * np.abs(time).max()):
        row = int(np.argmax(np.abs(steps - step))) + 2
        raise RecordError(f"{path}: samples are not equally spaced: {steps[row - 2]:.6g} s before data row {row}, "
                          f"{step:.6g} s on average; cut the file at the gap or resample it in the logger")
    return step


def refuse_clipped(record: Record, name: str) -> None:
    """Refuse a column that rests at its extreme while it moves everywhere else: its sensor's or input's range ended.

    It shows as a run of equal values, or, where noise dips below the rail in between, as a pile of them at the
    very end of the distribution. Noise-free records rest anywhere, and are not judged by the pile.
    """
    values = record[name]
    inner = np.diff(values) == 0.0
    restless = float(np.mean(inner)) < _RESTLESS
    levels, counts = np.unique(values, return_counts=True)
    if len(levels) < 3:
        return
    for extreme, pile, beside in ((levels[-1], counts[-1], counts[-3:-1]), (levels[0], counts[0], counts[1:3])):
        flat = _longest(values == extreme)
        others = inner & (values[1:] != extreme)
        run = flat >= _FLAT and flat > 4 * (_longest(others) + 1)
        if run or (restless and pile >= 2 * _FLAT and pile > 4 * (int(beside.max()) + 1)):
            raise record.fail(f"{name} is clipped: {pile} samples are at exactly {extreme:.6g} {QUANTITIES[name][0]}, "
                              "its extreme, as no others; widen the range of the measurement, or excite less")


def _longest(mask: NDArray[np.bool_]) -> int:
    """Length of the longest run of True."""
    edges = np.flatnonzero(np.diff(np.concatenate(([0], mask.astype(int), [0]))))
    return int((edges[1::2] - edges[::2]).max(initial=0))


def refuse_magnitude(record: Record, name: str, largest: float, means: str) -> None:
    """Refuse a column beyond `largest` [SI]: its unit is hardly the one in the header. `means` says what that is."""
    found = float(np.abs(record[name]).max())
    if found > largest:
        unit = QUANTITIES[name][0]
        raise record.fail(f"{name} reaches {found:.4g} {unit}, more than {largest:.4g} {unit} ({means}); it was read "
                          f"as {record.written[name]}: put the unit it has into the header, as in {name} [{unit}]")


def derivative(record: Record, name: str) -> Array:
    """Central differences of a column, one-sided at the ends."""
    found: Array = np.gradient(record[name], record.step)
    return found


def summary(record: Record) -> dict[str, Any]:
    """What a report says of a file."""
    return {"file": record.name, "rows": len(record), "sample_rate_hz": float(f"{1.0 / record.step:.6g}"),
            "units": dict(record.written), "sha256": record.sha256}
