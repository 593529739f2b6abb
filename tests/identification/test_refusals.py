"""Unsuitable records are refused with exit code 2 and a line that names the problem and the remedy."""

from __future__ import annotations

from collections.abc import Callable
from copy import deepcopy
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from emcas_fmu.studies.identification.estimation import each, solve, weighted_fit
from emcas_fmu.studies.identification.records import Array, RecordError
from tests.commands import emcas

from .conftest import shipped

Table = tuple[list[str], Array]
Edit = Callable[[Table], Table]
SWEEP = "friction_0500rpm_24degC"


@cache
def _loaded(path: Path) -> Table:
    header = path.read_text(encoding="utf-8").splitlines()[0].split(",")
    return header, np.loadtxt(path, delimiter=",", skiprows=1)


def load(path: Path) -> Table:
    """Return header and rows of a record; the caller may change them."""
    return deepcopy(_loaded(path))


def store(path: Path, table: Table) -> Path:
    np.savetxt(path, table[1], fmt="%.9g", delimiter=",", header=",".join(table[0]), comments="")
    return path


def refusal(kind: str, *files: Path | str) -> str:
    """Return the error of `emcas identify`, which must refuse the files, in one line."""
    result = emcas("identify", kind, *files)
    assert result.exit_code == 2, result.output
    assert "Traceback" not in result.stderr
    return " ".join(result.stderr.split())


def column(name: str, change: Callable[[Array], Array]) -> Edit:
    """Return an edit that changes the values of one column."""
    def edit(table: Table) -> Table:
        header, rows = table
        index = next(i for i, cell in enumerate(header) if cell.startswith(name))
        rows[:, index] = change(rows[:, index])
        return header, rows
    return edit


def renamed(old: str, new: str) -> Edit:
    return lambda table: ([new if cell.startswith(old) else cell for cell in table[0]], table[1])


def rows(keep: Callable[[int], slice]) -> Edit:
    return lambda table: (table[0], table[1][keep(len(table[1]))])


def clipped(limit: float) -> Callable[[Array], Array]:
    return lambda x: np.clip(x, -limit, limit)


def single(row: int, value: float) -> Callable[[Array], Array]:
    return lambda x: np.where(np.arange(len(x)) == row, value, x)


@pytest.mark.parametrize(("name", "edit", "expected"), [
    (SWEEP, renamed("motor_current", "motor_curent [A]"), ["has no column motor_current", "if motor_curent is meant"]),
    (SWEEP, renamed("temperature", "room [degC]"), ["has no column temperature"]),
    (SWEEP, renamed("motor_current", "motor_current [V]"), ["the unit V does not measure this quantity"]),
    (SWEEP, renamed("motor_current", "motor_current [kA]"),
     ["motor_current reaches", "drive.current_limit", "read as kA"]),
    (SWEEP, renamed("motor_angle", "motor_angle [turn]"), ["motor_angle reaches", "read as turn"]),
    (SWEEP, renamed("motor_angle", "motor_angle [arcmin]"), ["hardly any motion"]),
    (SWEEP, column("motor_angle", lambda x: 0.0 * x), ["hardly any motion"]),
    (SWEEP, column("motor_angle", lambda x: np.linspace(-20.0, 20.0, len(x)) ** 3 / 400),
     ["no stretch at constant speed"]),
    (SWEEP, column("motor_current", clipped(2.6)), ["motor_current is clipped"]),
    (SWEEP, column("motor_current", single(70, np.nan)), ["motor_current, data row 71: nan is not a finite number"]),
    (SWEEP, column("time", single(40, 0.0)), ["time does not increase at data row 41", "sort the rows"]),
    (SWEEP, column("time", lambda x: x + 0.05 * (x > 0.4)), ["not equally spaced"]),
    (SWEEP, column("temperature", lambda x: x + np.linspace(0.0, 9.0, len(x))), ["temperature drifts by"]),
    (SWEEP, rows(lambda n: slice(0, 12)), ["has 12 rows"]),
    ("drive_fast", renamed("motor_current", "motor_current [mA]"),
     ["times the gain in the base set", "check the units"]),
    ("drive_fast", column("drive_reference", lambda x: 0.0 * x + 1.0), ["drive_reference hardly moves"]),
    ("drive_fast", column("motor_current", lambda x: np.roll(x, len(x) // 2)[::-1]), ["does not follow"]),
    ("drive_fast", column("motor_current", clipped(1.4)), ["motor_current is clipped"]),
    ("drive_slow", column("drive_reference", lambda x: 2.6 * x), ["drive_reference", "reference_limit"]),
    ("inertia_plus_1220mV", renamed("motor_current", "motor_current [mA]"),
     ["inertia_plus_1220mV.csv", "torque and acceleration do not fit together", "read as mA"]),
    ("inertia_minus_1820mV", renamed("motor_angle", "motor_angle [rad]"),
     ["inertia_minus_1820mV.csv", "motor_angle reaches", "read as rad"]),
    ("inertia_plus_0810mV", column("motor_current", clipped(4.0)), ["motor_current is clipped"]),
    ("backlash", renamed("fin_angle", "fin_angle [rad]"), ["fin_angle reaches", "read as rad"]),
    ("backlash", renamed("fin_angle", "fin_angle [arcmin]"), ["times as much", "check the units"]),
    ("backlash", rows(lambda n: slice(0, n // 4)), ["no sweep", "negative direction"]),
    ("backlash", column("fin_angle", lambda x: -x), ["times as much"]),
    ("backlash", rows(lambda n: slice(0, n, 40)), ["log faster or sweep slower"]),
])
def test_error_names_the_problem_of_a_bad_record(name: str, edit: Edit, expected: list[str], tmp_path: Path) -> None:
    kind = name.partition("_")[0]
    files = shipped(kind)
    (good,) = [f for f in files if f.stem == name]
    bad = store(tmp_path / good.name, edit(load(good)))
    message = refusal(kind, *(bad if f == good else f for f in files))
    for text in expected:
        assert text in message, message


@pytest.mark.parametrize(("keep", "expected"), [
    (lambda n: "1000" in n or "2000" in n, "too few speeds"),
    (lambda n: "25rpm" not in n and "50rpm" not in n, "too alike"),
    (lambda n: "minus" not in n, "--keep-cold-ratios"),
    (lambda n: "minus" not in n or "2000" in n, "only one speed near -6 degC"),
])
def test_error_if_sweeps_are_too_few_or_alike(keep: Callable[[str], bool], expected: str) -> None:
    assert expected in refusal("friction", *(f for f in shipped("friction") if keep(f.name)))


def test_friction_in_one_direction_or_part_of_the_range(tmp_path: Path) -> None:
    def halves(path: Path, part: slice) -> Path:
        header, table = load(path)
        return store(tmp_path / path.name, (header, table[part]))

    one_way = [halves(f, slice(0, len(load(f)[1]) // 2)) for f in shipped("friction")]
    assert "no sweep in the negative direction" in refusal("friction", *one_way)
    inner = []
    for f in shipped("friction"):
        header, table = load(f)
        for i, half in enumerate(np.array_split(table, 2)):
            inner.append(store(tmp_path / f"{i}_{f.name}", (header, half[np.abs(half[:, 1]) < 12.0])))
    assert "sixth-order polynomial needs at least" in refusal("friction", *inner)


def test_drive_sampled_too_slowly(tmp_path: Path) -> None:
    slow = next(f for f in shipped("drive") if "slow" in f.name)
    assert "sample rate is too low" in refusal("drive", slow)
    fast = next(f for f in shipped("drive") if "fast" in f.name)
    header, table = load(fast)
    for every, expected in ((10, "too low for the delay"), (6, "too low for the current loop")):
        thin = store(tmp_path / f"{every}.csv", (header, table[::every]))
        assert expected in refusal("drive", thin, slow)


def test_drive_from_a_fast_record_alone() -> None:
    """It shows the proportional part only: a gain 5 % too small and an integral that is none."""
    fast, _ = sorted(shipped("drive"))
    assert "Add a slow staircase" in refusal("drive", fast)


def test_drive_with_one_level_or_saturated_voltage(tmp_path: Path) -> None:
    fast, slow = sorted(shipped("drive"))
    for f in (fast, slow):
        header, table = load(f)
        store(tmp_path / f.name, (header, np.abs(table)))
    assert "need at least 3 levels, of both signs" in refusal("drive", tmp_path / fast.name, tmp_path / slow.name)
    quick, steps = load(fast)
    large = steps.copy()
    large[:, 1:] *= 5.0  # current still linear: what a drive with a higher supply would do
    assert "voltage is saturated" in refusal("drive", store(tmp_path / "large.csv", (quick, large)), slow)


def test_inertia_at_one_level_or_in_one_direction() -> None:
    assert "at one level of torque" in refusal("inertia", *(f for f in shipped("inertia") if "0810" in f.name))
    up = [f for f in shipped("inertia") if "plus" in f.name]
    assert "no spin-up in the negative direction" in refusal("inertia", *up)


def test_speed_that_denies_the_angle(tmp_path: Path) -> None:
    files = shipped("friction")
    header, table = load(files[2])
    speed = np.gradient(table[:, 1], table[:, 0])
    wrong = store(tmp_path / "rpm.csv", ([*header, "motor_speed [rad/s]"], np.column_stack([table, speed * 9.5493])))
    assert "motor_speed is 9.5" in refusal("friction", wrong, *files)


def test_error_of_duplicate_missing_or_unreadable_files(tmp_path: Path) -> None:
    first = shipped("backlash")[0]
    copy = tmp_path / "copy.csv"
    copy.write_bytes(first.read_bytes())
    assert "the same contents" in refusal("backlash", first, copy)
    assert "none.csv: cannot be read" in refusal("backlash", tmp_path / "none.csv")
    empty = tmp_path / "empty.csv"
    empty.write_text("", encoding="utf-8")
    assert "is empty" in refusal("backlash", empty)
    binary = tmp_path / "binary.csv"
    binary.write_bytes(b"\xff\xfe\x00\x01" * 20)
    assert "not a text file" in refusal("backlash", binary)
    ragged = tmp_path / "ragged.csv"
    ragged.write_text("time,motor_angle,fin_angle\n0,1,2\n1,2\n", encoding="utf-8")
    assert "data row 2 has 2 cells" in refusal("backlash", ragged)
    twice = tmp_path / "twice.csv"
    twice.write_text("time,motor_angle,motor_angle [deg],fin_angle\n0,1,2,3\n", encoding="utf-8")
    assert "two columns motor_angle" in refusal("backlash", twice)
    assert "there is no folder" in refusal("backlash", first, "--output", tmp_path / "none" / "x.toml")


def test_too_noisy_records_are_refused(tmp_path: Path) -> None:
    rng = np.random.default_rng(8)
    noisy = []
    for f in shipped("friction"):
        header, table = load(f)
        table[:, 2] += rng.normal(0.0, 12.0, len(table))
        noisy.append(store(tmp_path / f.name, (header, table)))
    assert "not supported by the data" in refusal("friction", *noisy)


def test_error_if_the_fit_is_nan_or_undetermined() -> None:
    with pytest.raises(RecordError, match="no parameters fit"):
        solve(lambda x: x * np.nan, np.ones(2))
    with pytest.raises(RecordError, match="undetermined"):
        weighted_fit((), each(lambda x: [(x[0] + x[1]) * np.ones(30) - np.arange(30.0)]), np.zeros(2), np.ones(2), [0])
