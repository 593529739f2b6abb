"""Parameter sets side by side: the readings of the current loop, and the command."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from emcas_fmu.bench.requirements import load_requirements
from emcas_fmu.bench.subject import ParameterSubject
from emcas_fmu.bench.verdict import judge
from emcas_fmu.cli import app
from emcas_fmu.errors import EmcasError
from emcas_fmu.parameters import load_parameters
from emcas_fmu.studies.compare import sets
from emcas_fmu.studies.compare.sets import DRIVES, Column, compare, load_sets
from emcas_fmu.support.files import named_sets


@pytest.fixture(scope="module")
def drives() -> dict[str, Column]:
    return {column.name: column for column in compare(load_sets(DRIVES, "nonlinear")).columns}


def _measured(column: Column) -> dict[str, float]:
    return {j.name: j.measured for j in column.judged if j.measured is not None}


def test_the_readings_of_the_gains_that_meet_the_requirements(drives: dict[str, Column]) -> None:
    missed = {name: [j.name for j in column.judged if not j.passed] for name, column in drives.items()}
    assert missed["drive-si"] == missed["drive-pi"] == []
    assert "loaded_rate" in missed["drive-scaled"]
    assert [name for name, column in drives.items() if column.passed] == ["default", "drive-si", "drive-pi"]


def test_a_stiffer_current_loop_is_faster(drives: dict[str, Column]) -> None:
    """The drop over R and back-EMF is a damping of the motor that K_p and K_i take away."""
    for rate in ("unloaded_rate", "loaded_rate"):
        found = [_measured(drives[name])[rate] for name in ("drive-scaled", "drive-si", "drive-pi")]
        assert found == sorted(found)
        assert found[2] - found[1] > 5.0  # deg/s


def test_the_default_set_is_judged_as_everywhere(drives: dict[str, Column]) -> None:
    """The same rows and the same figures."""
    parameters = load_parameters()
    assert list(drives["default"].judged) == judge(ParameterSubject(parameters), load_requirements(None, parameters))


def test_what_differs_between_the_sets(drives: dict[str, Column]) -> None:
    assert sets.Result(tuple(drives.values())).differing == {
        "drive.kp": (5.0, 5.0, 1.04, 5.0), "drive.ki": (0.1, 0.1, 0.0018, 2083.0)}


def test_the_robust_set_meets_the_requirements_as_its_file_says() -> None:
    column, = compare(load_sets(["robust"], "nonlinear")).columns
    assert [j.name for j in column.judged if not j.passed] == []
    assert f"{_measured(column)['loaded_rate']:.1f} deg/s" in named_sets()["robust"].read_text(encoding="utf-8")


def test_files_lie_below_every_set(tmp_path: Path) -> None:
    below = tmp_path / "mine.toml"
    below.write_text("drive.kp = '4 V/A'\nmotor.resistance = '0.3 Ohm'\n", encoding="utf-8")
    sets = load_sets(["default", "drive-pi"], "nonlinear", [below])
    assert [(s.values["drive.kp"], s.values["motor.resistance"]) for s in sets.values()] == [(4.0, 0.3), (5.0, 0.3)]


def test_sets_that_cannot_be_compared() -> None:
    with pytest.raises(EmcasError, match="drive-pi: appears twice"):
        load_sets(["drive-pi", "drive-pi"], "nonlinear")
    refused = _emcas("default", "drive-pie")
    assert refused.exit_code == 2
    assert "did you mean drive-pi?" in refused.stderr


def _emcas(*arguments: object) -> Result:
    return CliRunner().invoke(app, ["compare", *map(str, arguments)])


def test_all_are_judged_by_the_requirements_of_the_first() -> None:
    """A servo and a missile's actuator have their own."""
    kinds = {name: load_parameters(model=name) for name in ("servo", "second-order")}
    rows = compare(kinds).rows
    assert [row[0].name for row in rows] == [r.name for r in load_requirements(None, kinds["servo"]).requirements]
    assert all(servo.title == other.title for servo, other in rows)


def test_the_command_shows_verdicts_and_does_not_judge(tmp_path: Path) -> None:
    done = _emcas("default", "drive-scaled", "--json", tmp_path / "c.json", "--report", tmp_path / "c.html")
    assert done.exit_code == 0, done.output + done.stderr
    assert "FAIL" in done.stdout
    found = json.loads((tmp_path / "c.json").read_text())
    assert [(entry["name"], entry["passed"]) for entry in found["sets"]] == [("default", True), ("drive-scaled", False)]
    assert found["differing"]["drive.kp"] == {"default": 5.0, "drive-scaled": 1.04}
    page = (tmp_path / "c.html").read_text(encoding="utf-8")
    assert page.count(">✗<") == sum(not r["passed"] for entry in found["sets"] for r in entry["requirements"])
    assert "<svg" in page
    sources = [e.source for e in load_parameters().entries]
    assert f"{sources.count('estimate')} of the {len(sources)} parameters are <strong>engineering estimates" in page
    assert [row["name"] for row in found["sets"][0]["requirements"]] == [
        r.name for r in load_requirements(None, load_parameters()).requirements]


def test_requirements_of_a_file_replace_the_shipped_ones(tmp_path: Path) -> None:
    mine = tmp_path / "mine.toml"
    mine.write_text('[[requirements]]\nname = "current"\ntest = { kind = "step", amplitude = "5 deg" }\n'
                    'figure = "peak_current"\nmaximum = "1 A"\noptional = true\n', encoding="utf-8")
    done = _emcas("default", "second-order", "--requirements", mine, "--json", tmp_path / "c.json")
    assert done.exit_code == 0, done.output + done.stderr
    assert "default: misses current" in done.stdout
    assert "second-order: misses everything: nothing was judged" in done.stdout  # never met by what it has not
    found = json.loads((tmp_path / "c.json").read_text())
    assert [(s["passed"], [(r["name"], r["skipped"]) for r in s["requirements"]]) for s in found["sets"]] == [
        (False, [("current", False)]), (False, [("current", True)])]
