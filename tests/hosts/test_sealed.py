"""A step of the native FMU allocates no memory and makes no system call, under Linux's strict seccomp mode."""

from __future__ import annotations

import signal
import subprocess
from collections.abc import Callable
from pathlib import Path

import fmpy
import pytest

from .conftest import unpack
from .host import FMI_HEADERS, HERE, STRICT, run, table, tool

pytestmark = pytest.mark.fmu
Sealed = Callable[..., dict[str, str]]


@pytest.fixture(scope="module", params=["fmi2-1", "fmi2-4", "fmi3-1", "fmi3-4"])
def sealed(request: pytest.FixtureRequest, shipped_unit: Callable[..., Path],
           tmp_path_factory: pytest.TempPathFactory, linux: None) -> Sealed:
    """Function that runs steps of an FMU under seccomp, if requested with a forbidden action in each step."""
    version, fins = request.param[3], int(request.param[-1])
    folder, gcc = tmp_path_factory.mktemp("sealed"), tool("gcc", "gcc")
    if fins == 1:
        unpacked: Path = request.getfixturevalue("native" if version == "2" else "unpacked3")
    else:
        unpacked = unpack(shipped_unit(fins=fins, fmi=version), folder / "unpacked")
    (library,) = (unpacked / "binaries" / ("linux64" if version == "2" else "x86_64-linux")).iterdir()
    host = folder / "host"
    done = subprocess.run([gcc, *STRICT, "-O1", *(["-DFMI3"] if version == "3" else []), f"-I{FMI_HEADERS}",
                           str(HERE / "sealed.c"), "-o", str(host), "-rdynamic", "-ldl", "-lm"],
                          capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    description = fmpy.read_model_description(str(unpacked))
    reference = {v.name: str(v.valueReference) for v in description.modelVariables}
    forms = ["{}"] if fins == 1 else ["fins.{}"] if version == "3" else [f"fin[{k}].{{}}" for k in range(1, fins + 1)]
    variables = [",".join(reference[form.format(name)] for form in forms)
                 for name in ("fin_command", "aero_torque", "fin_angle")]

    def call(action: str = "none", code: int = 0) -> dict[str, str]:
        return table(run([host, library, description.guid, str(fins), *variables, action], code=code))

    return call


def test_steps_make_no_system_calls_and_allocate_nothing(sealed: Sealed, request: pytest.FixtureRequest) -> None:
    results = sealed()
    assert (results["allocations"], results["bad"]) == ("0", "0")
    assert float(results["largest"]) * 1e-6 > 0.2
    # Only FMI 3.0 reports events to the host.
    assert (int(results["events"]) > 10) == ("fmi3" in request.node.callspec.id)


def test_system_call_and_allocation_would_be_detected(sealed: Sealed) -> None:
    sealed("call", code=-signal.SIGKILL)
    assert sealed("allocate")["allocations"] == "1000"
