"""FMUs with `--interface torque`: the host moves the fin, the FMU returns the actuator's torque."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any
from xml.etree import ElementTree
from zipfile import ZipFile

import fmpy
import numpy as np
import pytest
from fmpy.fmi2 import FMU2Slave
from fmpy.fmi3 import FMU3Slave
from fmpy.validation import validate_fmu
from numpy.typing import NDArray
from typer.testing import CliRunner

from emcas_fmu.actuators import NONLINEAR
from emcas_fmu.cli import app
from emcas_fmu.parameters import load_parameters
from emcas_fmu.rules import NO_VARIABLE
from tests.extensions.test_torque import PARTS, coupled, restoring, steps

from .built import lean, unpacked
from .host import ERROR, OK, Instance

pytestmark = pytest.mark.fmu
STEP, STOP = 7e-4, 0.21  # s; the step does not divide the sample time
INERTIA = sum(load_parameters().values[name] for name in PARTS)


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Mapping[str, Path]:
    """Files by back end, "3" for the native one in FMI 3.0."""
    folder = tmp_path_factory.mktemp("torque")
    return {name: lean(load_parameters(), folder / f"{name}.fmu", backend, references=True, interface="torque", fmi=fmi)
            for name, backend, fmi in (("python", "python", "2"), ("native", "native", "2"), ("3", "native", "3"))}


class Host:
    """A host that moves the fin by semi-implicit Euler with the torque of an FMU."""

    def __init__(self, path: Path) -> None:
        described = fmpy.read_model_description(str(path))
        self.fmu: Any = fmpy.instantiate_fmu(fmpy.extract(str(path)), described, "CoSimulation")
        self.is_3 = isinstance(self.fmu, FMU3Slave)
        assert self.is_3 or isinstance(self.fmu, FMU2Slave)
        self.references = {v.name: v.valueReference for v in described.modelVariables}
        self.get, self.set = ((self.fmu.getFloat64, self.fmu.setFloat64) if self.is_3
                              else (self.fmu.getReal, self.fmu.setReal))
        self.begin()

    def begin(self) -> None:
        if not self.is_3:
            self.fmu.setupExperiment()
        self.fmu.enterInitializationMode()
        self.fmu.exitInitializationMode()
        self.angle = self.rate = 0.0
        self.inertia = INERTIA + self.get([self.references["armature"]])[0]

    def step(self, k: int) -> float:
        inputs = {"fin_command": steps(k * STEP), "hinge_angle": self.angle, "hinge_rate": self.rate}
        self.set([self.references[name] for name in inputs], list(inputs.values()))
        self.fmu.doStep(currentCommunicationPoint=k * STEP, communicationStepSize=STEP)
        torque: float = self.get([self.references["actuator_torque"]])[0]
        self.rate += STEP * ((torque + restoring(0.0, self.angle, self.rate)) / self.inertia)
        self.angle += STEP * self.rate
        return torque

    def run(self) -> NDArray[np.float64]:
        return np.array([(self.step(k), self.angle) for k in range(round(STOP / STEP))])

    def end(self) -> None:
        self.fmu.terminate()
        self.fmu.freeInstance()


@pytest.fixture(scope="module")
def expected() -> NDArray[np.float64]:
    """Torque and angle with the core in this process."""
    return np.array([(out["actuator_torque"], host.angle) for _, host, out in coupled(
        NONLINEAR, STOP, restoring, h=STEP, fin_command=steps)])


@pytest.mark.parametrize("name", ["python", "native"])
def test_references_without_a_variable_are_refused(name: str, files: Mapping[str, Path], tmp_path: Path) -> None:
    """The core's inputs that the host does not see keep their references, but are no variables of the FMU."""
    fmu = unpacked(files[name], tmp_path)
    unit, clean = Instance(fmu), Instance(fmu)
    assert max(*unit.initialize(), *clean.initialize()) == OK
    unseen = set(range(max(fmu.references.values()))) - set(fmu.references.values())
    assert len(unseen) == 14  # torque, vehicle's motion, begin of the step
    for reference in unseen:
        unit.log.clear()
        statuses = unit.set_vr("Real", reference, np.nan), unit.get_vr("Real", [reference])[0]
        assert statuses == ((OK, OK) if name == "python" else (ERROR, ERROR))  # the wrapper can refuse only steps
        assert [NO_VARIABLE % ("Real", reference)] * 2 == [message for _, message in unit.log]
    if name == "native":
        fmu.references["unseen"] = min(unseen)
        assert unit.differentiate("unseen", 1, 1.0) == ERROR
    assert max(each.run(0.0, 0.02, 1e-3, fin_command=0.2) for each in (unit, clean)) == OK
    assert unit.outputs() == clean.outputs()


@pytest.mark.parametrize("name", ["python", "native", "3"])
def test_torque_and_angle_have_the_bits_of_the_core(name: str, files: Mapping[str, Path], expected: NDArray[np.float64]
                                                    ) -> None:
    """Also after a reset."""
    assert validate_fmu(str(files[name])) == []
    host = Host(files[name])
    assert np.array_equal(host.run(), expected)
    host.fmu.reset()
    host.begin()
    assert np.array_equal(host.run(), expected)
    host.end()
    assert np.degrees(np.ptp(expected[:, 1])) > 5.0


@pytest.mark.parametrize("name", ["python", "native"])
def test_steps_from_a_restored_state_are_equal(name: str, files: Mapping[str, Path]) -> None:
    """Iterating co-simulation masters repeat steps."""
    host = Host(files[name])
    for k in range(60):
        host.step(k)
    angle, rate, state = host.angle, host.rate, host.fmu.getFMUState()
    first = [host.step(k) for k in range(60, 100)]
    host.fmu.setFMUState(state)
    host.angle, host.rate = angle, rate
    assert [host.step(k) for k in range(60, 100)] == first
    assert np.ptp(first) > 1.0
    host.fmu.freeFMUState(state)
    host.end()


@pytest.mark.parametrize("name", ["python", "native", "3"])
def test_inputs_terminal_and_page(name: str, files: Mapping[str, Path]) -> None:
    """Load and vehicle motion are no inputs; the terminal `hinge` groups the signals between host and FMU."""
    described = fmpy.read_model_description(str(files[name]))
    inputs = {v.name for v in described.modelVariables if v.causality == "input"}
    assert inputs == {"fin_command", "supply_voltage", "enable", "hinge_angle", "hinge_rate"}
    with ZipFile(files[name]) as archive:
        root = ElementTree.fromstring(archive.read("terminalsAndIcons/terminalsAndIcons.xml"))
        page = archive.read("documentation/index.html").decode()
        names = archive.namelist()
    (hinge,) = (t for t in root.iter("Terminal") if t.get("name") == "hinge")
    assert [m.get("variableName") for m in hinge] == [
        "hinge_angle", "hinge_rate", "fin_angle", "fin_rate", "hinge_torque", "actuator_torque", "armature"]
    assert "apply <code>actuator_torque</code>" in page
    assert "half of an actuator" not in page
    links = [link for link in re.findall(r'href="([^"#:]+)"', page) if f"documentation/{link}" not in names]
    assert not links  # an FMU of this interface contains no responses


@pytest.mark.parametrize(("arguments", "message"), [
    (["--interface", "force"], "interface force: choose angle or torque"),
    (["--interface", "torque", "--part", "plant"], "part plant has no interface torque"),
    (["--interface", "torque", "--inputs", "minimal"], "with interface torque the fin's motion is an input"),
    (["--interface", "torque", "--fins", "4"], "interface torque is for a single fin"),
    (["--interface", "torque", "--model", "elastic"], "torque needs a rigid drive line; elastic has none"),
])
def test_interface_that_cannot_be_built_is_refused(arguments: list[str], message: str, tmp_path: Path) -> None:
    done = CliRunner().invoke(app, ["build", *arguments, "-o", str(tmp_path / "x.fmu")])
    assert done.exit_code == 2
    assert message in " ".join(done.output.split())
    assert not list(tmp_path.iterdir())


def test_simulate_refuses_the_torque_interface() -> None:
    done = CliRunner().invoke(app, ["simulate", "--model", f"{NONLINEAR}+torque", "--step", "10"])
    assert done.exit_code == 2
    assert "leave +torque out; an output torque exists only as an FMU: emcas build --interface torque" in " ".join(
        done.output.split())
