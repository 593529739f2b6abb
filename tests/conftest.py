"""Fixtures shared by all tests."""

from __future__ import annotations

import os

# Before NumPy comes: a worker has a core, and threads of the linear algebra that wait for each other on cores that
# others use take a hundred times what these small matrices do. Workers and programs that tests start have it, too.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from emcas_fmu.compiler import local_platform
from emcas_fmu.fmi.package import build
from emcas_fmu.parameters import load_parameters
from emcas_fmu.runtime import compiled


def pytest_runtest_setup(item: pytest.Item) -> None:
    """Skip a test of a compiled kernel where none can be had; asked when the test is due, since it compiles one."""
    for mark in item.iter_markers("kernel"):
        if not compiled.available(*mark.args):
            pytest.skip("no C compiler")


@pytest.fixture(scope="session")
def values() -> Mapping[str, Any]:
    """The shipped parameters, flat, in the table's units."""
    return load_parameters().values


@pytest.fixture(scope="session")
def fmu(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """EMCAS.fmu of the shipped parameters."""
    return build(load_parameters(), tmp_path_factory.mktemp("fmu") / "EMCAS.fmu").path


@pytest.fixture(scope="session")
def native(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """EMCAS.fmu of the shipped parameters, native, for this platform."""
    local = local_platform()
    assert local is not None
    return build(load_parameters(), tmp_path_factory.mktemp("native") / "EMCAS.fmu", "native", [local.name]).path


@pytest.fixture(scope="session")
def native3(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """EMCAS.fmu of the shipped parameters in FMI 3.0, for this platform."""
    local = local_platform()
    assert local is not None
    return build(load_parameters(), tmp_path_factory.mktemp("native3") / "EMCAS.fmu", None, [local.name], fmi="3").path


@pytest.fixture(scope="session")
def units(fmu: Path, native: Path) -> Mapping[str, Path]:
    """Both FMUs by back end."""
    return {"python": fmu, "native": native}
