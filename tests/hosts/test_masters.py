"""The FMUs as slaves of other co-simulation masters, in a process of their own."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from .host import HERE, Trajectory, difference, missing, script, tool, trajectory
from .masters import ABSENT, STEPS

pytestmark = pytest.mark.fmu
NEEDS = {"libcosimpy": "pip install libcosimpy", "ecospy": "pip install ecospy; Debian: apt-get install libtbb12"}


@pytest.fixture(params=["fmu", "native_fmu"])
def unit(request: pytest.FixtureRequest) -> Path:
    """The FMU of one of the back ends."""
    found: Path = request.getfixturevalue(request.param)
    return found


def test_back_ends_agree(fmu: Path, native_fmu: Path) -> None:
    """The same equations on the same doubles through the same C library: 1e-12 as for another compiler's last bits."""
    first, second = (trajectory(script("masters.py", "fmpy", unit, "1")) for unit in (fmu, native_fmu))
    assert difference(first, second) < 1e-12


def response(master: str, unit: Path, encoder: str) -> Trajectory:
    """What a master makes of an FMU."""
    if master == "ecospy":
        tool("unzip", "unzip")  # how ecos opens an FMU
    done = subprocess.run([sys.executable, HERE / "masters.py", master, unit, encoder], capture_output=True, text=True,
                          timeout=60)
    if done.returncode == ABSENT:
        missing(f"{master} cannot be loaded ({NEEDS[master]}): {done.stderr.strip()}")
    assert done.returncode == 0, done.stdout[-1000:] + done.stderr[-4000:]
    return trajectory(done.stdout)


@pytest.mark.parametrize("encoder", ["0", "1"])
@pytest.mark.parametrize("master", ["libcosimpy", "ecospy"])
def test_same_trajectory_as_in_fmpy(master: str, unit: Path, encoder: str) -> None:
    """No output differs by a step: both masters set inputs before the step they are for and read outputs after it.

    They count time their own way (nanoseconds, a running sum), to within 1e-15 s of fmpy's; the
    fastest output changes by 1e6 a second, hence by 1e-9 at most.
    """
    found = response(master, unit, encoder)
    expected = trajectory(script("masters.py", "fmpy", unit, encoder))
    assert len(found["time"]) == STEPS
    assert abs(found["fin_angle"][-1] - 0.2) < 0.02  # at its command, but for what is left of an overshoot
    assert difference(expected, found) < 1e-9
    late = {name: values[1:] for name, values in expected.items()}
    assert difference(late, {name: values[:-1] for name, values in found.items()}) > 1e-3  # so would a step's delay
