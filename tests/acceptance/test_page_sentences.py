"""Sentences of pages and terminal hold for every actuator, parameter set and file of the user."""

from __future__ import annotations

from html import unescape
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from emcas_fmu.bench.subject import ParameterSubject
from emcas_fmu.cli import app
from emcas_fmu.parameters import load_parameters
from emcas_fmu.studies.analysis.analyse import _left_out
from emcas_fmu.studies.analysis.envelope import envelope
from emcas_fmu.studies.analysis.pictures import neglected
from emcas_fmu.studies.validate.validation import validate
from emcas_fmu.studies.validate.validation_output import write_report


@pytest.mark.parametrize(("model", "need"), [
    ("nonlinear+stribeck", "friction.coulomb at the motor, which the extension stribeck replaces"),
    ("nonlinear+lugre", "a screw without losses, which the extension lugre replaces"),
    ("clutch", "a current loop, which clutch does not have")])
def test_the_reason_is_the_extension_that_replaces_a_capability(model: str, need: str) -> None:
    reasons = _left_out(model, load_parameters(model=model).values)
    assert reasons["capability"] == f"torque-speed capability left out: needs {need}"


@pytest.mark.parametrize(("model", "changes", "effects"), [
    ("nonlinear", {}, "friction, compensation, counts"),
    ("worm-gear", {"worm.friction": 0.0, "friction.fin_coulomb": 0.0, "friction.coulomb.positive[0]": 0.0,
                   "friction.coulomb.negative[0]": 0.0, "encoder.enabled": False}, ""),
    ("servo", {}, "friction, resolution, backlash"), ("servo", {"encoder.enabled": False}, "friction, backlash"),
    ("electrohydraulic", {}, "friction, resolution"), ("linear", {}, "")])
def test_effects_that_linear_models_leave_out_are_those_of_the_parameters(
        model: str, changes: dict[str, float], effects: str) -> None:
    parameters = load_parameters(model=model).with_values(changes)
    assert ", ".join(neglected(parameters.actuator, parameters.values)) == effects


def test_numbers_of_the_thesis_do_not_depend_on_a_users_rod(tmp_path: Path) -> None:
    rod, limit, page = tmp_path / "rod.toml", tmp_path / "limit.toml", tmp_path / "page.html"
    rod.write_text('[rod]\ndiameter = "20 mm"\n[thesis]\nbandwidth = "15 Hz"\n', encoding="utf-8")
    limit.write_text('[command]\nlimit = "1 deg"\n', encoding="utf-8")  # for fewer sines
    done = CliRunner().invoke(app, ["analyse", "--rod", str(rod), "-p", str(limit), "-p", "drive-pi", "--report",
                                    str(page)])
    assert done.exit_code == 0, done.output
    assert "42 to 139 times the bandwidth, but divides rad/s by Hz; the correct factors are 6.7 and 22.2." in " ".join(
        done.output.split())
    text = " ".join(unescape(page.read_text(encoding="utf-8")).split())
    assert "6.737 and 22.22 × 10 Hz" in text
    # A weak drive limits even small steps.
    assert "Small steps differ because of friction, its compensation and the encoder's counts, any step if a" in text
    assert "Small amplitudes lose bandwidth to friction and counts, any amplitude if a limit acts." in text
    assert "× 15 Hz" in text
    # (R + kp)/ki of the set: 5.25 V/A over 2083 V/(A.s).
    assert "the drive's integral adds the rest within some 2.5 ms." in text


def test_no_load_speed_is_where_the_torque_of_an_envelope_ends() -> None:
    found = envelope(load_parameters(model="nonlinear+heat"), 1.0, 0.8)
    step = found.speed[1]
    for curve in (found.continuous, found.short_term):
        last = found.speed[np.flatnonzero(curve.torque > 0.0)[-1]]
        assert last <= curve.no_load_speed <= last + step * (1.0 + 1e-9)
    assert found.continuous.no_load_speed < found.short_term.no_load_speed - step


def test_friction_in_the_cold_is_not_claimed_to_be_higher(tmp_path: Path) -> None:
    same = {f"friction.table.{name}[{k}]": 1.0 for name in ("viscous", "coulomb") for k in range(5)}
    write_report(validate(ParameterSubject(load_parameters().with_values(same)), ["cold"]), tmp_path / "page.html")
    assert "Steps at -6 degC." in (tmp_path / "page.html").read_text(encoding="utf-8")


@pytest.mark.parametrize("clipped", [False, True])
def test_pages_of_changed_parameters_claim_nothing_of_the_shipped_ones(clipped: bool, tmp_path: Path) -> None:
    chosen = load_parameters().with_values({"command.limit": np.radians(10.0)} if clipped else {})
    write_report(validate(ParameterSubject(chosen), ["step_plus20"]), tmp_path / "page.html")
    text = " ".join((tmp_path / "page.html").read_text(encoding="utf-8").split())
    assert ("Commands are clipped to 10 deg." in text) is clipped
    assert ("chosen so that the model meets Table 2" in text) is not clipped
