"""The FMU in a fresh process where nothing but Python's standard library is installed."""

from __future__ import annotations

import json
import subprocess
import sys
import zipfile
from pathlib import Path
from typing import Any

import pytest

pytestmark = pytest.mark.fmu
HERE = Path(__file__).parent
OK, WARNING, DISCARD, ERROR, FATAL = range(5)


@pytest.fixture(scope="session")
def bare_python(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An interpreter with an empty environment: no NumPy, no pythonfmu, no emcas_fmu."""
    folder = tmp_path_factory.mktemp("bare")
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", folder], check=True)
    return folder / ("Scripts/python.exe" if sys.platform == "win32" else "bin/python")


@pytest.fixture(scope="session")
def unpacked(fmu: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("unpacked")
    with zipfile.ZipFile(fmu) as archive:
        archive.extractall(folder)
    return folder


@pytest.fixture
def scenario(bare_python: Path, unpacked: Path, tmp_path: Path) -> Any:
    def run(name: str) -> Any:
        done = subprocess.run([bare_python, "-B", "-W", "error", HERE / "scenarios.py", name, unpacked],
                              capture_output=True, text=True, timeout=120, cwd=tmp_path)
        assert done.returncode == 0, done.stderr  # a crash of the host shows here
        return json.loads(done.stdout.splitlines()[-1])

    return run


def test_runs_without_numpy(scenario: Any) -> None:
    found = scenario("plain_run")
    assert found["status"] == OK
    assert found["log"] == []
    assert not {"numpy", "scipy", "casadi", "emcas_fmu"} & set(found["modules"])
    assert abs(found["outputs"]["fin_angle"] - 0.2) < 0.0035  # at its command within Table 2's 0.2 deg


def test_hostile_steps_and_inputs_are_discarded(scenario: Any) -> None:
    found = scenario("hostile_step")
    for name, finding in found["findings"].items():
        assert finding["status"] == DISCARD, name
        assert finding["unchanged"], name
        assert finding["log"], name
    for name in ("fin_command", "aero_torque", "acceleration.x", "attitude.pitch", "supply_voltage"):
        assert name in found["findings"][f"{name} nan"]["log"]
    assert found["absurd"][0] in (OK, DISCARD)
    assert found["absurd"][1]
    assert "stands at" in found["findings"]["backwards"]["log"]
    assert found["same"]


def test_misuse_discards_the_next_step_only(scenario: Any) -> None:
    found = scenario("misuse")
    for name, finding in found["findings"].items():
        assert finding["status"] == OK, name  # the wrapper knows no other answer than fatal
        assert finding["log"], name
        assert [finding["first"], finding["second"]] == [DISCARD, OK], name
        assert finding["same"], name
    assert found["order"]["early"][0] == DISCARD
    assert "instantiated" in found["order"]["early"][1]
    assert found["order"]["late"][0] == DISCARD
    assert "terminated" in found["order"]["late"][1]


def test_bad_parameters_are_refused_by_name(scenario: Any) -> None:
    found = scenario("refused_parameters")
    said = {"negative": ["motor.resistance", "-1"], "nan": ["kinematics.moment_arm", "nan"],
            "infinite": ["drive.kp", "inf"], "stop inside command": ["fin.stop_angle", "command.limit"],
            "delay": ["drive.transport_delay", "controller.sample_time"], "multiplier": ["encoder.multiplier", "3"],
            "lever": ["kinematics.initial_angle", "fin.stop_angle"], "percent": ["friction.temperature"]}
    for name, finding in found["findings"].items():
        assert finding["init"] == OK, name  # see the slave's docstring
        assert finding["steps"] == [DISCARD, DISCARD], name
        assert finding["after reset"] == OK, name
        assert all(word in finding["log"] for word in said[name]), (name, finding["log"])
    assert found["tunable"][:2] == [DISCARD, OK]
    assert "controller.position.kp" in found["tunable"][2]


def test_state_continues_bit_for_bit(scenario: Any) -> None:
    assert scenario("state") == {
        "restored": True, "transplanted": True, "fresh": True, "inside tick": True, "moved": True}


def test_corrupt_state_is_refused(scenario: Any) -> None:
    found = scenario("corrupt_state")
    assert found["refused"] == found["damaged"] > 100
    assert found["same"]


def test_reset(scenario: Any) -> None:
    assert scenario("reset") == {"same": True, "cold differs": True}


def test_slicing(scenario: Any) -> None:
    worst = scenario("slicing")
    assert len(worst) == 8
    assert max(worst.values()) < 1e-9, worst  # the contract


def test_threads(scenario: Any) -> None:
    assert scenario("threads") == {"same": True, "distinct": True}


@pytest.mark.skipif(sys.platform == "win32", reason="reads resident memory with getrusage")
def test_many_instances(scenario: Any) -> None:
    found = scenario("many")
    assert found["ok"]
    assert found["alive"]
    assert found["KiB each"] < 200.0


def test_outputs_follow_start_values(scenario: Any) -> None:
    found = scenario("dry_instance")
    assert found["before"]["fin_angle"] == 0.0
    assert found["during"]["fin_angle"] == pytest.approx(0.1, abs=1e-12)  # rounding of tan and atan
    assert found["during"]["tracking_error"] == pytest.approx(0.2, abs=1e-12)
    assert found["after"] == found["during"]
