"""The FMUs in a host written in C: with the library loaded, with the sources compiled in, under checkers."""

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
    """The host in C, in both ways of having the FMU, of FMI 2.0 and 3.0."""
    found: Host = request.getfixturevalue(request.param)
    return found


@pytest.fixture(scope="module")
def plain(loading: Host) -> Trajectory:
    """The step response in the C host, true angles to the controllers."""
    return trajectory(loading("plain", "0"))


def in_fmpy(fmu: Path, encoder: str, folder: Path) -> Trajectory:
    """What `plain` of the host in C does, in fmpy."""
    task = {"step": 1e-3, "parameters": {"encoder.enabled": encoder == "1"},
            "inputs": {"fin_command": 300 * [0.2], "aero_torque": 100 * [0.0] + 200 * [-40.0]}}
    return matrix.run("fmpy", fmu, task, folder).found


@pytest.mark.parametrize("encoder", ["0", "1"])
def test_same_bits_as_in_fmpy(loading: Host, native_fmu: Path, encoder: str, tmp_path: Path) -> None:
    """Library, inputs and calls are the same, so nothing may differ."""
    found = trajectory(loading("plain", encoder))
    assert found == in_fmpy(native_fmu, encoder, tmp_path)
    assert abs(found["fin_angle"][-1] - 0.2) < 0.02  # at its command, but for what is left of an overshoot


@pytest.mark.parametrize("encoder", ["0", "1"])
def test_fmi_3_gives_the_bits_of_fmi_2(loading: Host, loading3: Host, encoder: str) -> None:
    assert loading("plain", encoder) == loading3("plain", encoder)


@pytest.mark.slow
def test_sources_compiled_by_another_compiler(linked: Host, plain: Trajectory) -> None:
    assert plain == trajectory(linked("plain", "0"))


def test_instances_in_turns(host: Host) -> None:
    assert table(host("four")) == {"equal": "4", "distinct": "4"}


def test_instances_in_threads(host: Host) -> None:
    assert table(host("threads")) == {"equal": "8"}


def test_states(host: Host) -> None:
    found = table(host("states"))
    damaged = found.pop("damaged")
    assert int(damaged) > 100
    assert found == {**STATES, "refused": damaged}


def test_misuse(host: Host, request: pytest.FixtureRequest) -> None:
    found = table(host("misuse"))
    # At its command except for the rest of an overshoot, 0.3 s after the command of the sound instance.
    assert abs(float(found.pop("angle")) - 0.1) < 0.01
    assert found == (MISUSE3 if "3" in request.node.callspec.params["host"] else MISUSE)


def test_no_floating_point_trap(host: Host) -> None:
    """Invalid operation, division by zero and overflow kill the process; every limit is met on the way."""
    found = {name: dict(zip(words[::2], words[1::2])) for name, line in table(host("traps")).items()
             for words in [line.split()]}
    assert len(found) == 10
    assert all(f["finite"] == "1" for f in found.values())
    assert found["low supply"]["saturated"] == found["back-driven"]["at_stop"] == "1"
    assert found["disabled, onto the stop"] == {"finite": "1", "saturated": "0", "at_stop": "1", "moved": "1"}
    assert found["disabled, at rest"]["moved"] == "0"


def test_traps_are_armed(loading: Host) -> None:
    loading("traps", environment={"HOST_PROVE_TRAP": "1"}, code=-signal.SIGFPE)


def test_ten_minutes(loading: Host) -> None:
    """A command of 2.4 rad/s and a load, each repeating, for 600 000 steps of 1 ms."""
    found = {name: float(value) for name, value in table(loading("moving", "600000")).items()}
    assert abs(found["time"] - 600.0) < 1e-9  # the rounding of 600 000 sums is below 1e-10
    assert found["finite"] == 1
    assert found["growth"] == 0  # bytes on the heap since the first simulated second
    assert 0.25 < found["reach"] < 0.3491  # moves, within the command's limit of 20 deg
    assert found["lag"] < 0.1  # follows: rate over position gain is 0.04 rad, and as much again for delay and reversals
    # The last 6 s are those five minutes before, the drive's integral of 50 s having settled to 1e-3 of the 1e-6 rad it
    # is worth: at 2.4 rad/s, 1e-8 rad would be a clock gone wrong by 4 ns.
    assert found["repeat"] < 1e-8


@pytest.mark.slow
def test_thread_sanitizer(native: Path, tmp_path: Path, linux: None) -> None:
    made = compile_host([tool("gcc", "gcc")], native, tmp_path / "host", ("-fsanitize=thread",), static=True)
    assert table(run([made, "-", UNUSED, "threads"])) == {"equal": "8"}


@pytest.mark.parametrize("what", [("states",), ("misuse",), *slow((("plain", "1"),), (("moving", "12000"),))])
def test_valgrind(executable: Path, native: Path, what: tuple[str, ...]) -> None:
    """Nothing uninitialised is used, nothing out of bounds, and no instance, state or message is leaked."""
    run([tool("valgrind", "valgrind"), "-q", "--error-exitcode=9", "--leak-check=full",
         "--errors-for-leak-kinds=definite,indirect,possible", executable, native / "binaries/linux64/EMCAS.so",
         UNUSED, *what])


@pytest.mark.parametrize("what", others_slow(["plain", "four", "threads"], lambda what: what == "plain"))
def test_python_fmu_with_python_preloaded(python: Path, fmu: Path, tmp_path: Path, linux: None, what: str) -> None:
    """The Python back end's FMU in the same host, as the README says: libpython in LD_PRELOAD."""
    library = Path(str(sysconfig.get_config_var("LIBDIR"))) / str(sysconfig.get_config_var("INSTSONAME"))
    if not library.is_file() or ".so" not in library.name:
        missing("this Python has no shared library (Debian: apt-get install libpython3-dev)")
    made = compile_host([tool("gcc", "gcc")], python, tmp_path / "host")
    printed = run([made, python / "binaries/linux64/EMCAS.so", (python / "resources").as_uri(), what, "1"],
                  environment={"LD_PRELOAD": str(library)})
    if what == "plain":  # the same calls into the same Python code
        assert trajectory(printed) == in_fmpy(fmu, "1", tmp_path)
    else:
        assert table(printed)["equal"] == {"four": "4", "threads": "8"}[what]
