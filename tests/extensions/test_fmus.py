"""Extensions in FMUs: valid descriptions, and equal results of both back ends in separate processes."""

from __future__ import annotations

import json
import subprocess
import sys
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest
from fmpy import read_model_description, simulate_fmu
from fmpy.validation import validate_fmu

from emcas_fmu.actuators import EXTENSIONS, get
from emcas_fmu.extensions.fault_list import bits, possible
from emcas_fmu.extensions.status import DISABLED, OPERATIONAL, STATUS
from emcas_fmu.parameters import load_parameters

from ..fmu.built import both

ROOT = Path(__file__).resolve().parents[2]
MODELS = ["nonlinear+lugre+uneven+inverter+heat+homing+trajectory+supply+faults",
          "elastic+stribeck+efficiency+saturation+sensors+heat+filters+homing+faults"]


@pytest.fixture(scope="module", params=[MODELS[0], pytest.param(MODELS[1], marks=pytest.mark.slow)])
def model(request: pytest.FixtureRequest) -> str:
    chosen: str = request.param
    return chosen


@pytest.fixture(scope="module")
def built(model: str, tmp_path_factory: pytest.TempPathFactory) -> Mapping[str, Path]:
    # Without homing, so that the loops are closed from the start.
    parameters = load_parameters(model=model)
    changes = parameters.having({"homing.required": False, "uneven.load_share": 0.03, "uneven.ripple": 0.2,
                                  "inverter.dead_time": 1e-6, "inverter.pole_pairs": 4})
    return both(parameters.with_values(changes), tmp_path_factory.mktemp("extensions"))


@pytest.mark.fmu
def test_fmus_are_valid_and_describe_every_variable(model: str, built: Mapping[str, Path]) -> None:
    for path in built.values():
        assert validate_fmu(str(path)) == []
        described = read_model_description(str(path))
        names = [v.name for v in described.modelVariables]
        own = get(model)
        assert {v.name for v in own.inputs + own.outputs + own.parameters} <= set(names)
        assert described.coSimulation.modelIdentifier.startswith("EMCAS_")
    (status,) = (v for v in described.modelVariables if v.name == "status")
    assert [(item.name, item.value) for item in status.declaredType.items] == [
        (name, str(i)) for i, (name, _) in enumerate(STATUS.items, 1)]


@pytest.mark.fmu
def test_back_ends_compute_the_same_bits(model: str, built: Mapping[str, Path], tmp_path: Path) -> None:
    """Every fault becomes active and inactive in a run; steps are not sample times, and a state is restored."""
    changes: list[Any] = [[0, "fin_command", 0.1], [30, "aero_torque", -40.0], [150, "enable", False],
                          [160, "enable", True]]
    fault_bits = {fault.name: 2 ** bits(get(model)).index(fault.name) for fault in possible(get(model))}
    for i, name in enumerate(fault_bits):
        changes += [[10 + 10 * i, f"fault.{name}.active", True], [16 + 10 * i, f"fault.{name}.active", False]]
    script = json.dumps({"start": {"monitor.persistence": 0.004}, "size": 1.3e-3, "steps": 200, "set": changes,
                         "restore": 77})
    rows = {}
    for backend, path in built.items():
        with zipfile.ZipFile(path) as archive:
            archive.extractall(tmp_path / backend)
        done = subprocess.run([sys.executable, "-m", "tests.extensions.drive", str(tmp_path / backend), script],
                              cwd=ROOT, capture_output=True, text=True, timeout=120, check=False)
        assert done.returncode == 0, done.stderr
        rows[backend] = json.loads(done.stdout)
    assert rows["python"] == rows["native"]
    words = {row["fault_word"] for row in rows["native"]}
    assert all(any(word & bit for word in words) for bit in fault_bits.values())
    assert {DISABLED, OPERATIONAL} < {row["status"] for row in rows["native"]}


@pytest.mark.fmu
def test_fmpy_runs_a_scheduled_fault(built: Mapping[str, Path]) -> None:
    for path in built.values():
        start = {"fin_command": 0.1, "fault.jam.begin": 0.02, "fault.jam.end": 1.0}
        run = simulate_fmu(str(path), stop_time=0.05, output_interval=1e-3, start_values=start,
                           output=["motor_angle", "status", "fault_word"])
        assert set(run["status"]) == {int(OPERATIONAL)}
        assert run["fault_word"][-1] == 1
        assert run["motor_angle"][-1] == run["motor_angle"][25] != 0.0


def test_the_models_have_every_extension() -> None:
    assert set(EXTENSIONS) == {extension for name in MODELS for extension in name.split("+")[1:]}
