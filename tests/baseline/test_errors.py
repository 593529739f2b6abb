"""Errors of baselines and options name file, entry and remedy, with exit code 2."""

from __future__ import annotations

from pathlib import Path

import pytest

from emcas_fmu.parameters import load_parameters

from ..fmu.built import lean
from .conftest import check, edit, emcas, record


@pytest.mark.parametrize(("old", "new", "message"), [
    ('schema = "emcas-baseline/1"', 'schema = "emcas-baseline/0"', "schema: is 'emcas-baseline/0'"),
    ('kind = "step"', 'kind = "stop"', "case.only.kind = stop: did you mean step?"),
    ('amplitude = "5 deg"', 'amplitude = "5 V"', "case.only.amplitude = 5 V: the unit V does not measure this"),
    ('amplitude = "5 deg"', 'command = "5 V"', "case.only.command = 5 V: the unit V does not measure this"),
    ('amplitude = "5 deg"', 'amplitude = "0 deg"',
     "case.only.amplitude = 0 deg: must not be 0; give another amplitude of the command"),
    ('amplitude = "5 deg"', 'amplitude = "200 deg"', "case.only.amplitude = 200 deg: must be within -3.14159 .."),
    ('kind = "step"', 'kind = "slew"\nsettle = "61 s"', "case.only.settle = 61 s: must be within 0.001 .. 60 s"),
    ('kind = "step"', 'kind = "step"\ntorque = "2e6 N.m"', "torque = 2e6 N.m: must be within -1e+06 .. 1e+06 N.m"),
    ('amplitude = "5 deg"', 'amplitud = "5 deg"', "did you mean amplitude?"),
    ('duration = "0.3 s"', 'duration = "2 h"', "case.only.duration = 2 h: must be within 0.01 .. 60 s"),
    ('duration = "0.3 s"', 'duration = "0.3005 s"', "case.only.duration = 0.3005 s: must be a whole number"),
    ('fin_angle = "0.05 deg"', 'fin_angel = "0.05 deg"', "did you mean fin_angle?"),
    ('fin_angle = "0.05 deg"', 'fin_angle = "-1 deg"', "limits.trajectories.fin_angle = -1 deg: must be within 0"),
    ('sample_time = "10 ms"', 'sample_time = "1.5 ms"', "sample_time = 1.5 ms: must be a whole number of milliseconds"),
    ('absolute = "0.5 ms"', 'absolute = 0.5', "limits.figures.rise_time.absolute = 0.5: has no unit"),
    ('relative = "1 %"', 'relative = "1 deg"', "limits.figures.rise_time.relative"),
    ("[case.only.figures]", "[case.only.figure]", "case.only: unknown key 'figure'; did you mean figures?"),
    ("\nrise_time = \"", "\nrise_tine = \"", "case.only.figures.rise_tine"),
    ("\novershoot =", '\npeak_gain = "1 dB"\novershoot =', "figures.peak_gain: a step has no such figure; remove"),
    ('"motor.resistance" =', '"motor.resistence" =', "did you mean motor.resistance?"),
    ('duration = "0.3 s"', 'duration = "0.3 s"\nstart = { "friction.temperature" = "-500 degC" }',
     "case.only.start.friction.temperature = -500 degC: must be within -100 .. 200 degC"),
    ("[recorded]", "[recorded", "is not valid TOML: Expected"),
    ("[recorded]", '[case."Größe"]\nkind = "step"\n[recorded]', "the name of a case has letters a to z"),
    ("[recorded]", "[remembered]", "unknown key 'remembered'"),
])
def test_error_names_the_entry_of_a_damaged_baseline(short: Path, old: str, new: str, message: str) -> None:
    edit(short / "baseline/baseline.toml", old, new)
    printed = check(short, code=2)
    assert message in printed
    assert str(short / "baseline") in printed


@pytest.mark.parametrize(("old", "new", "message"), [
    ("time [s],fin_angle [deg]", "time [s],fin_angle [rad]", "its columns are"),
    ("\n0.02,", "\n0.03,", "its times must begin at 0 and be 0.01 s apart"),
    ("\n0.02,0\n", "\n0.02,nan\n", "line 4 contains nan"), ("\n0.02,0\n", "\n0.02,zero\n", "line 4: 'zero' is not a"),
    ("\n0.02,", "\n0.02,,", "line 4 has 3 values"),
    ("\n0.02,0\n", "\n", "its times must begin at 0"),
])
def test_error_names_the_line_of_a_damaged_trajectory(short: Path, old: str, new: str, message: str) -> None:
    edit(short / "baseline/only.csv", old, new)
    printed = check(short, code=2)
    assert message in printed
    assert "only.csv" in printed


def test_edited_case_must_be_recorded_again(short: Path) -> None:
    edit(short / "baseline/baseline.toml", '"0.3 s"', '"0.4 s"')
    assert "was the case edited?" in check(short, code=2)
    record(short)
    check(short)


def test_older_file_calls_the_amplitude_command(short: Path) -> None:
    edit(short / "baseline/baseline.toml", "amplitude =", "command =")
    check(short)


def test_error_names_missing_files(short: Path) -> None:
    (short / "baseline/only.csv").unlink()
    assert "only.csv: cannot be read: there is no such file" in check(short, code=2)
    printed = emcas("check", short / "actuator.toml", "-b", short / "nowhere", code=2)
    assert "emcas baseline record" in printed
    assert "is a folder" in check(short, "--junit", short, code=2)
    assert "baseline.toml/baseline.toml: cannot be read" in emcas(
        "check", short / "actuator.toml", "-b", short / "baseline/baseline.toml", code=2)


def test_input_file_is_not_overwritten(short: Path) -> None:
    file = short / "baseline/baseline.toml"
    file.write_text(file.read_text() + '\n[case.flight]\nkind = "file"\nfile = "flight.csv"\n')
    assert "rename the case" in record(short, code=2)


@pytest.mark.parametrize(("model", "options", "message"), [
    ("actuator.toml", ("--fin", "2"), "leave --fin out"), ("actuator.csv", (), "neither an FMU nor a parameter file"),
    ("absent.fmu", (), "there is no such file"), ("absent.toml", (), "absent.toml"),
])
def test_error_names_an_unusable_article(short: Path, model: str, options: tuple[str, ...], message: str) -> None:
    assert message in check(short, *options, article=model, code=2)


@pytest.mark.fmu
def test_baseline_of_one_fin_of_several(short: Path) -> None:
    """Fin 2 has another motor; fin 1 is that of the baseline."""
    (short / "weaker.toml").write_text('[motor]\ntorque_constant = "0.1 N*m/A"\n')
    fmu = lean(load_parameters(), short / "EMCAS2.fmu", fins=2, files={2: short / "weaker.toml"})
    check(short, article=fmu)
    printed = check(short, "--fin", "2", article=fmu, code=1)
    assert "motor.torque_constant" in printed
    assert "--fin 2" in printed
    record(short, "--fin", "2", article=fmu)
    check(short, "--fin", "2", article=fmu)
    assert "was recorded with fin 2, but fin 1 was compared" in check(short, article=fmu, code=1)
    assert "there is no fin 3" in check(short, "--fin", "3", article=fmu, code=2)


@pytest.mark.fmu
def test_run_that_ends_early_fails(short: Path, fmu: Path) -> None:
    """The FMU stops when a load of 1e300 N.m begins."""
    (short / "baseline/flight.csv").write_text("time,aero_torque\n0,0\n0.05,0\n0.07,1e300\n0.35,1e300\n")
    file = short / "baseline/baseline.toml"
    file.write_text(file.read_text().partition('kind = "step"')[0] + 'kind = "file"\nfile = "flight.csv"\n'
                    '[case.only.figures]\npeak_angle = "5 deg"\n')
    printed = check(short, "--junit", short / "drift.xml", article=fmu, code=1)
    assert "1 of 1 cases did not run to the end" in printed
    assert "more than 500 events" in " ".join(printed.split())
    assert "went no further than 0.051 s" in (short / "drift.xml").read_text()
    assert "a baseline needs every case to run to its end" in record(short, article=fmu, code=2)
