"""Archives of controllers and plants: hosts that pass signals between steps give the whole actuator's trajectory."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from emcas_fmu.actuators import NAMES, NONLINEAR, capabilities, get
from emcas_fmu.parameters import ParameterSet, load_parameters
from emcas_fmu.simulation import simulate
from emcas_fmu.ssp import write
from emcas_fmu.ssp.check import check
from emcas_fmu.ssp.write import Written, write_ssp
from examples.ssp_hosts import hosts
from tests.fmu.built import lean
from tests.marks import others_slow

from .conftest import emcas, valid_documents

pytestmark = pytest.mark.fmu
WITH_POSITION_LOOP = [name for name in NAMES if capabilities.POSITION_LOOP in get(name).provides]
STEP = 1e-3
SAME = 1e-6  # deg; on one machine the difference is 0


@pytest.fixture
def write_halves(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    """Function that writes an archive of a model with one fin, with FMUs for this platform."""
    def build(parameters: ParameterSet, path: Path, backend: str, **options: Any) -> Any:
        lean(parameters, path, part=options["part"])
        return type("Built", (), {"path": path})

    monkeypatch.setattr(write, "build", build)
    return lambda model: write_ssp(tmp_path / "halves.ssp", model=model, fins=1, halves=True)


def excitation(time: float) -> tuple[float, float]:
    """Return the command [rad] and the aerodynamic torque [N.m]."""
    return 0.15 * (time > 0.0205), -5.0 * (time > 0.1005)


def response(archive: Path, host: str, steps: int) -> list[float]:
    """Return the fin angle [rad] after each step."""
    angles = []
    with hosts.open(archive, host, step=STEP) as system:
        for k in range(steps):
            command, torque = excitation(k * STEP)
            system.set("fin1_controller.fin_command", command)
            system.set("fin1_plant.aero_torque", torque)
            system.step()
            angles.append(float(system.get("fin1_plant.fin_angle")))
    return angles


@pytest.mark.parametrize(("model", "host"), others_slow(
    [(model, "fmpy") for model in WITH_POSITION_LOOP] + [(NONLINEAR, host) for host in hosts.HOSTS if host != "fmpy"],
    lambda case: case == (NONLINEAR, "fmpy")))
def test_halves_in_a_host_move_as_the_whole(write_halves: Any, model: str, host: str) -> None:
    """This requires a drive delay of at least the host's step; a warning says that `ristanovic` has a shorter one."""
    if find_spec(host) is None:
        pytest.skip(f"{host} is not installed")
    archive: Written = write_halves(model)
    angles = response(archive.path, host, 200)
    parameters = load_parameters(model=model)
    times = np.arange(201) * STEP
    command, torque = np.array([excitation(time) for time in times]).T
    whole = simulate(parameters.values, 0.2, STEP, model=model, fin_command=command, aero_torque=torque)["fin_angle"]
    difference = np.degrees(np.abs(np.array(angles) - whole[1:]).max())
    assert np.degrees(np.abs(whole).max()) > 5.0
    warnings = [warning for warning in archive.warnings if "is below the step of 0.001 s" in warning]
    assert len(warnings) == (model == "ristanovic")
    assert difference < SAME if not warnings else 0.1 < difference < 5.0


def test_archive_of_halves_is_valid(write_halves: Any, tmp_path: Path) -> None:
    archive = write_halves(NONLINEAR)
    assert valid_documents(archive.path) == 1 + 3  # the structure; parameters of two components and the system
    (finding,) = check(archive.path).findings
    assert "has connections of the system's own connectors" in finding.message
    assert "halves are built" in emcas("--halves", "--fmu", tmp_path / "one.fmu", "-o", tmp_path / "x.ssp", code=2)
