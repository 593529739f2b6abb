"""A step of the native FMU allocates nothing and asks the system for nothing: under Linux's strict seccomp."""

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
    """Runs the steps of an FMU of a version and number of fins, with a forbidden call if requested."""
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

    def call(deed: str = "none", code: int = 0) -> dict[str, str]:
        return table(run([host, library, description.guid, str(fins), *variables, deed], code=code))

    return call


def test_steps_ask_the_system_for_nothing(sealed: Sealed, request: pytest.FixtureRequest) -> None:
    found = sealed()
    assert (found["allocations"], found["bad"]) == ("0", "0")
    assert float(found["largest"]) * 1e-6 > 0.2
    # Only FMI 3.0 shows a host its events.
    assert (int(found["events"]) > 10) == ("fmi3" in request.node.callspec.id)


def test_what_is_forbidden_would_be_seen(sealed: Sealed) -> None:
    sealed("call", code=-signal.SIGKILL)
    assert sealed("allocate")["allocations"] == "1000"
