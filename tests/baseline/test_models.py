"""Baselines of other actuators: shipped, extended and user's actuators, and their FMUs."""

from __future__ import annotations

from pathlib import Path

import pytest

from emcas_fmu.actuators import get
from emcas_fmu.bench.subject import ParameterSubject
from emcas_fmu.parameters import load_parameters
from emcas_fmu.studies.baseline.comparison import TEMPLATE, first
from emcas_fmu.studies.baseline.files import read, read_plan
from tests.marks import slow

from ..fmu.built import lean
from ..marks import others_slow
from .conftest import SHORT, check, edit, record

DIRECT_DRIVE = str(Path(__file__).parents[2] / "examples/own_actuator/direct_drive.py")
MODELS = ("second-order", DIRECT_DRIVE, "elastic+heat+homing+faults")


@pytest.fixture
def base(tmp_path: Path) -> Path:
    """A folder with an empty parameter file."""
    (tmp_path / "actuator.toml").write_text("")
    return tmp_path


@pytest.mark.parametrize(("model", "electrical", "cases"), [
    ("second-order", False, {"cold", "supply_sag", "opposing_load", "aiding_load"}),
    *slow((DIRECT_DRIVE, True, {"cold"}), ("elastic+heat+homing+faults", True, set()))])
def test_cases_and_figures_that_an_actuator_lacks_are_left_out(
        base: Path, model: str, electrical: bool, cases: set[str]) -> None:
    """The output names the reason, and a changed parameter is drift."""
    printed = record(base, "--model", model)
    recorded = read(base / "baseline", model)
    assert {"cold", "supply_sag", "opposing_load", "aiding_load"} - set(recorded.case) == cases
    assert all(f"left out: case {name}: " in printed for name in cases)
    assert ("peak_current" in recorded.case["step"].figures) is electrical
    assert ("rms_current: this actuator has no motor_current" in printed) is not electrical
    assert f'model = "{get(model).name}"' in (base / "baseline/baseline.toml").read_text()
    assert str(base) not in (base / "baseline/baseline.toml").read_text()
    homed = '"homing.required" = true  # false in cases without the input home'
    assert (homed in (base / "baseline/baseline.toml").read_text()) is ("homing" in model)
    assert "no drift" in check(base, "--model", model, "--report", base / "drift.html")
    name = {"second-order": "second_order.natural_frequency", DIRECT_DRIVE: "controller.kp"}.get(
        model, "controller.position.kp")
    changed = load_parameters(base / "actuator.toml", model=model)
    value, unit = 1.05 * float(changed.values[name]), next(
        e.variable.unit for e in changed.entries if e.variable.name == name)
    (base / "changed.toml").write_text(f'{name} = "{value!r} {unit}"\n')
    assert name in check(base, "--model", model, "-p", base / "changed.toml", code=1)


@pytest.mark.parametrize(("model", "load", "left_out"), [
    ("nonlinear", 100.0, {}), ("servo", 5.0, {"cold": "this actuator has no friction.temperature"}),
    ("second-order", None, {
        "opposing_load": "aero_torque has no effect on this actuator's motion",
        "aiding_load": "aero_torque has no effect on this actuator's motion",
        "cold": "this actuator has no friction.temperature", "supply_sag": "this actuator has no supply_voltage"}),
    ("linear", 100.0, {"supply_sag": "supply_voltage has no effect on this actuator's motion"})])
def test_first_cases_have_the_actuators_rated_load_and_inputs_with_an_effect(
        model: str, load: float | None, left_out: dict[str, str]) -> None:
    """100 N.m would push the servo, which stalls at 15.6 N.m, to its stop."""
    plan, omitted = first(ParameterSubject(load_parameters(model=model)))
    torques = [getattr(case, "torque", 0.0) for case in plan.case.values()]
    assert [torque for torque in torques if torque] == ([-load, load] if load else [])
    assert {f"case {name}: {why}" for name, why in left_out.items()} == {
        each for each in omitted if each.startswith("case ")}


def test_sag_is_a_percentage_of_the_supply_voltage(base: Path) -> None:
    case = read_plan(TEMPLATE).case["supply_sag"]
    small = ParameterSubject(load_parameters().with_values({"drive.supply_voltage": 28.0}))
    lower = case.model_copy(update={"start": {"drive.supply_voltage": 19.5}})
    assert set(case.excitation(base, small).columns["supply_voltage"]) == {28.0, 20.1025641}
    assert set(lower.excitation(base, small).columns["supply_voltage"]) == {19.5, 14.0}


def test_baseline_of_another_actuator_is_refused(base: Path) -> None:
    record(base, "--model", "second-order")
    for printed in (check(base, code=2), record(base, code=2)):
        assert "is of the actuator second-order, not of nonlinear; name the actuator of a parameter file" in printed
    record(base, "--fresh")
    check(base)


def test_error_names_an_output_that_the_actuator_lacks(base: Path) -> None:
    record(base, "--model", "second-order")
    edit(base / "baseline/baseline.toml", 'fin_angle = "0.05 deg"', 'motor_current = "1 A"')
    printed = record(base, "--model", "second-order", code=2)
    assert "limits.trajectories.motor_current = 1 A: there is no such entry" in printed


@pytest.mark.fmu
@pytest.mark.parametrize("model", others_slow(MODELS, lambda model: "+" not in model))
def test_fmu_has_no_drift_from_the_baseline_of_its_parameters(base: Path, model: str) -> None:
    (base / "baseline").mkdir()
    text = SHORT.replace('"0.5 ms"', '"0 ms"').replace('"1 %"', '"0.1 %"').replace('"0.05 deg"', '"0.001 deg"')
    (base / "baseline/baseline.toml").write_text(f'model = "{get(model).name}"\n{text}')
    record(base, "--model", model)
    fmu = lean(load_parameters(base / "actuator.toml", model=model), base / "a.fmu")
    option = ("--model", model) if model == DIRECT_DRIVE else ()
    check(base, *option, article=fmu)
    if option:
        assert "does not contain its model" in check(base, article=fmu, code=2)
