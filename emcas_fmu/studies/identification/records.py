"""Measurements from CSV files: a header of names and units, a row per sample, equally spaced in time.

A header cell is ``name [unit]``; a bare name is in the SI unit of `QUANTITIES`. Columns
not asked for are left alone. What cannot be used is refused with file, column and row.
"""

from __future__ import annotations

import csv
import hashlib
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
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

QUANTITIES: Mapping[str, tuple[str, str]] = {
    "time": ("s", "time of the sample"),
    "motor_angle": ("rad", "motor angle, zero at fin angle zero"),
    "motor_speed": ("rad/s", "motor speed"),
    "motor_current": ("A", "motor current, positive along positive motor torque"),
    "drive_reference": ("V", "analogue reference at the drive's input"),
    "fin_angle": ("rad", "fin angle, measured directly on the fin shaft"),
    "temperature": ("degC", "ambient temperature; bare numbers are degC, as in parameter files"),
}
DIRECTIONS = ((1, "positive"), (-1, "negative"))
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
    """One file: `columns` in SI by name, `step` [s] between rows, `units` those of the file."""

    path: Path
    step: float
    columns: Mapping[str, Array]
    units: Mapping[str, str]
    sha256: str

    def __getitem__(self, name: str) -> Array:
        return self.columns[name]

    def __len__(self) -> int:
        return len(self.columns["time"])

    @property
    def name(self) -> str:
        """File name without its folder: what notes and reports cite."""
        return self.path.name

    def fail(self, problem: str) -> RecordError:
        """Return an error that names this file."""
        return RecordError(f"{self.path}: {problem}")


def read_records(paths: Sequence[Path], required: Sequence[str], optional: Sequence[str] = ()) -> list[Record]:
    """Read each file's columns of these names and ``time``. Raises RecordError with the first file's problem."""
    if not paths:
        raise RecordError("no files: give at least one CSV file of measurements")
    records = [_record(path, ("time", *required), optional) for path in paths]
    seen: dict[str, Record] = {}
    for record in records:
        if record.sha256 in seen:
            raise record.fail(f"has the same contents as {seen[record.sha256].path}: a measurement counts once; "
                              "leave one of them out")
        seen[record.sha256] = record
    return records


def grouped(records: Sequence[Record], stretches: Callable[[Record], Sequence[T]]) -> tuple[list[T], list[list[int]]]:
    """Return the stretches of all records, and by record the indices of its stretches."""
    every: list[T] = []
    groups = []
    for record in records:
        begin = len(every)
        every += stretches(record)
        groups.append(list(range(begin, len(every))))
    return every, groups


def _record(path: Path, required: Sequence[str], optional: Sequence[str]) -> Record:
    header, rows, digest = _cells(path)
    places = _places(path, header, required, optional)
    columns = {name: _column(path, name, unit, [row[place] for row in rows], header[place])
               for name, (place, unit) in places.items()}
    if len(rows) < FEWEST_ROWS:
        raise RecordError(f"{path}: has {len(rows)} rows; at least {FEWEST_ROWS} are needed")
    return Record(path, _step(path, columns["time"]), columns, {name: unit for name, (_, unit) in places.items()},
                  digest)


def _cells(path: Path) -> tuple[list[str], list[list[str]], str]:
    """Return the cells of the header and of the rows, and the file's SHA-256."""
    try:
        raw = path.read_bytes()
        text = raw.decode("utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise RecordError(unreadable(path, error)) from error
    lines = [line for line in text.splitlines() if line.strip() and not line.lstrip().startswith("#")]
    if not lines:
        raise RecordError(f"{path}: is empty; expected a header such as  time [s],motor_current [A]  and rows")
    header, *rows = csv.reader(lines, delimiter=max(",;\t", key=lines[0].count))
    for i, row in enumerate(rows, 1):
        if len(row) != len(header):
            raise RecordError(f"{path}: data row {i} has {len(row)} cells, the header {len(header)}; "
                              "separate cells by commas and write decimals with a point")
    return header, rows, hashlib.sha256(raw).hexdigest()


def _places(path: Path, header: Sequence[str], required: Sequence[str],
            optional: Sequence[str]) -> dict[str, tuple[int, str]]:
    """Return the place and the unit in the file of each column by name."""
    places: dict[str, tuple[int, str]] = {}
    names = []
    for place, cell in enumerate(header):
        match = _HEADER.fullmatch(cell)
        name, unit = (match[1], match[2]) if match else (cell.strip(), None)
        names.append(name)
        if name not in (*required, *optional):
            continue
        if name in places:
            raise RecordError(f"{path}: has two columns {name}; leave one of them out")
        places[name] = place, QUANTITIES[name][0] if unit is None else unit.strip()
    for name in required:
        if name not in places:
            unit, meaning = QUANTITIES[name]
            close = get_close_matches(name, names, 1)
            hint = f"; is {close[0]} meant? Call it {name}" if close else ""
            raise RecordError(f"{path}: has no column {name} ({meaning}, in {unit} or with its unit as in {name} "
                              f"[{unit}]); its columns are {', '.join(names)}{hint}")
    return places


def _column(path: Path, name: str, unit: str, cells: Sequence[str], head: str) -> Array:
    """Return a column's values in SI."""
    try:
        zero, one = (convert(Decimal(x), unit, QUANTITIES[name][0]) for x in (0, 1))
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
    return values if unit == QUANTITIES[name][0] else zero + (one - zero) * values


def _step(path: Path, time: Array) -> float:
    """Return the interval [s] of equally spaced samples."""
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
        flat, others = _longest(values == extreme), _longest(inner & (values[1:] != extreme))
        rests = flat >= _FLAT and flat > 4 * (others + 1)
        piles = restless and pile >= 2 * _FLAT and pile > 4 * (int(beside.max()) + 1)
        if rests or piles:
            raise record.fail(f"{name} is clipped: {pile} samples are at exactly {extreme:.6g} {QUANTITIES[name][0]}, "
                              "its extreme, as no others; widen the range of the measurement, or excite less")


def distinct(numbers: Iterable[float], apart: float = 0.0) -> list[float]:
    """Return those that differ by more than 15 %, or by `apart`, sorted."""
    levels: list[float] = []
    for number in sorted(numbers):
        if not levels or number - levels[-1] > (apart or 0.15 * abs(levels[-1])):
            levels.append(float(number))
    return levels


def runs(mask: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Return begin and end of each run of True, of shape (runs, 2); the end is the index behind the last."""
    edges = np.flatnonzero(np.diff(mask.astype(int), prepend=0, append=0))
    return edges.reshape(-1, 2)


def _longest(mask: NDArray[np.bool_]) -> int:
    return int(np.diff(runs(mask)).max(initial=0))


def refuse_magnitude(record: Record, name: str, largest: float, means: str) -> None:
    """Refuse a column beyond `largest` [SI]: its unit is hardly the one in the header. `means` says what that is."""
    reached, unit = float(np.abs(record[name]).max()), QUANTITIES[name][0]
    if reached > largest:
        raise record.fail(f"{name} reaches {reached:.4g} {unit}, more than {largest:.4g} {unit} ({means}); it was read "
                          f"as {record.units[name]}: put the unit it has into the header, as in {name} [{unit}]")
