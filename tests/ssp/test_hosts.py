"""The archive in fmpy, libcosim and Ecos: the same trajectories, and the behaviour of each without the example."""

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
# Hosts count time their own way (nanoseconds, a running sum, a product), to within 1e-15 s of each other; the fastest
# output changes by 1e6 a second, hence by 1e-9 at most.
SAME = 1e-9


@cache
def printed(host: str, ssp: Path, variant: str, mode: str) -> str:
    """What run_in prints in a separate process; the test is skipped where the host is not."""
    if host == "ecospy":
        tool("unzip", "unzip")  # how ecos opens an archive
    done = subprocess.run([sys.executable, "-m", "tests.ssp.run_in", host, ssp, variant, mode], cwd=ROOT,
                          capture_output=True, text=True, timeout=60)
    if done.returncode == ABSENT:
        missing(f"{host} cannot be loaded: {done.stderr.strip()}")
    assert done.returncode == 0, done.stdout[-1000:] + done.stderr[-4000:]
    return done.stdout


def run(host: str, ssp: Path, variant: str = "nominal", mode: str = "open") -> Trajectory:
    """The trajectory of all outputs in a host."""
    found = trajectory(printed(host, ssp, variant, mode))
    assert len(found["time"]) == STEPS
    return found


@pytest.fixture(scope="module")
def expected(ssp: Path) -> Trajectory:
    """The nominal system in fmpy."""
    return run("fmpy", ssp)


def test_each_fin_does_what_it_is_told(expected: Trajectory) -> None:
    """Within the overshoot of small steps, before loads and sag; afterwards the bridge is off."""
    for i in (1, 2, 3, 4):
        assert abs(expected[f"fin{i}.fin_angle"][99] - 0.06 * i) < 0.02
        assert expected[f"fin{i}.motor_current"][-1] == 0.0


@pytest.mark.parametrize("host", others_slow(OTHERS, lambda host: host != "ecospy"))
@pytest.mark.parametrize("variant", ["degraded", *slow("nominal", "cold")])
def test_same_trajectory_as_in_fmpy(host: str, variant: str, ssp: Path, expected: Trajectory) -> None:
    """Inputs set between steps and parameters of the variant; nothing is a step late, nothing is left out."""
    wanted = expected if variant == "nominal" else run("fmpy", ssp, variant)
    found = run(host, ssp, variant)
    assert difference(wanted, found) < SAME
    late = {name: values[1:] for name, values in wanted.items()}
    assert difference(late, {name: values[:-1] for name, values in found.items()}) > 1e-3
    if variant != "nominal":
        assert difference(expected, found) > 1e-3  # were its parameters left out, this would be the same


@pytest.mark.parametrize("host", others_slow(hosts.HOSTS, lambda host: host == "fmpy"))
def test_a_wire_between_components_is_a_step_late(host: str, edited: Edit, ssp: Path) -> None:
    """As late as a loop that reads after each step and sets before the next, in every host."""
    wired = edited("SystemStructure.ssd", 'startConnector="fin2_fin_command"',
                   'startElement="fin1" startConnector="fin_angle"')
    found, wanted = run(host, wired, mode="wired"), run("fmpy", ssp, mode="loop")
    if host == "ecospy":
        # Ecos passes values on at the end of the step: what depends on an input at once is that of the next one.
        ahead = found.pop("fin2.tracking_error")
        expected = np.subtract(wanted["fin1.fin_angle"], wanted["fin2.fin_angle"])
        np.testing.assert_allclose(ahead, expected, rtol=0, atol=SAME)
        assert np.abs(wanted.pop("fin2.tracking_error") - expected).max() > 1e-3
    assert difference(wanted, found) < SAME
    assert abs(found["fin2.fin_angle"][99] - 0.06) < 0.02


@pytest.mark.slow
@pytest.mark.parametrize("host", OTHERS)
def test_connectors_of_the_system_are_passed_over(host: str, wired: Path, expected: Trajectory) -> None:
    """In an archive that neither opens by itself."""
    assert difference(expected, run(host, wired)) < SAME
    with pytest.raises(AssertionError):
        printed(host, wired, "-", "plain")


def parameters(host: str, ssp: Path, asked: str) -> list[tuple[float, ...]]:
    """What a host makes of the file, by fin: azimuth [deg], temperature [degC], fin friction [N.m], bus [V]."""
    rows = [[float(word) for word in line.split()] for line in printed(host, ssp, asked, "plain").splitlines()]
    return [(round(np.degrees(row[0]), 9), *row[1:]) for row in rows]


@pytest.mark.slow
def test_the_file_as_it_is_in_libcosim_and_ecos(ssp: Path, tmp_path: Path) -> None:
    nominal = [(a, 24.0, 0.0, 39.0) for a in (45.0, 135.0, 225.0, 315.0)]
    cold = [(a, -6.0, 0.0, 39.0) for a, *_ in nominal]
    assert parameters("libcosimpy", ssp, "-") == nominal
    assert parameters("ecospy", ssp, "nominal") == nominal
    assert parameters("ecospy", ssp, "-") == [(0.0, 24.0, 0.0, 39.0)] * 4  # the FMU's own, as docs/use/ssp.md warns
    with zipfile.ZipFile(ssp) as archive:
        archive.extractall(tmp_path)
    assert parameters("libcosimpy", tmp_path / "cold.ssd", "-") == cold
    (tmp_path / "cold.ssd").replace(tmp_path / "SystemStructure.ssd")
    assert parameters("ecospy", tmp_path, "cold") == cold


def test_simulate_ssp_is_a_step_late(ssp: Path, wired: Path) -> None:
    """It feeds zeros in the first step and everything else one step late; the fins rest meanwhile."""
    names = [f"fin{i}.fin_angle" for i in (1, 2, 3, 4)]
    command: dict[str, Callable[[float], float]] = {
        f"fin{i}_fin_command": lambda _, angle=0.06 * i: angle for i in (1, 2, 3, 4)}  # type: ignore[misc]
    given = {"supply_voltage": lambda _: 39.0, "enable": lambda _: 1.0, **command}
    table = ParameterSet(parameters=[
        Parameter(name=f"fin{i}.{p.name}", value=p.value) for i in (1, 2, 3, 4)
        for p in read_ssv(str(wired), f"resources/cold_fin{i}.ssv").parameters])
    found = simulate_ssp(str(wired), stop_time=0.0995, step_size=1e-3, parameter_set=table, input=given)
    with hosts.open(ssp, "fmpy", "cold") as system:
        rows = []
        for i in (1, 2, 3, 4):
            system.set(f"fin{i}.fin_command", 0.06 * i)
        for _ in range(100):
            system.step()
            rows.append([system.get(name) for name in names])
    assert len(found) == 100
    shifted = np.column_stack([found[name.replace(".", "_", 1)] for name in names])[1:]
    np.testing.assert_allclose(shifted, np.array(rows)[:-1], rtol=0, atol=SAME)
    assert np.ptp(shifted[:, 3]) > 0.2
    # Without the bus and the switch nothing moves.
    dead = simulate_ssp(str(wired), stop_time=0.05, step_size=1e-3, parameter_set=table,
                        input=command)
    assert np.ptp(dead["fin4_fin_angle"]) == 0.0
    with pytest.raises(UnboundLocalError):  # nothing is wired to an input that is declared
        simulate_ssp(str(ssp), stop_time=0.01, step_size=1e-3)


def test_misuse_of_a_system(ssp: Path, edited: Edit) -> None:
    with pytest.raises(SspError, match="no host 'ecos'; there is fmpy, libcosimpy, ecospy"):
        hosts.open(ssp, "ecos")
    with pytest.raises(SspError, match="no variant 'warm'; it has nominal, cold, degraded"):
        hosts.open(ssp, "fmpy", "warm")
    with pytest.raises(SspError, match="must be above 0"):
        hosts.open(ssp, "fmpy", step=0.0)
    spoilt = edited("resources/nominal_fin1.ssv", 'name="motor.resistance"', 'name="motor.resistence"')
    with pytest.raises(SspError, match=r"did you mean motor\.resistance"):
        hosts.open(spoilt, "fmpy")
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


def test_an_fmu_of_other_platforms(ssp: Path, tmp_path: Path) -> None:
    contents, stripped = read_archive(ssp), BytesIO()
    with zipfile.ZipFile(BytesIO(contents["resources/EMCAS.fmu"])) as unit, zipfile.ZipFile(stripped, "w") as target:
        for name in unit.namelist():
            target.writestr(name.replace("linux64", "other").replace("win64", "other"), unit.read(name))
    write_archive({**contents, "resources/EMCAS.fmu": stripped.getvalue()}, tmp_path / "other.ssp")
    with pytest.raises(SspError, match="has binaries for other only, and this is"):
        hosts.open(tmp_path / "other.ssp", "fmpy")


def test_absent_host(ssp: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "libcosimpy", None)
    with pytest.raises(SspError, match=r"libcosimpy cannot be loaded .*pip install libcosimpy"):
        hosts.open(ssp, "libcosimpy")


@pytest.mark.slow
def test_the_program_of_the_example(ssp: Path, tmp_path: Path) -> None:
    def call(*arguments: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run([sys.executable, ROOT / "examples/ssp_hosts/run.py", ssp, *arguments], cwd=tmp_path,
                              capture_output=True, text=True, timeout=60)

    done = call("--variant", "cold", "--set", "fin1.fin_command=0.1", "--set", "fin2.fin_command=0.2", "--set",
                "enable=true", "--output", "out.csv")
    assert done.returncode == 0, done.stderr
    found = trajectory((tmp_path / "out.csv").read_text(encoding="utf-8"))
    assert len(found["time"]) == 300
    # Within the overshoot of small steps, as above.
    assert [round(found[f"fin{i}.fin_angle"][-1], 1) for i in (1, 2, 3, 4)] == [0.1, 0.2, 0.0, 0.0]
    for arguments, said in ((("--host", "ecos"), "no host 'ecos'"), (("--set", "bus=1"), "no input 'bus'"),
                            (("--set", "supply_voltage"), "expected NAME=VALUE")):
        refused = call(*arguments)
        assert refused.returncode == 2
        assert said in refused.stderr


@pytest.mark.slow
def test_the_loop_of_the_readme(ssp: Path) -> None:
    language, text = recipes("../examples/ssp_hosts/README.md")["loop"]
    assert language == "python"
    program = text.replace('Path("EMCAS.ssp")', f"Path({str(ssp)!r})")
    done = subprocess.run([sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    time, angle = map(float, done.stdout.splitlines()[-1].split())
    assert time == pytest.approx(0.3)
    assert abs(angle - 0.1) < 0.02
