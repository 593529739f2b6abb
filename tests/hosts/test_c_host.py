"""The FMUs in a host written in C, which loads the library or contains the sources; also under valgrind."""

from __future__ import annotations

import signal
import sysconfig
from pathlib import Path

import pytest

from tests.interop import matrix
from tests.marks import others_slow, slow

from .conftest import UNUSED, Host
from .expected import MISUSE, MISUSE3, STATES
from .host import Trajectory, compile_host, missing, run, table, tool, trajectory

pytestmark = pytest.mark.fmu


@pytest.fixture(params=["loading", "loading3", *slow("linked", "linked3")])
def host(request: pytest.FixtureRequest) -> Host:
    """The host with library or sources, of FMI 2.0 and 3.0."""
    host: Host = request.getfixturevalue(request.param)
    return host


def in_fmpy(fmu: Path, encoder: str, folder: Path) -> Trajectory:
    """Return the trajectory of the host's `plain` in fmpy."""
    task = {"step": 1e-3, "parameters": {"encoder.enabled": encoder == "1"},
            "inputs": {"fin_command": 300 * [0.2], "aero_torque": 100 * [0.0] + 200 * [-40.0]}}
    return matrix.run("fmpy", fmu, task, folder).outputs


@pytest.mark.parametrize("encoder", ["0", "1"])
def test_same_bits_as_in_fmpy(loading: Host, native_fmu: Path, encoder: str, tmp_path: Path) -> None:
    outputs = trajectory(loading("plain", encoder))
    assert outputs == in_fmpy(native_fmu, encoder, tmp_path)
    assert abs(outputs["fin_angle"][-1] - 0.2) < 0.02  # at its command; an overshoot is still decaying


@pytest.mark.parametrize("encoder", ["0", "1"])
def test_fmi_3_gives_the_bits_of_fmi_2(loading: Host, loading3: Host, encoder: str) -> None:
    assert loading("plain", encoder) == loading3("plain", encoder)


@pytest.mark.slow
def test_sources_give_the_bits_of_the_library(loading: Host, linked: Host) -> None:
    """Another compiler compiles them."""
    assert loading("plain", "0") == linked("plain", "0")


def test_instances_stepped_in_turns_equal_instances_alone(host: Host) -> None:
    assert table(host("four")) == {"equal": "4", "distinct": "4"}


def test_instances_in_threads_equal_instances_alone(host: Host) -> None:
    assert table(host("threads")) == {"equal": "8"}


def test_restored_states_continue_and_damaged_ones_are_refused(host: Host) -> None:
    results = table(host("states"))
    damaged = results.pop("damaged")
    assert int(damaged) > 100
    assert results == {**STATES, "refused": damaged}


def test_wrong_calls_are_errors_with_a_message(host: Host, request: pytest.FixtureRequest) -> None:
    results = table(host("misuse"))
    # The last instance is at its command after 0.3 s; an overshoot is still decaying.
    assert abs(float(results.pop("angle")) - 0.1) < 0.01
    assert results == (MISUSE3 if "3" in request.node.callspec.params["host"] else MISUSE)


def test_no_floating_point_exception_occurs(host: Host) -> None:
    """Invalid operation, division by zero and overflow would kill the process; the runs reach every limit."""
    results = {name: dict(zip(words[::2], words[1::2])) for name, line in table(host("traps")).items()
               for words in [line.split()]}
    assert len(results) == 10
    assert all(result["finite"] == "1" for result in results.values())
    assert results["low supply"]["saturated"] == results["back-driven"]["at_stop"] == "1"
    assert results["disabled, onto the stop"] == {"finite": "1", "saturated": "0", "at_stop": "1", "moved": "1"}
    assert results["disabled, at rest"]["moved"] == "0"


def test_floating_point_exception_kills_the_host(loading: Host) -> None:
    loading("traps", environment={"HOST_PROVE_TRAP": "1"}, code=-signal.SIGFPE)


def test_ten_minutes_without_drift_or_leak(loading: Host) -> None:
    """A command of 2.4 rad/s and a load, both periodic, for 600 000 steps of 1 ms."""
    results = {name: float(value) for name, value in table(loading("moving", "600000")).items()}
    assert abs(results["time"] - 600.0) < 1e-9  # the rounding of 600 000 sums is below 1e-10
    assert results["finite"] == 1
    assert results["growth"] == 0  # bytes on the heap since the first simulated second
    assert 0.25 < results["reach"] < 0.3491  # rad; it moves, within the command's limit of 20 deg
    assert results["lag"] < 0.1  # rad; rate over position gain is 0.04, and as much again for delay and reversals
    # The last 6 s equal the 6 s five minutes before. The integral of the drive, worth 1e-6 rad with a time constant of
    # 50 s, has decayed to 2.5e-3 of that. At 2.4 rad/s, 1e-8 rad is a clock error of 4 ns.
    assert results["repeat"] < 1e-8


@pytest.mark.slow
def test_thread_sanitizer_finds_no_data_race(native: Path, tmp_path: Path, linux: None) -> None:
    host = compile_host([tool("gcc", "gcc")], native, tmp_path / "host", ("-fsanitize=thread",), static=True)
    assert table(run([host, "-", UNUSED, "threads"])) == {"equal": "8"}


@pytest.mark.parametrize("arguments", [("states",), ("misuse",), *slow((("plain", "1"),), (("moving", "12000"),))])
def test_valgrind_finds_no_memory_error_or_leak(executable: Path, native: Path, arguments: tuple[str, ...]) -> None:
    run([tool("valgrind", "valgrind"), "-q", "--error-exitcode=9", "--leak-check=full",
         "--errors-for-leak-kinds=definite,indirect,possible", executable, native / "binaries/linux64/EMCAS.so",
         UNUSED, *arguments])


@pytest.mark.parametrize("command", others_slow(["plain", "four", "threads"], lambda command: command == "plain"))
def test_python_fmu_runs_with_libpython_preloaded(python: Path, fmu: Path, tmp_path: Path, linux: None, command: str
                                                  ) -> None:
    """As the README says: libpython in LD_PRELOAD."""
    library = Path(str(sysconfig.get_config_var("LIBDIR"))) / str(sysconfig.get_config_var("INSTSONAME"))
    if not library.is_file() or ".so" not in library.name:
        missing("this Python has no shared library (Debian: apt-get install libpython3-dev)")
    host = compile_host([tool("gcc", "gcc")], python, tmp_path / "host")
    output = run([host, python / "binaries/linux64/EMCAS.so", (python / "resources").as_uri(), command, "1"],
                 environment={"LD_PRELOAD": str(library)})
    if command == "plain":
        assert trajectory(output) == in_fmpy(fmu, "1", tmp_path)
    else:
        assert table(output)["equal"] == {"four": "4", "threads": "8"}[command]
