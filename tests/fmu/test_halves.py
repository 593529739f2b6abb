"""FMUs of the controllers alone and of the plant alone; coupled, they give the trajectory of the whole actuator."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import product
from pathlib import Path

import fmpy
import numpy as np
import pytest
from fmpy.validation import validate_fmu
from typer.testing import CliRunner

from emcas_fmu.actuators import HALVES, NONLINEAR
from emcas_fmu.cli import app
from emcas_fmu.errors import EmcasError
from emcas_fmu.fmi.package import BACKENDS, build
from emcas_fmu.parameters import ParameterSet, load_parameters
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
    """Files by half and back end, "3" for the native one in FMI 3.0."""
    folder, parameters = tmp_path_factory.mktemp("halves"), _parameters(model)
    return {(part, name): lean(parameters, folder / f"{part}_{name}.fmu", backend, references=True, part=part, fmi=fmi)
            for part, (name, backend, fmi) in product(HALVES, (
                ("python", "python", "2"), ("native", "native", "2"), ("3", "native", "3")))}


def _parameters(model: str) -> ParameterSet:
    """Return the shipped parameters without homing."""
    parameters = load_parameters(model=model)
    return parameters.with_values({"homing.required": False} if "homing.required" in parameters.values else {})


def test_halves_are_valid_fmus_with_their_inputs(halves: Mapping[tuple[str, str], Path], model: str) -> None:
    for (part, name), path in halves.items():
        assert validate_fmu(str(path)) == []
        described = fmpy.read_model_description(str(path))
        assert described.modelName == f"EMCAS_{part}" if model == NONLINEAR else described.modelName.endswith(part)
        names = {v.name for v in described.modelVariables}
        assert ("fin_command" in names, "aero_torque" in names) == (part == "controller", part == "plant"), name


def test_coupled_halves_give_the_bits_of_the_whole(halves: Mapping[tuple[str, str], Path], model: str) -> None:
    """For every combination of back ends."""
    whole = simulate(_parameters(model).values, STOP, model=model, **INPUTS)["fin_angle"]
    assert np.degrees(np.abs(whole).max()) > 5.0
    for backends in product(BACKENDS, repeat=2):
        with Half(halves["controller", backends[0]]) as controllers, Half(halves["plant", backends[1]]) as plant:
            angle = coupled(controllers, plant, STOP, inputs=INPUTS)["fin_angle"]
        assert np.array_equal(angle, whole), backends


def test_halves_in_fmi_3_have_the_bits_of_fmi_2(halves: Mapping[tuple[str, str], Path], model: str) -> None:
    signals = np.array([(0.0, 0.05, 1.0), (0.1, 0.2, -3.0)], dtype=[("time", float), ("fin_command", float),
                                                                    ("aero_torque", float)])
    for part, output in (("controller", "measured_fin_angle"), ("plant", "fin_angle")):
        inputs = signals[["time", "fin_command" if part == "controller" else "aero_torque"]]
        runs = [fmpy.simulate_fmu(str(halves[part, name]), stop_time=STOP, output_interval=1e-3, input=inputs)
                for name in ("native", "3")]
        for name in set(runs[0].dtype.names) - {"time"}:
            assert np.array_equal(runs[0][name], runs[1][name]), name
        assert output in runs[0].dtype.names
        assert any(np.ptp(runs[0][name].astype(float)) > 0.0 for name in runs[0].dtype.names if name != "time")


def test_users_controller_moves_the_plant_to_its_command(tmp_path: Path) -> None:
    """The example's controller in plain Python has a static error under the load."""
    parameters = load_parameters()
    with Half(lean(parameters, tmp_path / "plant.fmu", part="plant")) as plant:
        angle = coupled(OwnController(parameters.nested()), plant, 0.3, inputs=INPUTS)["fin_angle"]
    assert abs(np.degrees(angle[-1] - 0.2)) < 0.5


@pytest.mark.parametrize(("arguments", "message"), [
    (["--part", "plnt"], "part plnt: there is controller and plant; did you mean plant?"),
    (["--part", "plant", "--fins", "2"], "part plant is for a single fin"),
    (["--part", "controller", "--model", "second-order"], "controller needs a sampled position loop"),
])
def test_part_that_cannot_be_built_is_refused(arguments: list[str], message: str, tmp_path: Path) -> None:
    done = CliRunner().invoke(app, ["build", *arguments, "-o", str(tmp_path / "x.fmu")])
    assert done.exit_code == 2
    assert message in " ".join(done.output.split())
    assert not list(tmp_path.iterdir())


def test_simulate_refuses_a_half() -> None:
    done = CliRunner().invoke(app, ["simulate", "--model", f"{NONLINEAR}+plant", "--step", "10"])
    assert done.exit_code == 2
    assert "leave +plant out" in " ".join(done.output.split())


def test_half_of_a_half_is_refused(tmp_path: Path) -> None:
    with pytest.raises(EmcasError, match="which controller replaces"):
        build(load_parameters(model=f"{NONLINEAR}+controller"), tmp_path / "x.fmu", part="plant")
