"""The archive in fmpy, libcosim and Ecos gives the same trajectories; each host also opens it without the example."""

from __future__ import annotations

import subprocess
import sys
import zipfile
from collections.abc import Callable
from functools import cache
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
from fmpy.ssp.simulation import simulate_ssp
from fmpy.ssp.ssd import Parameter, ParameterSet, read_ssv

from emcas_fmu.ssp.archive import SspError, read_archive, write_archive
from examples.ssp_hosts import hosts
from tests.docs.recipes import recipes
from tests.hosts.host import Trajectory, difference, missing, tool, trajectory
from tests.marks import others_slow, slow

from .conftest import Edit
from .run_in import ABSENT, STEPS

pytestmark = pytest.mark.fmu
ROOT = Path(__file__).resolve().parents[2]
OTHERS = ("libcosimpy", "ecospy")
# Hosts compute time differently (nanoseconds, a running sum, a product). Their times differ by at most 1e-15 s; the
# fastest output changes by 1e6 per second, hence by at most 1e-9.
SAME = 1e-9


@cache
def output(host: str, ssp: Path, variant: str, mode: str) -> str:
    """Return the output of run_in in a separate process; skip the test if the host is not installed."""
    if host == "ecospy":
        tool("unzip", "unzip")  # Ecos opens an archive with it
    done = subprocess.run([sys.executable, "-m", "tests.ssp.run_in", host, ssp, variant, mode], cwd=ROOT,
                          capture_output=True, text=True, timeout=60)
    if done.returncode == ABSENT:
        missing(f"{host} cannot be loaded: {done.stderr.strip()}")
    assert done.returncode == 0, done.stdout[-1000:] + done.stderr[-4000:]
    return done.stdout


def run(host: str, ssp: Path, variant: str = "nominal", mode: str = "open") -> Trajectory:
    """Return all outputs over time in a host."""
    outputs = trajectory(output(host, ssp, variant, mode))
    assert len(outputs["time"]) == STEPS
    return outputs


@pytest.fixture(scope="module")
def expected(ssp: Path) -> Trajectory:
    """The nominal system in fmpy."""
    return run("fmpy", ssp)


def test_each_fin_moves_to_its_command(expected: Trajectory) -> None:
    """Before the loads the angle is within the overshoot of a small step; at the end the drive is disabled."""
    for i in (1, 2, 3, 4):
        assert abs(expected[f"fin{i}.fin_angle"][99] - 0.06 * i) < 0.02
        assert expected[f"fin{i}.motor_current"][-1] == 0.0


@pytest.mark.parametrize("host", others_slow(OTHERS, lambda host: host != "ecospy"))
@pytest.mark.parametrize("variant", ["degraded", *slow("nominal", "cold")])
def test_same_trajectory_as_in_fmpy(host: str, variant: str, ssp: Path, expected: Trajectory) -> None:
    """The comparison would see inputs that are a step late, and missing parameters of the variant."""
    in_fmpy = expected if variant == "nominal" else run("fmpy", ssp, variant)
    in_host = run(host, ssp, variant)
    assert difference(in_fmpy, in_host) < SAME
    late = {name: values[1:] for name, values in in_fmpy.items()}
    assert difference(late, {name: values[:-1] for name, values in in_host.items()}) > 1e-3
    if variant != "nominal":
        assert difference(expected, in_host) > 1e-3


@pytest.mark.parametrize("host", others_slow(hosts.HOSTS, lambda host: host == "fmpy"))
def test_connection_between_components_delays_by_a_step(host: str, edit: Edit, ssp: Path) -> None:
    """The delay is that of a loop that gets an output after each step and sets the input before the next one."""
    archive = edit("SystemStructure.ssd", 'startConnector="fin2_fin_command"',
                   'startElement="fin1" startConnector="fin_angle"')
    wired, loop = run(host, archive, mode="wired"), run("fmpy", ssp, mode="loop")
    if host == "ecospy":
        # Ecos passes values at the end of a step: the tracking error is then already that of the next command.
        ahead = wired.pop("fin2.tracking_error")
        expected = np.subtract(loop["fin1.fin_angle"], loop["fin2.fin_angle"])
        np.testing.assert_allclose(ahead, expected, rtol=0, atol=SAME)
        assert np.abs(loop.pop("fin2.tracking_error") - expected).max() > 1e-3
    assert difference(loop, wired) < SAME
    assert abs(wired["fin2.fin_angle"][99] - 0.06) < 0.02


@pytest.mark.slow
@pytest.mark.parametrize("host", OTHERS)
def test_example_opens_an_archive_that_the_host_alone_refuses(host: str, wired_ssp: Path, expected: Trajectory
                                                              ) -> None:
    """libcosim and Ecos refuse connections of the system's connectors."""
    assert difference(expected, run(host, wired_ssp)) < SAME
    with pytest.raises(AssertionError):
        output(host, wired_ssp, "-", "plain")


def parameters(host: str, ssp: Path, parameter_set: str) -> list[tuple[float, ...]]:
    """Return azimuth [deg], temperature [degC], fin friction [N.m] and supply [V] of each fin in a host alone."""
    rows = [[float(word) for word in line.split()] for line in output(host, ssp, parameter_set, "plain").splitlines()]
    return [(round(np.degrees(row[0]), 9), *row[1:]) for row in rows]


@pytest.mark.slow
def test_libcosim_and_ecos_alone_read_the_parameters(ssp: Path, tmp_path: Path) -> None:
    nominal = [(a, 24.0, 0.0, 39.0) for a in (45.0, 135.0, 225.0, 315.0)]
    cold = [(a, -6.0, 0.0, 39.0) for a, *_ in nominal]
    assert parameters("libcosimpy", ssp, "-") == nominal
    assert parameters("ecospy", ssp, "nominal") == nominal
    assert parameters("ecospy", ssp, "-") == [(0.0, 24.0, 0.0, 39.0)] * 4  # the FMU's, as docs/use/ssp.md warns
    with zipfile.ZipFile(ssp) as archive:
        archive.extractall(tmp_path)
    assert parameters("libcosimpy", tmp_path / "cold.ssd", "-") == cold
    (tmp_path / "cold.ssd").replace(tmp_path / "SystemStructure.ssd")
    assert parameters("ecospy", tmp_path, "cold") == cold


def test_simulate_ssp_of_fmpy_is_a_step_late(ssp: Path, wired_ssp: Path) -> None:
    """In the first step it sets all inputs to zero, and the fins are at rest."""
    names = [f"fin{i}.fin_angle" for i in (1, 2, 3, 4)]
    command: dict[str, Callable[[float], float]] = {
        f"fin{i}_fin_command": lambda _, angle=0.06 * i: angle for i in (1, 2, 3, 4)}  # type: ignore[misc]
    inputs = {"supply_voltage": lambda _: 39.0, "enable": lambda _: 1.0, **command}
    table = ParameterSet(parameters=[
        Parameter(name=f"fin{i}.{p.name}", value=p.value) for i in (1, 2, 3, 4)
        for p in read_ssv(str(wired_ssp), f"resources/cold_fin{i}.ssv").parameters])
    late = simulate_ssp(str(wired_ssp), stop_time=0.0995, step_size=1e-3, parameter_set=table, input=inputs)
    with hosts.open(ssp, "fmpy", "cold") as system:
        rows = []
        for i in (1, 2, 3, 4):
            system.set(f"fin{i}.fin_command", 0.06 * i)
        for _ in range(100):
            system.step()
            rows.append([system.get(name) for name in names])
    assert len(late) == 100
    shifted = np.column_stack([late[name.replace(".", "_", 1)] for name in names])[1:]
    np.testing.assert_allclose(shifted, np.array(rows)[:-1], rtol=0, atol=SAME)
    assert np.ptp(shifted[:, 3]) > 0.2
    # Without supply voltage and `enable` no fin moves.
    dead = simulate_ssp(str(wired_ssp), stop_time=0.05, step_size=1e-3, parameter_set=table, input=command)
    assert np.ptp(dead["fin4_fin_angle"]) == 0.0
    with pytest.raises(UnboundLocalError):  # fmpy fails if an input is not connected
        simulate_ssp(str(ssp), stop_time=0.01, step_size=1e-3)


def test_wrong_calls_of_a_system_are_refused(ssp: Path, edit: Edit) -> None:
    with pytest.raises(SspError, match="no host 'ecos'; there is fmpy, libcosimpy, ecospy"):
        hosts.open(ssp, "ecos")
    with pytest.raises(SspError, match="no variant 'warm'; it has nominal, cold, degraded"):
        hosts.open(ssp, "fmpy", "warm")
    with pytest.raises(SspError, match="must be above 0"):
        hosts.open(ssp, "fmpy", step=0.0)
    archive = edit("resources/nominal_fin1.ssv", 'name="motor.resistance"', 'name="motor.resistence"')
    with pytest.raises(SspError, match=r"did you mean motor\.resistance"):
        hosts.open(archive, "fmpy")
    with hosts.open(ssp, "fmpy") as system:
        with pytest.raises(SspError, match=r"no input 'fin1.fin_comand'; did you mean fin1\.fin_command"):
            system.set("fin1.fin_comand", 0.0)
        with pytest.raises(SspError, match="must be finite"):
            system.set("supply_voltage", float("nan"))
        with pytest.raises(SspError, match="not known before the first step"):
            system.get("fin1.fin_angle")
        system.set("supply_voltage", -1.0)
        system.step()
        with pytest.raises(SspError, match=r"no output 'fin_angle'; did you mean fin\d\.fin_angle"):
            system.get("fin_angle")
        assert system.time == 1e-3
    system.close()
    with pytest.raises(SspError, match="the system is closed"):
        system.step()


def test_fmu_for_other_platforms_is_refused(ssp: Path, tmp_path: Path) -> None:
    contents, stripped = read_archive(ssp), BytesIO()
    with zipfile.ZipFile(BytesIO(contents["resources/EMCAS.fmu"])) as unit, zipfile.ZipFile(stripped, "w") as target:
        for name in unit.namelist():
            target.writestr(name.replace("linux64", "other").replace("win64", "other"), unit.read(name))
    write_archive({**contents, "resources/EMCAS.fmu": stripped.getvalue()}, tmp_path / "other.ssp")
    with pytest.raises(SspError, match="has binaries for other only, and this is"):
        hosts.open(tmp_path / "other.ssp", "fmpy")


def test_missing_host_is_an_error_with_the_remedy(ssp: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "libcosimpy", None)
    with pytest.raises(SspError, match=r"libcosimpy cannot be loaded .*pip install libcosimpy"):
        hosts.open(ssp, "libcosimpy")


@pytest.mark.slow
def test_example_program_runs_and_refuses_wrong_arguments(ssp: Path, tmp_path: Path) -> None:
    def call(*arguments: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run([sys.executable, ROOT / "examples/ssp_hosts/run.py", ssp, *arguments], cwd=tmp_path,
                              capture_output=True, text=True, timeout=60)

    done = call("--variant", "cold", "--set", "fin1.fin_command=0.1", "--set", "fin2.fin_command=0.2", "--set",
                "enable=true", "--output", "out.csv")
    assert done.returncode == 0, done.stderr
    outputs = trajectory((tmp_path / "out.csv").read_text(encoding="utf-8"))
    assert len(outputs["time"]) == 300
    assert [round(outputs[f"fin{i}.fin_angle"][-1], 1) for i in (1, 2, 3, 4)] == [0.1, 0.2, 0.0, 0.0]
    for arguments, message in ((("--host", "ecos"), "no host 'ecos'"), (("--set", "bus=1"), "no input 'bus'"),
                            (("--set", "supply_voltage"), "expected NAME=VALUE"),
                            (("--output", "no/out.csv"), "there is no folder no"),
                            (("--output", str(ssp)), "would be overwritten")):
        refused = call(*arguments)
        assert refused.returncode == 2
        assert message in refused.stderr


@pytest.mark.slow
def test_loop_of_the_examples_readme_runs(ssp: Path) -> None:
    language, text = recipes("../examples/ssp_hosts/README.md")["loop"]
    assert language == "python"
    program = text.replace('Path("EMCAS.ssp")', f"Path({str(ssp)!r})")
    done = subprocess.run([sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    time, angle = map(float, done.stdout.splitlines()[-1].split())
    assert time == pytest.approx(0.3)
    assert abs(angle - 0.1) < 0.02
