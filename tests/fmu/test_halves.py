"""Controllers and plant as FMUs: valid, the same from both back ends and in FMI 3.0, coupled the whole's trajectory."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import product
from pathlib import Path
from typing import Any

import fmpy
import numpy as np
import pytest
from fmpy.validation import validate_fmu
from typer.testing import CliRunner

from emcas_fmu.actuators import HALVES, NONLINEAR
from emcas_fmu.cli import app
from emcas_fmu.errors import EmcasError
from emcas_fmu.fmi import figures
from emcas_fmu.fmi.package import BACKENDS, build
from emcas_fmu.parameters import load_parameters
from emcas_fmu.simulation import simulate
from examples.hardware_in_the_loop.coupling import Half, coupled
from examples.hardware_in_the_loop.run import INPUTS, OwnController
from tests.marks import slow

from .built import lean

pytestmark = pytest.mark.fmu
STOP = 0.2


@pytest.fixture(scope="module", params=[NONLINEAR, *slow("elastic+heat+homing+faults", "servo")])
def model(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture(scope="module")
def halves(model: str, tmp_path_factory: pytest.TempPathFactory) -> Mapping[tuple[str, str], Path]:
    """Files by half and back end, or "3" for FMI 3.0."""
    folder, parameters = tmp_path_factory.mktemp("halves"), _parameters(model)
    files = {}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(figures, "response_pictures", lambda _: ())
        for part in HALVES:
            files[part, "python"] = build(parameters, folder / f"{part}_python.fmu", part=part).path
    for part, (name, fmi) in product(HALVES, (("native", "2"), ("3", "3"))):
        files[part, name] = lean(parameters, folder / f"{part}_{name}.fmu", part=part, fmi=fmi)
    return files


def _parameters(model: str) -> Any:
    parameters = load_parameters(model=model)
    return parameters.with_values({"homing.required": False} if "homing.required" in parameters.values else {})


def test_valid(halves: Mapping[tuple[str, str], Path], model: str) -> None:
    for (part, name), path in halves.items():
        assert validate_fmu(str(path)) == []
        described = fmpy.read_model_description(str(path))
        assert described.modelName == f"EMCAS_{part}" if model == NONLINEAR else described.modelName.endswith(part)
        names = {v.name for v in described.modelVariables}
        assert ("fin_command" in names, "aero_torque" in names) == (part == "controller", part == "plant"), name


def test_coupled_they_are_the_whole(halves: Mapping[tuple[str, str], Path], model: str) -> None:
    """To the bit, whichever back end computes which half."""
    whole = simulate(_parameters(model).values, STOP, model=model, **INPUTS)["fin_angle"]
    assert np.degrees(np.abs(whole).max()) > 5.0
    for backends in product(BACKENDS, repeat=2):
        with Half(halves["controller", backends[0]]) as controllers, Half(halves["plant", backends[1]]) as plant:
            angle = coupled(controllers, plant, STOP, inputs=INPUTS)["fin_angle"]
        assert np.array_equal(angle, whole), backends


def test_of_fmi_3(halves: Mapping[tuple[str, str], Path], model: str) -> None:
    """The same bits as of FMI 2.0: value references of both lead to the same variables."""
    signals = np.array([(0.0, 0.05, 1.0), (0.1, 0.2, -3.0)], dtype=[("time", float), ("fin_command", float),
                                                                    ("aero_torque", float)])
    for part, output in (("controller", "measured_fin_angle"), ("plant", "fin_angle")):
        given = signals[["time", "fin_command" if part == "controller" else "aero_torque"]]
        runs = [fmpy.simulate_fmu(str(halves[part, name]), stop_time=STOP, output_interval=1e-3, input=given)
                for name in ("native", "3")]
        for name in set(runs[0].dtype.names) - {"time"}:
            assert np.array_equal(runs[0][name], runs[1][name]), name
        assert output in runs[0].dtype.names
        assert any(np.ptp(runs[0][name].astype(float)) > 0.0 for name in runs[0].dtype.names if name != "time")


def test_own_controller(tmp_path: Path) -> None:
    """One in plain Python moves the plant to its command within its droop under the load."""
    parameters = load_parameters()
    with Half(lean(parameters, tmp_path / "plant.fmu", part="plant")) as plant:
        angle = coupled(OwnController(parameters.nested()), plant, 0.3, inputs=INPUTS)["fin_angle"]
    assert abs(np.degrees(angle[-1] - 0.2)) < 0.5


@pytest.mark.parametrize(("arguments", "message"), [
    (["--part", "plnt"], "part plnt: there is controller and plant; did you mean plant?"),
    (["--part", "plant", "--fins", "2"], "part plant is for a single fin"),
    (["--part", "controller", "--model", "second-order"], "controller needs a sampled position loop"),
])
def test_refusals(arguments: list[str], message: str, tmp_path: Path) -> None:
    done = CliRunner().invoke(app, ["build", *arguments, "-o", str(tmp_path / "x.fmu")])
    assert done.exit_code == 2
    assert message in " ".join(done.output.split())
    assert not list(tmp_path.iterdir())


def test_other_commands_are_for_the_whole() -> None:
    done = CliRunner().invoke(app, ["simulate", "--model", f"{NONLINEAR}+plant", "--step", "10"])
    assert done.exit_code == 2
    assert "leave +plant out" in " ".join(done.output.split())


def test_parts_have_no_parts(tmp_path: Path) -> None:
    with pytest.raises(EmcasError, match="which controller replaces"):
        build(load_parameters(model=f"{NONLINEAR}+controller"), tmp_path / "x.fmu", part="plant")
