"""The comparison of the simulated XL330 with synthetic, bad and, if present, measured records."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from math import nan
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from emcas_fmu.api import load_parameters, simulate
from emcas_fmu.parameters.measured import measured_records
from examples.xl330 import calibration, compare, records
from examples.xl330.evolution import minimised
from tests.docs.recipes import ROOT

GAIN, MASS, LENGTH = 400, 0.49, 0.1


def contents(count: int = 300, **entries: Any) -> dict[str, Any]:
    """Return a record at 180 Hz of a servo that does not move; `entries` change the columns."""
    rows = [{"timestamp": 0.004 + k / 180.0, "goal_position": 0.6 * (k > 20), "torque_enable": k < 250,
             "position": 0.0, "load": 0, "temp": 30, **entries} for k in range(count)]
    return {"mass": MASS, "length": LENGTH, "kp": GAIN, "trajectory": "step", "entries": rows}


def write(folder: Path, record: Any) -> Path:
    path = folder / "record.json"
    path.write_text(json.dumps(record), encoding="utf-8")
    return path


def test_record_simulated_by_the_model_has_no_error(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    made = contents()
    run = records.read(write(tmp_path, made))
    position = records.simulated(run, records.shipped(), {})
    assert 0.2 < position[200] < 0.6  # the servo lifts the pendulum
    assert position[-1] < 0.5 * position[240]  # and the pendulum falls
    for entry, angle in zip(made["entries"], position):
        entry["position"] = float(angle)
    path, out = write(tmp_path, made), tmp_path / "errors.json"
    assert compare.main(["--records", str(path), "--json", str(out)]) == 0
    found = json.loads(out.read_text(encoding="utf-8"))
    # Record and simulation start at rest: only the digits of JSON differ.
    assert found["mean_abs_error_mrad"] < 1e-6
    assert found["records"] == [{
        "file": path.name, "sha256": hashlib.sha256(path.read_bytes()).hexdigest(), "kp": GAIN, "trajectory": "step",
        "mean_abs_error_mrad": found["mean_abs_error_mrad"]}]
    assert (found["calibrated"], found["unseen"]) == ({}, {})
    assert "mean of 1" in capsys.readouterr().out


def test_error_is_the_mean_absolute_error(tmp_path: Path) -> None:
    run = records.read(write(tmp_path, contents(3)))
    assert records.error(run, np.array([0.01, -0.02, 0.0])) == pytest.approx(10.0)


def test_heavier_pendulum_is_lifted_less(tmp_path: Path) -> None:
    def angle(mass: float) -> float:
        run = records.read(write(tmp_path, {**contents(200), "mass": mass}))
        return float(records.simulated(run, records.shipped(), {records.TILT_NAME: 0.0})[-1])

    assert angle(0.2) > angle(0.49) > angle(0.9) > 0.0


def test_simulations_computed_together_equal_single_ones(tmp_path: Path) -> None:
    """All bits are equal. At timestamps on the grid they agree with `simulate`."""
    made = contents()
    for k, entry in enumerate(made["entries"]):
        entry["timestamp"] = 0.004 * k + 0.001 * (k % 3)
    run, base = records.read(write(tmp_path, made)), records.shipped()
    stall, tilt = np.array([0.7, 0.9, 1.1]), np.array([0.0, 0.02, -0.05])
    both = records.simulated(run, base, {"motor.stall_torque": stall, records.TILT_NAME: tilt})
    assert len({tuple(row) for row in both}) == 3
    for row, torque, angle in zip(both, stall, tilt, strict=True):
        alone = records.simulated(run, base, {"motor.stall_torque": torque, records.TILT_NAME: angle})
        assert np.array_equal(row, alone)
    milliseconds = np.round(1e3 * run.time).astype(int)
    held = np.searchsorted(milliseconds, np.arange(milliseconds[-1] + 1), side="right") - 1
    bench = records.of_bench(run, base.with_values({"motor.stall_torque": 0.7}))
    response = simulate(bench, stop=1e-3 * milliseconds[-1], step=records.STEP, fin_command=run.goal[held],
                        enable=run.enabled[held])
    np.testing.assert_allclose(both[0], response["fin_angle"][milliseconds], rtol=0, atol=1e-12)  # rounded timestamps


def test_search_finds_the_minimum_of_a_stepped_valley_and_the_end_of_a_slope() -> None:
    bottom = np.array([0.5, -1.0, 0.3, 0.0])

    def cost(points: Any) -> Any:
        x = points - bottom[:, None]
        smooth = 10.0 * (x[1] - x[0]) ** 2 + x[0] ** 2 + 5.0 * x[2] ** 2 + (x[3] - x[2] ** 2) ** 2
        return np.floor(smooth / 0.01) * 0.01

    reports: list[int] = []
    found = minimised(cost, np.zeros(4), 0.5, 3.0, 60, 16, 1, lambda generation, _: reports.append(generation))
    assert reports == list(range(1, 61))
    assert cost(found[:, None])[0] <= 0.01
    assert np.array_equal(found, minimised(cost, np.zeros(4), 0.5, 3.0, 60, 16, 1))  # same seed
    clipped = minimised(lambda points: -points[0], np.zeros(2), 0.5, 3.0, 40, 8, 1)
    assert clipped[0] == pytest.approx(3.0)


def test_groups_have_each_gain_and_trajectory_once() -> None:
    """Twelve of the sixteen published runs; the other four are a group."""
    def run(trajectory: str, gain: float) -> records.Record:
        nothing = np.zeros(0)
        return records.Record(Path(), "", gain, MASS, LENGTH, trajectory, nothing, nothing, nothing > 0, nothing)

    left_out = {("sin_time_square", 100.0), ("up_and_down", 200.0), ("sin_sin", 400.0), ("lift_and_drop", 800.0)}
    every = [(name, gain) for name, _ in sorted(left_out) for gain in (100.0, 200.0, 400.0, 800.0)]
    found = calibration.groups([run(*each) for each in every if each not in left_out])
    assert [len(group) for group in found] == [4, 4, 4]
    for group in found:
        assert len({each.gain for each in group}) == len({each.trajectory for each in group}) == 4
    assert {(each.trajectory, each.gain) for each in calibration.groups([run(*each) for each in every])[0]} == left_out


@pytest.mark.slow
def test_calibration_recovers_the_simulated_servo(tmp_path: Path) -> None:
    """Calibrated to two synthetic records from the data sheet, the servo predicts a third with a fifth of the error."""
    true = calibration.values_of(np.array([0.6, -0.5, 0.5, 0.3, -0.5, 0.5, 1.0, 0.3, 0.2, 0.0, 0.3, 0.7]))
    paths = []
    for gain, amplitude in ((200, 0.5), (800, 0.9), (400, 0.7)):
        record = {**contents(500), "kp": gain}
        for k, entry in enumerate(record["entries"]):
            entry |= {"goal_position": amplitude * np.sin(0.02 * k) + 0.4 * (k // 100 % 2), "torque_enable": k < 400}
        paths.append(tmp_path / f"{gain}.json")
        paths[-1].write_text(json.dumps(record), encoding="utf-8")
        for entry, angle in zip(record["entries"], records.simulated(records.read(paths[-1]), records.shipped(), true)):
            entry["position"] = float(angle)
        record["entries"] = record["entries"][5:]
        paths[-1].write_text(json.dumps(record), encoding="utf-8")
    *fitted, third = map(records.read, paths)
    base = records.shipped()
    begin = records.error(third, records.simulated(third, base, calibration.typical()))
    left = calibration.unseen([*fitted, third], base, [third])["400.json"]
    assert left < begin / 5.0  # measured 1/13; the rest is the prior, and the angle at which the servo sticks


def _without(record: dict[str, Any], name: str) -> dict[str, Any]:
    return {key: value for key, value in record.items() if key != name}


def _changed(index: int, **entry: Any) -> dict[str, Any]:
    record = contents()
    record["entries"][index] |= entry
    return record


BAD: dict[str, tuple[Callable[[], Any], str]] = {
    "mass": (lambda: _without(contents(), "mass"), "there is no mass"),
    "entries": (lambda: _without(contents(), "entries"), "no list `entries`"),
    "list": (lambda: [1, 2], "is not a record"),
    "position": (lambda: _changed(7, position=None), "entry 7: position is None; it must be a number"),
    "nan": (lambda: _changed(9, position=nan), "entry 9: position is nan; leave this entry out"),
    "goal": (lambda: {**contents(), "entries": [_without(e, "goal_position") for e in contents()["entries"]]},
             "entry 0: there is no goal_position"),
    "time": (lambda: _changed(9, timestamp=0.0), "entry 9: timestamp 0 is not after the one before"),
    "one": (lambda: contents(1), "has 1 entries"),
    "mass 0": (lambda: {**contents(), "mass": -1.0}, "mass -1 kg and length 0.1 m of the pendulum must be above 0"),
}


@pytest.mark.parametrize("name", BAD)
def test_error_of_a_bad_record_is_one_line(name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    record, message = BAD[name]
    assert compare.main(["--records", str(write(tmp_path, record()))]) == compare.REFUSED
    error = capsys.readouterr().err
    assert error.startswith("error: ")
    assert error.count("\n") == 1
    assert message in error


def test_unseen_needs_two_records(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert compare.main(["--records", str(write(tmp_path, contents(3))), "--unseen"]) == compare.REFUSED
    assert "record.json: is the only record; pass more, so that one can be left out" in capsys.readouterr().err


def test_error_without_records_says_where_they_are(
        tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.delenv(records.FOLDER, raising=False)
    for arguments in ([], ["--records", str(tmp_path)], ["--records", str(tmp_path / "none.json")]):
        assert compare.main(arguments) == compare.NO_RECORDS
        error = capsys.readouterr().err
        assert "Rhoban/bam" in error
        assert "Apache-2.0" in error


@pytest.mark.parametrize("output", [["--json", "no/errors.json"], ["--plot", "plot.html"]])
def test_outputs_are_checked_before_the_work(output: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
                                             ) -> None:
    path = write(tmp_path, contents(3))
    assert compare.main(["--records", str(path), *output]) == compare.REFUSED
    printed = capsys.readouterr()
    assert printed.out == ""
    assert output[1] in printed.err


def test_interruption_has_no_traceback(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(records, "simulated", interrupted)
    assert compare.main(["--records", str(write(tmp_path, contents(3)))]) == 130


def test_error_of_the_measured_records_is_below_the_target(tmp_path: Path) -> None:
    """The set was identified from these records."""
    try:
        chosen = records.files(None)
    except records.NoRecordsError as error:
        pytest.skip(str(error))
    out = tmp_path / "errors.json"
    assert compare.main(["--json", str(out), "--plot", str(tmp_path / "plot.png")]) == 0
    found = json.loads(out.read_text(encoding="utf-8"))
    assert len(found["records"]) == len(chosen)
    assert (tmp_path / "plot.png").stat().st_size > 10_000
    assert found["mean_abs_error_mrad"] < 30.0  # the target; other angles of sticking change the error by some mrad


def test_set_contains_hash_and_error_of_its_records() -> None:
    path = ROOT / "models/sets/xl330.toml"
    named = {each.name: each for each in measured_records(path.name, path.read_bytes())}
    assert len(named) == 12
    assert all("fitted; position mean absolute error" in each.use for each in named.values())
    assert {e.variable.name for e in load_parameters("xl330", model="servo").entries if e.source == "identified"} >= (
        calibration.FREE.keys() - {records.TILT_NAME})
    try:
        runs = [records.read(file) for file in records.files(None)]
    except records.NoRecordsError as error:
        pytest.skip(str(error))
    for run in runs:
        if run.path.name in named:
            assert run.sha256 == named[run.path.name].sha256
            mean = records.error(run, records.simulated(run, records.shipped(), {}))
            assert named[run.path.name].use == f"fitted; position mean absolute error {mean:.1f} mrad"


@pytest.mark.slow
def test_calibration_from_the_data_sheet_gives_the_set(tmp_path: Path) -> None:
    """Within 1.5 mrad of the error, since rounding changes the search like another seed."""
    try:
        chosen = records.files(None)
    except records.NoRecordsError as error:
        pytest.skip(str(error))
    out = tmp_path / "fit.json"
    assert compare.main(["--records", *map(str, chosen), "--fit", "--json", str(out)]) == 0
    found = json.loads(out.read_text(encoding="utf-8"))
    base, runs = records.shipped(), [records.read(path) for path in chosen]
    shipped = np.mean([records.error(run, records.simulated(run, base, {})) for run in runs])
    assert found["mean_abs_error_mrad"] == pytest.approx(shipped, abs=1.5)
    for name, prior in calibration.FREE.items():
        near = prior.at(np.array([-1.0, 1.0])) - prior.typical
        assert near[0] < found["calibrated"][name] - records.value(base, name) < near[1]
