"""Errors of FMUs and steps in the flight, and the program fly.py."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from emcas_fmu.errors import EmcasError
from examples.jsbsim.actuators import Ideal
from examples.jsbsim.flight import GENTLE, fly
from examples.jsbsim.fmu import Fmu

from .conftest import Doctor

ROOT = Path(__file__).resolve().parents[2]


def test_fmu_without_a_variable_is_refused(native: Path, doctored: Doctor) -> None:
    path = doctored(native, "modelDescription.xml", 'name="aero_torque"', 'name="aero_load"')
    with pytest.raises(EmcasError, match="connection rocket -> aero_torque: has no variable aero_torque; an FMU of"):
        Fmu(path)


def test_fmu_with_another_unit_is_refused(native: Path, doctored: Doctor) -> None:
    path = doctored(native, "modelDescription.xml", 'unit="W"', 'unit="V"')
    with pytest.raises(EmcasError, match="supply_power -> rocket: supply_power is Real in V, not Real in W"):
        Fmu(path)


def test_unknown_parameter_is_refused(native: Path) -> None:
    with pytest.raises(EmcasError, match=r"setting -> encoder\.enabld: has no variable"):
        Fmu(native, parameters={"encoder.enabld": False})


@pytest.mark.parametrize("step", [3e-3, 5e-3, 0.0, -1e-3])
def test_step_must_divide_the_autopilots_sample_time(step: float) -> None:
    with pytest.raises(EmcasError, match="does not divide the autopilot's 4 ms"):
        fly(Ideal(), GENTLE, step)


def program(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    """Run fly.py in a separate process."""
    return subprocess.run([sys.executable, ROOT / "examples/jsbsim/fly.py", *arguments], capture_output=True, text=True,
                          timeout=120, env={**os.environ, "TERMINAL_WIDTH": "200"})


@pytest.mark.slow
def test_program_needs_no_fmu(tmp_path: Path) -> None:
    """It builds the FMU, and an SSP for another master, and writes page, figures and trajectories."""
    folder = tmp_path / "new" / "out"
    result = program("--manoeuvre", "gentle", "--no-convergence", "--step", "4", "--host", "fmpy", "-o", folder)
    assert result.returncode == 0, result.stderr
    page = (folder / "report.html").read_text(encoding="utf-8")
    assert page.count("<svg") == 4
    assert "http" not in page.replace("http://www.w3.org", "")
    figures = json.loads((folder / "figures.json").read_text(encoding="utf-8"))
    assert set(figures["flights"]["gentle"]) == {"ideal", "second-order-undelayed", "second-order",
                                                 "nonlinear", "stiff"}
    assert figures["fmus"]["nonlinear"]["bus_resistance_ohm"] == 0.02
    assert figures["masters"]["gentle"]["without SSP"]["fin_difference_rad"] < 1e-12  # the documented accuracy
    table = np.genfromtxt(folder / "gentle_nonlinear.csv", delimiter=",", names=True)
    assert len(table) == 1500
    largest = np.degrees(max(np.abs(table[f"fin{k}_rad"]).max() for k in range(1, 5)))
    assert largest == pytest.approx(figures["flights"]["gentle"]["nonlinear"]["fin_angle_largest_deg"], rel=1e-6)
    assert table["bus_voltage_v"].min() < 39.0
    # Without a bus there is no column of it.
    assert "bus" not in (folder / "gentle_ideal.csv").read_text(encoding="utf-8").splitlines()[0]
    assert (folder / "gentle_ssp-fmpy.csv").is_file()


@pytest.mark.slow
def test_program_flies_an_fmu_of_one_fin(native: Path, tmp_path: Path) -> None:
    result = program("--fmu", native, "--manoeuvre", "gentle", "--no-convergence", "--step", "4", "-o", tmp_path,
                     "--format", "npz", "--bus-voltage", "36")
    assert result.returncode == 0, result.stderr
    # Single actuators are on a stiff bus: there is no second flight for it.
    assert sorted(p.name for p in tmp_path.glob("*.npz")) == [
        "gentle_ideal.npz", "gentle_nonlinear.npz", "gentle_second-order-undelayed.npz", "gentle_second-order.npz"]
    assert np.all(np.load(tmp_path / "gentle_nonlinear.npz")["bus_voltage_v"] == 36.0)
    fmus = json.loads((tmp_path / "figures.json").read_text(encoding="utf-8"))["fmus"]
    assert fmus["nonlinear"]["supply_start"] == 36.0


@pytest.mark.slow
@pytest.mark.parametrize(("arguments", "message"), [
    (["--fmu", "no-such.fmu"], "no-such.fmu: there is no such file; build one"),
    (["--model", "worm-gaer"], "model worm-gaer: there is no actuator 'worm-gaer'"),
    (["--host", "omsimulator"], "'omsimulator' is not one of 'fmpy', 'libcosim', 'ecos', 'all'"),
    (["--hinge", "60"], "Invalid value for '--hinge'"),
    (["--bus-voltage", "0"], "a bus voltage of 0 V: must be above 0"),
    (["--actuator", "ideal", "--step", "3", "--no-convergence"], "does not divide"),
    (["--actuator", "ideal", "-o", str(Path(__file__))], "is a file; --output names a folder"),
])
def test_error_names_the_option_and_the_remedy(arguments: list[str], message: str, tmp_path: Path) -> None:
    result = program("-o", tmp_path / "out", *arguments)
    assert result.returncode == 2
    assert message in result.stderr
    assert "Traceback" not in result.stderr


def test_missing_jsbsim_is_reported_before_the_build(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "jsbsim.py").write_text("raise ModuleNotFoundError\n")
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join((str(tmp_path), *sys.path)))
    result = program("-o", tmp_path / "out")
    assert result.returncode == 2
    assert result.stderr == ("error: the flight needs the Python package jsbsim, which is not installed: "
                             "pip install 'emcas-fmu[jsbsim]'\n")
