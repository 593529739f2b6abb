"""The comparison of the simulated XL330 with records: of a made record, of bad ones, and of the real ones if there."""

from __future__ import annotations

import json
from collections.abc import Callable
from math import nan
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from examples.xl330 import compare, records

GAIN, MASS, LENGTH = 400, 0.49, 0.1


def contents(count: int = 300, **entries: Any) -> dict[str, Any]:
    """A record of a servo that does not move, at 180 Hz, with other `entries` by name."""
    rows = [{"timestamp": 0.004 + k / 180.0, "goal_position": 0.6 * (k > 20), "torque_enable": k < 250,
             "position": 0.0, "load": 0, "temp": 30, **entries} for k in range(count)]
    return {"mass": MASS, "length": LENGTH, "kp": GAIN, "trajectory": "step", "entries": rows}


def written(folder: Path, record: Any) -> Path:
    path = folder / "record.json"
    path.write_text(json.dumps(record), encoding="utf-8")
    return path


def test_a_record_made_by_the_model_has_no_error(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    made = contents()
    run = records.read(written(tmp_path, made))
    position = records.simulated(run, records.shipped(), records.TILT)
    assert 0.2 < position[200] < 0.6  # lifts the pendulum against friction
    assert position[-1] < 0.5 * position[240]  # and lets it fall
    for entry, angle in zip(made["entries"], position):
        entry["position"] = float(angle)
    path, out = written(tmp_path, made), tmp_path / "errors.json"
    assert compare.main(["--records", str(path), "--json", str(out)]) == 0
    found = json.loads(out.read_text(encoding="utf-8"))
    # The record starts at rest as the simulation does: the digits of JSON.
    assert found["mean_abs_error_mrad"] < 1e-6
    assert found["records"] == [{"file": "record.json", "kp": GAIN, "trajectory": "step", "mean_abs_error_mrad":
                                 found["mean_abs_error_mrad"]}]
    assert "mean of 1" in capsys.readouterr().out


def test_the_error_is_the_mean_of_absolute_ones(tmp_path: Path) -> None:
    run = records.read(written(tmp_path, contents(3)))
    assert records.error(run, np.array([0.01, -0.02, 0.0])) == pytest.approx(10.0)


def test_a_heavier_pendulum_is_lifted_less(tmp_path: Path) -> None:
    def lifted(mass: float) -> float:
        run = records.read(written(tmp_path, {**contents(200), "mass": mass}))
        return float(records.simulated(run, records.shipped(), 0.0)[-1])

    assert lifted(0.2) > lifted(0.49) > lifted(0.9) > 0.0


def _without(record: dict[str, Any], name: str) -> dict[str, Any]:
    return {key: value for key, value in record.items() if key != name}


def _changed(index: int, **entry: Any) -> dict[str, Any]:
    record = contents()
    record["entries"][index] |= entry
    return record


BAD: dict[str, tuple[Callable[[], Any], str]] = {
    "mass": (lambda: _without(contents(), "mass"), "there is no mass"),
    "entries": (lambda: _without(contents(), "entries"), "no list entries"),
    "list": (lambda: [1, 2], "is no record"),
    "position": (lambda: _changed(7, position=None), "entry 7: position is None; it must be a number"),
    "nan": (lambda: _changed(9, position=nan), "entry 9: position is nan; leave such entries out"),
    "goal": (lambda: {**contents(), "entries": [_without(e, "goal_position") for e in contents()["entries"]]},
             "entry 0: there is no goal_position"),
    "time": (lambda: _changed(9, timestamp=0.0), "entry 9: timestamp 0 is not after the one before"),
    "one": (lambda: contents(1), "has 1 entries"),
    "mass 0": (lambda: {**contents(), "mass": -1.0}, "mass -1 kg and length 0.1 m of the pendulum must be above 0"),
}


@pytest.mark.parametrize("name", BAD)
def test_a_bad_record_is_an_error_of_one_line(name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    record, message = BAD[name]
    assert compare.main(["--records", str(written(tmp_path, record()))]) == compare.REFUSED
    error = capsys.readouterr().err
    assert error.startswith("error: ")
    assert error.count("\n") == 1
    assert message in error


def test_without_records_it_says_where_they_are(tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
                                                capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.delenv(records.FOLDER, raising=False)
    for arguments in ([], ["--records", str(tmp_path)], ["--records", str(tmp_path / "none.json")]):
        assert compare.main(arguments) == compare.NO_RECORDS
        error = capsys.readouterr().err
        assert "Rhoban/bam" in error
        assert "Apache-2.0" in error


def test_the_records(tmp_path: Path) -> None:
    """The figure of the README, on the records that the set was identified from."""
    try:
        chosen = records.files(None)
    except records.NoRecordsError as error:
        pytest.skip(str(error))
    out = tmp_path / "errors.json"
    assert compare.main(["--json", str(out), "--plot", str(tmp_path / "plot.png")]) == 0
    found = json.loads(out.read_text(encoding="utf-8"))
    assert len(found["records"]) == len(chosen)
    assert (tmp_path / "plot.png").stat().st_size > 10_000
    assert found["mean_abs_error_mrad"] < 30.0  # the target; sticking at another angle changes it by some mrad
