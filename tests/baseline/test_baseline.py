"""Baselines: changes that are drift, changes that are not, and the outputs."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from dataclasses import replace
from math import inf, nan, radians
from pathlib import Path
from typing import Any

import junitparser
import numpy as np
import pytest

from emcas_fmu.bench.measure import Test, excitation
from emcas_fmu.bench.subject import ParameterSubject
from emcas_fmu.parameters import load_parameters
from emcas_fmu.parameters.schema import In
from emcas_fmu.studies.baseline.comparison import TEMPLATE, Row, compare
from emcas_fmu.studies.baseline.files import read, read_plan
from emcas_fmu.studies.baseline.model import ALL, BaselineMotion, DriftLimit, file_unit, output_units

from .conftest import SHORT, check, edit, emcas, record


def drift(shipped: Path, changes: Mapping[str, object]) -> list[Row]:
    """Return the drifted rows of the shipped set with changed parameters."""
    subject = ParameterSubject(load_parameters().with_values(changes))
    return list(compare(read(shipped / "baseline"), subject, shipped / "baseline").drifted)


@pytest.mark.parametrize("changes", [{}, {"solver.max_tick": 3.5e-4}, {"mounting.azimuth": 0.5}])
def test_change_without_effect_is_no_drift(shipped: Path, changes: Mapping[str, object]) -> None:
    """Nothing, finer ticks, another azimuth without gravity."""
    assert not drift(shipped, changes)


@pytest.mark.parametrize(("name", "factor"), [("screw.lead", 1.002), ("drive.transport_delay", 1.002),
                                              ("controller.position.kp", 1.01), ("motor.torque_constant", 0.98),
                                              ("motor.resistance", 1.05)])
def test_change_with_effect_is_drift(shipped: Path, values: Mapping[str, Any], name: str, factor: float) -> None:
    assert drift(shipped, {name: values[name] * factor})


def test_finer_tick_uses_less_than_half_of_every_limit(shipped: Path) -> None:
    """docs/tools/ci.md: at most 47 % of a limit, that of a power peak."""
    subject = ParameterSubject(load_parameters().with_values({"solver.max_tick": 3.5e-4}))
    shares = [row.share for row in compare(read(shipped / "baseline"), subject, shipped / "baseline").rows]
    assert 0.0 < max(shares) < 0.5


@pytest.mark.fmu
@pytest.mark.parametrize("backend", [pytest.param("python", marks=pytest.mark.slow), "native"])
def test_baseline_of_an_fmu_equals_that_of_its_parameters(
        shipped: Path, units: Mapping[str, Path], tmp_path: Path, backend: str) -> None:
    emcas("record", units[backend], "--output", tmp_path)
    for path in (shipped / "baseline").glob("*.csv"):
        assert (tmp_path / path.name).read_bytes() == path.read_bytes()
    expected, by_fmu = read(shipped / "baseline"), read(tmp_path)
    assert {n: c.figures for n, c in expected.case.items()} == {n: c.figures for n, c in by_fmu.case.items()}
    assert expected.parameters == by_fmu.parameters
    assert by_fmu.recorded["guid"].startswith("{")


def test_recording_twice_gives_the_same_bytes(short: Path) -> None:
    before = {path: path.read_bytes() for path in (short / "baseline").iterdir()}
    assert len(before) == 2
    record(short)
    assert {path: path.read_bytes() for path in (short / "baseline").iterdir()} == before


def test_baseline_is_smaller_than_100_kib(shipped: Path) -> None:
    assert sum(path.stat().st_size for path in (shipped / "baseline").iterdir()) < 100 * 1024


def test_drift_is_in_every_output(folder: Path) -> None:
    (folder / "changed.toml").write_text('[motor]\ntorque_constant = "0.1 N*m/A"\n')
    files = {key: folder / f"out.{kind}" for key, kind in (
        ("json", "json"), ("junit", "xml"), ("markdown", "md"), ("report", "html"))}
    options = [part for key, path in files.items() for part in (f"--{key}", path)]
    printed = check(folder, *options, article="changed.toml", code=1)
    assert "DRIFT" in printed
    assert re.search(r"0\.11 N\.m/A +0\.1 N\.m/A", printed)
    assert re.search(r"0\.11 V\.s/rad +0\.1 V\.s/rad", printed)  # the motor's other constant follows
    assert "If this is intended: emcas baseline record" in printed
    document = json.loads(files["json"].read_text())
    drifted = [row for row in document["comparisons"] if not row["passed"]]
    assert drifted
    assert not document["passed"]
    assert [c["name"] for c in document["changed_parameters"]] == ["motor.torque_constant",
                                                                      "motor.back_emf_constant"]
    suites = junitparser.JUnitXml.fromfile(str(files["junit"]))
    assert suites.failures == len(drifted)
    assert suites.tests == sum(row["limit"] is not None for row in document["comparisons"])
    markdown = files["markdown"].read_text()
    assert markdown.count("**DRIFT**") == len(drifted)
    page = files["report"].read_text()
    assert page.count(">DRIFT<") == len(drifted)
    assert page.count("<figure class=\"curves\">") == 7  # every case but the two sweeps
    # A line may break within a hash of 64 digits, but not within the name before it.
    assert re.search(r"<code>parameters_sha256</code></td><td class=\"how\">[0-9a-f]{64}</td>", page)
    assert "td:first-child code { overflow-wrap: normal; }" in page
    # On paper nothing scrolls, and no page ends after a heading or the head of a table.
    paper = page[page.index("@media print"):page.index("</style>")]
    for rule in (".wide { overflow: visible; }", "h1, h2, h3, caption { break-after: avoid; }",
                 "tbody tr:nth-child(-n+2), tr:has(> [colspan]) { break-after: avoid; }"):
        assert rule in paper
    check(folder, "--markdown", files["markdown"])
    assert files["markdown"].read_text().startswith(markdown)  # a second run appends to the file


def test_cases_with_the_same_title_are_separate_suites(short: Path) -> None:
    (short / "baseline/baseline.toml").write_text(
        SHORT + SHORT[SHORT.index("[case.only]"):].replace("[case.only]", "[case.again]"))
    record(short)
    check(short, "--junit", short / "drift.xml")
    names = [suite.name for suite in junitparser.JUnitXml.fromfile(str(short / "drift.xml"))]
    assert [name.partition(": ")[0] for name in names] == ["only", "again"]


def test_limits_of_the_user_are_kept(short: Path) -> None:
    (short / "changed.toml").write_text('[motor]\ntorque_constant = "0.1 N*m/A"\n')
    file = short / "baseline/baseline.toml"
    check(short, article="changed.toml", code=1)
    edit(file, '"0.05 deg"', '"5 deg"')
    edit(file, "[case.only.figures]",
         '[case.only.limits]\nrise_time = { absolute = "20 ms", relative = "0 %" }\n[case.only.figures]')
    check(short, article="changed.toml")
    record(short, article="changed.toml")
    recorded = read(short / "baseline")
    assert recorded.case["only"].limits == {"rise_time": limit(20.0)}
    assert recorded.limits.traces == {"fin_angle": 5.0}
    record(short, "--fresh", article="changed.toml")
    assert len(read(short / "baseline").case) > 1


def test_limit_of_a_case_replaces_the_common_limit(short: Path) -> None:
    (short / "changed.toml").write_text('[controller]\nposition.kp = "53.85 1/s"\n')
    check(short, article="changed.toml")
    edit(short / "baseline/baseline.toml", "[case.only.figures]",
         '[case.only.limits]\nsustained_rate = { absolute = "0 deg/s", relative = "0 %" }\n[case.only.figures]')
    printed = check(short, article="changed.toml", code=1)
    assert [line for line in printed.splitlines() if "DRIFT" in line and "sustained_rate" in line]


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_single_deviating_point_of_a_trajectory_is_drift(shipped: Path, sign: float) -> None:
    approved = read(shipped / "baseline")
    points = approved.traces["step"]["fin_angle"].copy()
    points[100] -= sign * 0.2
    baseline = approved.model_copy(update={"case": {"step": approved.case["step"]},
                                           "traces": {"step": {"fin_angle": points}}})
    (row,) = compare(baseline, ParameterSubject(load_parameters()), shipped / "baseline").drifted
    assert (row.name, row.at) == ("fin_angle", 0.5)
    assert row.now - row.approved == pytest.approx(sign * 0.2, abs=1e-3)  # rounding in the file


def test_case_with_an_input_file_start_values_and_another_output(short: Path) -> None:
    rows = [f"{k / 1000:g},{0.1 * (k > 50)},{-20.0 * (k > 100)}" for k in range(301)]
    (short / "baseline/flight.csv").write_text("\n".join(["time,fin_command,aero_torque", *rows]))
    file = short / "baseline/baseline.toml"
    file.write_text(file.read_text().replace('fin_angle = "0.05 deg"', 'fin_angle = "0.05 deg"\nmotor_current = "5 A"')
                    + '\n[case.replay]\nkind = "file"\nfile = "flight.csv"\n'
                    'start = { "friction.temperature" = "-6 degC", "encoder.enabled" = false }\n')
    record(short)
    recorded = read(short / "baseline")
    assert recorded.case["replay"].start == {"friction.temperature": -6.0, "encoder.enabled": False}
    assert list(recorded.traces["replay"]) == ["fin_angle", "motor_current"]
    check(short)


def test_commands_are_reduced_to_the_range_when_recorded(tmp_path: Path) -> None:
    (tmp_path / "small.toml").write_text('[command]\nlimit = "12 deg"\n')
    record(tmp_path, article="small.toml")
    amplitudes = {name: c.amplitude for name, c in read(tmp_path / "baseline").case.items()
                  if isinstance(c, BaselineMotion)}
    assert (amplitudes["large_step"], amplitudes["step"]) == (radians(12.0), radians(-5.0))


def test_slew_of_a_baseline_is_that_of_requirements() -> None:
    """The fin is at the starting end from the first row on."""
    subject = ParameterSubject(load_parameters())
    slew = read_plan(TEMPLATE).case["opposing_load"].inputs(Path(), subject)
    tested = excitation(Test("slew", radians(20.0), 1.0, -100.0), 1.0, subject)
    assert (slew.title, slew.begin, set(slew.columns)) == (tested.title, tested.begin, set(tested.columns))
    assert all(np.array_equal(slew.columns[name], column) for name, column in tested.columns.items())


def test_figures_of_a_fin_that_does_not_move_are_never(tmp_path: Path) -> None:
    (tmp_path / "dead.toml").write_text('[drive]\nsupply_voltage = "0 V"\n')
    record(tmp_path, article="dead.toml")
    text = (tmp_path / "baseline/baseline.toml").read_text()
    assert 'rise_time = "never"' in text
    assert 'peak_gain = "never"' in text
    check(tmp_path, article="dead.toml")
    (tmp_path / "alive.toml").write_text("")
    assert "not reached" in check(tmp_path, article="alive.toml", code=1)


def limit(absolute: float, relative: float = 0.0) -> DriftLimit:
    """Return a limit in ms and %."""
    return DriftLimit.model_validate({"absolute": f"{absolute!r} ms", "relative": f"{relative!r} %"}, context=In("ms"))


def row(approved: float, now: float, allowed: DriftLimit | None) -> Row:
    return Row("case", "rise_time", "ms", approved, now, None if allowed is None else allowed.of(approved))


@pytest.mark.parametrize(("approved", "now", "allowed", "passed"), [
    (100.0, 101.0, limit(0.0, 1.0), True), (100.0, 101.1, limit(0.0, 1.0), False),
    (10.0, 10.4, limit(0.5, 1.0), True), (10.0, 9.4, limit(0.5, 1.0), False),
    (-10.0, -10.05, limit(0.0, 1.0), True), (-10.0, -10.2, limit(0.0, 1.0), False),
    (5.0, 5.0, limit(0.0), True), (5.0, 5.00001, limit(0.0), False),
    (nan, nan, limit(1.0), True), (nan, 3.0, limit(1e9), False), (3.0, nan, limit(1e9, 1000.0), False),
    (3.0, 300.0, None, True),
])
def test_row_passes_within_the_larger_limit(
        approved: float, now: float, allowed: DriftLimit | None, passed: bool) -> None:
    assert row(approved, now, allowed).passed is passed


def test_comparison_without_limits_or_with_an_early_end_does_not_pass(short: Path) -> None:
    subject = ParameterSubject(load_parameters())
    found = compare(read(short / "baseline"), subject, short / "baseline")
    assert found.passed
    assert not replace(found, rows=tuple(replace(r, limit=None) for r in found.rows)).passed
    assert not replace(found, stopped={"only": "went no further than 0.1 s"}).passed


def test_share_of_nan_is_infinite_and_figures_have_display_units() -> None:
    assert row(1.0, nan, limit(1.0)).share == inf
    assert {"fin_angle", "fin_rate", "motor_current", "motor_voltage", "supply_power"} < set(output_units("nonlinear"))
    assert {file_unit(name) for name in ALL} == {"ms", "%", "deg", "deg/s", "Hz", "dB", "A", "W", "J"}
