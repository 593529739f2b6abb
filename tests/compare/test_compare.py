"""Comparison of parameter sets: readings of the current loop's gains, and the command `emcas compare`."""

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


def test_readings_of_the_drive_gains_that_meet_the_requirements(drives: dict[str, Column]) -> None:
    missed = {name: [j.name for j in column.judged if not j.passed] for name, column in drives.items()}
    assert missed["drive-si"] == missed["drive-pi"] == []
    assert "loaded_rate" in missed["drive-scaled"]
    assert [name for name, column in drives.items() if column.passed] == ["default", "drive-si", "drive-pi"]


def test_stiffer_current_loop_is_faster(drives: dict[str, Column]) -> None:
    """K_p and K_i compensate the voltage drop over R and the back-EMF, which damp the motor."""
    for rate in ("unloaded_rate", "loaded_rate"):
        rates = [_measured(drives[name])[rate] for name in ("drive-scaled", "drive-si", "drive-pi")]
        assert rates == sorted(rates)
        assert rates[2] - rates[1] > 5.0  # deg/s


def test_verdicts_of_the_default_set_equal_those_of_validate(drives: dict[str, Column]) -> None:
    parameters = load_parameters()
    assert list(drives["default"].judged) == judge(ParameterSubject(parameters), load_requirements(None, parameters))


def test_differing_parameters_are_listed(drives: dict[str, Column]) -> None:
    assert sets.SetComparison(tuple(drives.values())).differing == {
        "drive.kp": (5.0, 5.0, 1.04, 5.0), "drive.ki": (0.1, 0.1, 0.0018, 2083.0)}


def test_robust_set_meets_the_requirements_as_its_file_says() -> None:
    column, = compare(load_sets(["robust"], "nonlinear")).columns
    assert [j.name for j in column.judged if not j.passed] == []
    assert f"{_measured(column)['loaded_rate']:.1f} deg/s" in named_sets()["robust"].read_text(encoding="utf-8")


def test_parameter_file_is_the_base_of_every_set(tmp_path: Path) -> None:
    base = tmp_path / "mine.toml"
    base.write_text("drive.kp = '4 V/A'\nmotor.resistance = '0.3 Ohm'\n", encoding="utf-8")
    sets = load_sets(["default", "drive-pi"], "nonlinear", [base])
    assert [(s.values["drive.kp"], s.values["motor.resistance"]) for s in sets.values()] == [(4.0, 0.3), (5.0, 0.3)]


def test_duplicate_or_unknown_set_is_refused() -> None:
    with pytest.raises(EmcasError, match="drive-pi: appears twice"):
        load_sets(["drive-pi", "drive-pi"], "nonlinear")
    refused = _emcas("default", "drive-pie")
    assert refused.exit_code == 2
    assert "did you mean drive-pi?" in refused.stderr


def _emcas(*arguments: object) -> Result:
    return CliRunner().invoke(app, ["compare", *map(str, arguments)])


def test_all_sets_are_judged_by_the_requirements_of_the_first() -> None:
    """The servo has its own requirements."""
    kinds = {name: load_parameters(model=name) for name in ("servo", "second-order")}
    rows = compare(kinds).rows
    assert [row[0].name for row in rows] == [r.name for r in load_requirements(None, kinds["servo"]).requirements]
    assert all(servo.title == other.title for servo, other in rows)


def test_command_shows_verdicts_but_exits_with_0(tmp_path: Path) -> None:
    result = _emcas("default", "drive-scaled", "--json", tmp_path / "c.json", "--report", tmp_path / "c.html")
    assert result.exit_code == 0, result.output + result.stderr
    assert "FAIL" in result.stdout
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
    result = _emcas("default", "second-order", "--requirements", mine, "--json", tmp_path / "c.json")
    assert result.exit_code == 0, result.output + result.stderr
    assert "default: misses current" in result.stdout
    assert "second-order: misses everything: nothing was judged" in result.stdout  # skipped is not met
    found = json.loads((tmp_path / "c.json").read_text())
    assert [(s["passed"], [(r["name"], r["skipped"]) for r in s["requirements"]]) for s in found["sets"]] == [
        (False, [("current", False)]), (False, [("current", True)])]
