"""The sources in the FMU are those of its binaries, and build with the tools of others."""

from __future__ import annotations

import os
import shutil
import sysconfig
from pathlib import Path

import pytest
from fmpy.build import build_platform_binary

from .conftest import UNUSED, Host
from .host import difference, run, tool, trajectory

pytestmark = pytest.mark.fmu


@pytest.fixture(scope="module")
def rebuilt(native: Path, tmp_path_factory: pytest.TempPathFactory, linux: None) -> Path:
    """linux64/EMCAS.so as fmpy builds it: cmake, the FMU's buildDescription.xml, all warnings."""
    folder, build = tmp_path_factory.mktemp("sources") / "unit", tmp_path_factory.mktemp("cmake")
    shutil.copytree(native, folder, ignore=shutil.ignore_patterns("binaries"))
    with pytest.MonkeyPatch.context() as patch:
        # cmake comes with fmpy, into an environment that need not be activated.
        patch.setenv("PATH", os.pathsep.join([sysconfig.get_path("scripts"), os.environ["PATH"]]))
        for name in ("cmake", "make", "gcc", "g++"):  # fmpy's project asks for C++ too
            tool(name, name)
        build_platform_binary(folder, build, all_warnings=True, cmake_options={"CMAKE_C_FLAGS:STRING": "-Werror"})
    return folder / "binaries" / "linux64" / "EMCAS.so"


@pytest.mark.slow
@pytest.mark.parametrize("encoder", ["0", "1"])
def test_fmpy_builds_the_same(rebuilt: Path, executable: Path, loading: Host, encoder: str) -> None:
    """The same C library's functions on the same doubles. 1e-12 is for last bits grown over 0.3 s, of constants one
    compiler folds and the other leaves to the library; neither contracts or reassociates."""
    shipped = trajectory(loading("plain", encoder))
    found = trajectory(run([executable, rebuilt, UNUSED, "plain", encoder]))
    assert difference(shipped, found) < 1e-12
