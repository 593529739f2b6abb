"""The FMU in a new process of a Python that has only its standard library.

`scenarios.py` makes the calls; the tests here judge the results.
"""

from __future__ import annotations

import json
import subprocess
import sys
import zipfile
from collections.abc import Mapping
from math import radians
from pathlib import Path
from typing import Any

import pytest

pytestmark = pytest.mark.fmu
HERE = Path(__file__).parent
OK, WARNING, DISCARD, ERROR, FATAL = range(5)
# The Python FMU (pythonfmu's wrapper) can refuse only a step; a native FMU refuses the wrong call itself.
REFUSED = {"python": DISCARD, "native": ERROR, "fmi3": ERROR}
only_native = pytest.mark.parametrize("backend", ["native", "fmi3"], indirect=True)
only_fmi2 = pytest.mark.parametrize("backend", ["native"], indirect=True)


@pytest.fixture(scope="session")
def bare_python(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a Python interpreter without NumPy, pythonfmu and emcas_fmu."""
    folder = tmp_path_factory.mktemp("bare")
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", folder], check=True)
    return folder / ("Scripts/python.exe" if sys.platform == "win32" else "bin/python")


@pytest.fixture(scope="session")
def folders(units: Mapping[str, Path], native3: Path, tmp_path_factory: pytest.TempPathFactory) -> Mapping[str, Path]:
    """Return the folders of the unpacked FMUs."""
    folders = {}
    for backend, unit in {**units, "fmi3": native3}.items():
        folders[backend] = tmp_path_factory.mktemp(backend)
        with zipfile.ZipFile(unit) as archive:
            archive.extractall(folders[backend])
    return folders


@pytest.fixture(params=["python", "native", "fmi3"])
def backend(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture
def scenario(bare_python: Path, folders: Mapping[str, Path], tmp_path: Path, backend: str) -> Any:
    """Return a function that runs a scenario and returns its results."""
    def run(name: str) -> Any:
        done = subprocess.run([bare_python, "-B", "-W", "error", HERE / "scenarios.py", name, folders[backend]],
                              capture_output=True, text=True, timeout=120, cwd=tmp_path)
        assert done.returncode == 0, done.stderr  # a crash of the host shows here
        return json.loads(done.stdout.splitlines()[-1])

    return run


def test_runs_without_numpy(scenario: Any) -> None:
    found = scenario("plain_run")
    assert found["status"] == OK
    assert found["log"] == []
    assert not {"numpy", "scipy", "casadi", "emcas_fmu"} & set(found["modules"])
    assert abs(found["outputs"]["fin_angle"] - 0.2) < 0.02  # at its command; an overshoot is still decaying


def test_hostile_steps_and_inputs_are_refused(scenario: Any, backend: str) -> None:
    found = scenario("hostile_step")
    for name, finding in found["findings"].items():
        assert finding["status"] == REFUSED[backend], name
        assert finding["unchanged"], name
        assert finding["log"], name
    for name in ("fin_command", "aero_torque", "acceleration.x", "attitude.pitch", "supply_voltage"):
        assert name in found["findings"][f"{name} nan"]["log"]
    assert found["absurd"][0] in (OK, DISCARD)
    assert found["absurd"][1]
    assert "but the instance is at" in found["findings"]["backwards"]["log"]
    assert found["same"]


def test_wrong_calls_are_reported_and_change_nothing(scenario: Any, backend: str) -> None:
    found = scenario("misuse")
    if backend == "python":
        found["findings"].pop("set partly")  # the wrapper sets the variables before the wrong one
    for name, finding in found["findings"].items():
        # The wrapper could only return Fatal. Therefore a write to an output or a fixed parameter discards the Python
        # FMU's next step; an unknown reference or a wrong type is only logged.
        expected = [ERROR, OK, OK] if backend != "python" else [
            OK, DISCARD if name in ("set output", "set fixed") else OK, OK]
        assert [finding["status"], finding["first"], finding["second"]] == expected, name
        assert finding["log"], name
        assert finding["same"], name
    assert found["order"]["early"][0] == found["order"]["late"][0] == REFUSED[backend]
    assert "instantiated" in found["order"]["early"][1]
    assert "terminated" in found["order"]["late"][1]


def test_message_names_the_bad_parameter_and_its_value(scenario: Any, backend: str) -> None:
    found = scenario("refused_parameters")
    words = {"negative": ["motor.resistance", "-1"], "nan": ["kinematics.moment_arm", "nan"],
             "infinite": ["drive.kp", "inf"], "stop inside command": ["fin.stop_angle", "command.limit"],
             "delay": ["drive.transport_delay", "controller.sample_time"], "multiplier": ["encoder.multiplier", "3"],
             "lever": ["kinematics.initial_angle", "fin.stop_angle"], "percent": ["friction.temperature"]}
    for name, finding in found["findings"].items():
        assert finding["init"] == (OK if backend == "python" else ERROR), name  # see the slave's docstring
        assert finding["steps"] == [REFUSED[backend]] * 2, name
        assert finding["after reset"] == OK, name
        assert all(word in finding["log"] for word in words[name]), (name, finding["log"])
    assert found["tunable"][:2] == [REFUSED[backend], OK]
    assert "controller.position.kp" in found["tunable"][2]


def test_step_with_a_parameter_tuned_against_a_rule_is_discarded(scenario: Any) -> None:
    message = "controller.antiwindup = 10000 1/s must be at most 1/controller.sample_time = 1000 1/s"
    for case, found in scenario("tuned_against_a_rule").items():
        assert found["statuses"] == [OK, DISCARD, OK], case
        assert found["log"] == [[DISCARD, message]], case
        assert found["restored"] == OK, case
        assert found["same"], case


def test_temperature_warning_appears_once_and_status_remains_ok(scenario: Any) -> None:
    found = scenario("warned")
    assert set(found["statuses"]) == {OK}
    cold, inside, warm, warmer = found["warnings"]
    assert "friction.temperature = -40 degC is outside the range in which friction was measured" in cold
    assert "friction.temperature = 60 degC" in warm
    assert (inside, warmer) == ("", "")


def test_inputs_at_0_are_logged_at_the_first_command(scenario: Any) -> None:
    found = scenario("unconnected")
    for name, inputs in (("both", ["supply_voltage", "enable"]), ("supply", ["supply_voltage"]), ("enable", ["enable"]),
                         ("none", [])):
        status, before, after = found[name]
        assert (status, before, len(after)) == (OK, "", len(inputs)), name
        assert all(f"{i} = 0 at the first command" in text for i, text in zip(inputs, after, strict=True)), after


def test_restored_state_continues_with_the_same_bits(scenario: Any) -> None:
    assert scenario("state") == {
        "restored": True, "transplanted": True, "fresh": True, "inside tick": True, "moved": True}


def test_a_wrong_call_refuses_one_step_although_the_state_is_restored(scenario: Any, backend: str) -> None:
    assert scenario("rolled_back") == {"statuses": [DISCARD, OK] if backend == "python" else [OK], "same": True}


def test_corrupt_state_is_refused(scenario: Any) -> None:
    found = scenario("corrupt_state")
    assert found["refused"] == found["damaged"] > 100
    assert found["same"]


def test_state_with_an_impossible_value_is_refused_and_changes_nothing(scenario: Any, backend: str) -> None:
    found = scenario("forged_state")
    assert len(found["findings"]) == (7 if backend == "python" else 2)
    for name, (status, message) in found["findings"].items():
        assert status == REFUSED[backend], name
        assert "FMU state refused" in message, name
    assert found["same"]


def test_start_time_with_a_resolution_above_a_tick_is_refused(scenario: Any, backend: str) -> None:
    """Floating-point times near 1e19 s differ by 2048 s; near a system clock's 1.7e9 s by 0.24 us, 1/1000 of a tick."""
    found = scenario("start_times")
    assert found.pop("1.7e+09")[:2] == [OK, OK]
    assert found.pop("leap")[1] == REFUSED[backend]
    _, status, message = found.pop("long")
    assert status == DISCARD
    assert "more than 100000000 ticks in one step; choose a shorter step" in message
    for start, (initialized, step, message) in found.items():
        assert initialized == (OK if backend == "python" else ERROR), start
        assert step == REFUSED[backend], start
        assert f"start time {start} s" in message
        assert "choose a start time within +-1.68885e+11 s" in message  # 2^49 ticks of 0.3 ms


def test_a_step_past_the_stop_time_is_refused(scenario: Any, backend: str) -> None:
    found = scenario("stop_time")
    assert [found[late][0] for late in ("0", "9e-07", "0.001")] == [OK, OK, REFUSED[backend]]
    assert "ends after the stop time, 1000.1" in found["0.001"][1]
    assert found["0.001"][2] == OK  # the run continues as if the step had not been tried
    assert found["restored"][0] == REFUSED[backend]
    assert "after the stop time" in found["restored"][1]
    assert found["reset"][0] == OK
    for wrong in ("before", "nan"):
        assert found[wrong][0] == REFUSED[backend]
        assert "is not at or after the start time 1000" in found[wrong][1]


def test_reset_restores_the_start_values(scenario: Any) -> None:
    assert scenario("reset") == {"same": True, "cold differs": True}


def test_step_size_and_start_time_do_not_change_the_fin_angle(scenario: Any) -> None:
    differences = scenario("slicing")
    assert len(differences) == 8
    assert max(differences.values()) < 1e-9, differences  # rad, the guaranteed limit


def test_instances_in_threads_equal_instances_in_sequence(scenario: Any) -> None:
    assert scenario("threads") == {"same": True, "distinct": True}


@pytest.mark.skipif(sys.platform == "win32", reason="reads resident memory from /proc")
def test_500_instances_run_and_need_little_memory(scenario: Any, backend: str) -> None:
    found = scenario("many")
    assert found["ok"]
    assert found["alive"]
    # Whole pages, with the host's ctypes objects; benchmarks/native.py measures a native instance alone.
    assert found["KiB each"] < (200.0 if backend == "python" else 20.0)


def test_outputs_follow_start_values(scenario: Any) -> None:
    found = scenario("dry_instance")
    assert found["before"]["fin_angle"] == 0.0
    assert found["during"]["fin_angle"] == pytest.approx(0.1, abs=1e-12)  # rounding of tan and atan
    assert found["during"]["tracking_error"] == pytest.approx(0.2, abs=1e-12)
    assert found["after"] == found["during"]


def test_outputs_before_the_run_are_nan_if_an_input_is(scenario: Any, backend: str) -> None:
    for name, found in scenario("wrong_input_before_the_run").items():
        assert found == {"statuses": [OK, OK, REFUSED[backend], *[OK] * 4], "same": True, "without": True}, name


@only_native
def test_a_refused_read_writes_nothing(scenario: Any) -> None:
    assert scenario("read_partly") == [ERROR, [0.0, 0.0]]


@only_native
def test_wrong_guid_name_or_kind_is_not_instantiated(scenario: Any, backend: str) -> None:
    found = scenario("other_guid")
    assert {name: component for name, (component, _) in found.items()} == {"guid": None, "name": None, "kind": None}
    assert "00000000-0000" in found["guid"][1]
    assert "no name" in found["name"][1]
    assert {"native": "fmi2CoSimulation", "fmi3": "model exchange"}[backend] in found["kind"][1]


@only_fmi2
def test_input_derivatives_replace_small_steps(scenario: Any) -> None:
    """All kinds of inputs are ramps."""
    found = scenario("interpolation")
    # A tick uses the inputs at its middle, and communication points cut ticks differently. The error is of second
    # order in the tick of 0.7 ms, as the integration's. Both may use a quarter of the 0.002 deg for trajectories.
    assert found["coarse-fine"] < radians(0.002) / 4
    assert found["coarse-finest"] < 2e-5  # the finest run's inputs are constant over 0.1 ms
    assert found["constant-finest"] > 100 * found["coarse-finest"]
    assert found["bad"] == {"order 2": ERROR, "nan": ERROR, "output": ERROR, "parameter": ERROR}
    assert "only order 1" in found["log"]
    assert max(map(abs, found["used once"])) < 1e-12  # rounding of the sums
    assert found["restored"]
    assert found["before init"] == OK


@only_fmi2
def test_status_functions(scenario: Any) -> None:
    found = scenario("statuses")
    assert found["last"] == [OK, 0.02]
    assert found["terminated"] == [OK, 0]
    assert found["absurd"] == found["huge step"] == DISCARD
    assert found["after"] == [[OK, 0.02], [OK, 1]]  # a host that cannot mend the input should stop
    assert found["recovered"] == [OK, [OK, 0]]
    assert found["unavailable"] == [DISCARD, DISCARD, ERROR]


@only_native
def test_only_requested_categories_are_logged(scenario: Any) -> None:
    assert scenario("logging") == {
        "off": [OK, False, False], "on": [OK, True, True], "switched on": [OK, True, True],
        "errors": [OK, True, False], "less": [OK, False, True], "all": [OK, True, True],
        "switched off": [OK, False, False], "both": [OK, True, True], "unknown": [ERROR, False, False]}


@only_native
def test_null_pointers_are_errors(scenario: Any) -> None:
    found = scenario("missing_arguments")
    assert found["calls"] == {
        "no arrays": ERROR, "no values": OK, "no categories": ERROR, "no state": ERROR, "state to nowhere": ERROR,
        "strings": ERROR, "free no state": OK, "no instance": ERROR}
    assert found["alive"] == OK
