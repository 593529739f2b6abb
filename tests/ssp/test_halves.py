"""An archive of controllers and plants: in hosts that pass signals on between steps, the whole's trajectory."""

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
LOOPED = [name for name in NAMES if capabilities.POSITION_LOOP in get(name).provides]
STEP = 1e-3
WITHIN = 1e-6  # deg; on one machine the difference is 0


@pytest.fixture
def written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    """Write an archive of one fin of a model, built for this platform: written(model)."""
    def build(parameters: ParameterSet, path: Path, backend: str, **options: Any) -> Any:
        lean(parameters, path, part=options["part"])
        return type("Built", (), {"path": path})

    monkeypatch.setattr(write, "build", build)
    return lambda model: write_ssp(tmp_path / "halves.ssp", model=model, fins=1, halves=True)


def excited(time: float) -> tuple[float, float]:
    """The command [rad] and the aerodynamic torque [N.m]."""
    return 0.15 * (time > 0.0205), -5.0 * (time > 0.1005)


def response(archive: Path, host: str, count: int) -> list[float]:
    angles = []
    with hosts.open(archive, host, step=STEP) as system:
        for k in range(count):
            command, torque = excited(k * STEP)
            system.set("fin1_controller.fin_command", command)
            system.set("fin1_plant.aero_torque", torque)
            system.step()
            angles.append(float(system.get("fin1_plant.fin_angle")))
    return angles


@pytest.mark.parametrize(("model", "host"), others_slow(
    [(model, "fmpy") for model in LOOPED] + [(NONLINEAR, host) for host in hosts.HOSTS if host != "fmpy"],
    lambda case: case == (NONLINEAR, "fmpy")))
def test_the_trajectory_is_that_of_the_whole(written: Any, model: str, host: str) -> None:
    """If the drive's delay covers the step between components; otherwise a warning says that it does not."""
    if find_spec(host) is None:
        pytest.skip(f"{host} is not installed")
    archive: Written = written(model)
    angles = response(archive.path, host, 200)
    parameters = load_parameters(model=model)
    times = np.arange(201) * STEP
    command, torque = np.array([excited(time) for time in times]).T
    whole = simulate(parameters.values, 0.2, STEP, model=model, fin_command=command, aero_torque=torque)["fin_angle"]
    apart = np.degrees(np.abs(np.array(angles) - whole[1:]).max())
    assert np.degrees(np.abs(whole).max()) > 5.0
    late = [warning for warning in archive.warnings if "is below the step of 0.001 s" in warning]
    assert len(late) == (model == "ristanovic")
    assert apart < WITHIN if not late else 0.1 < apart < 5.0


def test_its_documents(written: Any, tmp_path: Path) -> None:
    archive = written(NONLINEAR)
    assert valid_documents(archive.path) == 1 + 3  # the structure; sets of two components and the system
    (finding,) = check(archive.path).findings
    assert "has connections of the system's own connectors" in finding.message
    assert "halves are built" in emcas("--halves", "--fmu", tmp_path / "one.fmu", "-o", tmp_path / "x.ssp", code=2)
