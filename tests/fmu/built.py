"""Build FMUs that a test only runs: without pictures and references, unoptimised."""

from __future__ import annotations

import zipfile
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from emcas_fmu.fmi import pictures, python
from emcas_fmu.fmi.fmi2.slave import Slave
from emcas_fmu.fmi.interface import FmuInterface, start_values
from emcas_fmu.fmi.package import BACKENDS, build
from emcas_fmu.parameters import ParameterSet
from emcas_fmu.runtime import codegen, compiler
from emcas_fmu.trace.python_source import python_source

from .host import Fmu


def both(parameters: ParameterSet, folder: Path, fins: int = 1) -> Mapping[str, Path]:
    """Return lean FMUs by back end."""
    return {backend: lean(parameters, folder / f"{backend}.fmu", backend, fins=fins) for backend in BACKENDS}


def lean(parameters: ParameterSet, path: Path, backend: str = "native", references: bool = False, **options: Any
         ) -> Path:
    """Return an FMU for this platform without pictures and references.

    A native one is compiled without optimisation; its results have the same bits.
    """
    local = compiler.local_platform()
    assert local is not None
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(compiler, "FLAGS", (*compiler.FLAGS, "-O0"))
        patch.setattr(pictures, "response_pictures", lambda _: ())
        return build(parameters, path, backend, [local.name] if backend == "native" else None, references=references,
                     **options).path


def unpacked(path: Path, folder: Path) -> Fmu:
    """Return the FMU unpacked in the folder, with its library loaded."""
    with zipfile.ZipFile(path) as archive:
        archive.extractall(folder)
    return Fmu(str(folder))


@cache
def _programs(interface: FmuInterface) -> dict[str, Any]:
    """Return the functions `make` of the modules in a Python FMU: kernel, parameter checks, checks of the supply."""
    kernel: dict[str, Any] = {}
    checks: dict[str, Any] = {}
    line_checks: dict[str, Any] = {"make": None}
    exec(codegen.source(interface.fins > 1, interface.kind, interface.spelt), kernel)
    exec(python_source(codegen.traced_rules(interface.kind), "Rules", interface.spelt), checks)
    if interface.line and interface.line.rules:
        exec(python_source(codegen.traced_line_rules(interface.kind), "Rules", interface.spelt), line_checks)
    return {"make": staticmethod(kernel["make"]), "make_checks": staticmethod(checks["make"]),
            "make_line_checks": staticmethod(line_checks["make"])}


def slave_class(interface: FmuInterface, sets: Sequence[Mapping[str, Any]]) -> type[Slave]:
    """Return the class of a Python FMU, run in this process; `sets` has the parameter values of each fin."""
    return type("Local", (Slave,), {
        **_programs(interface), **python.slave_attributes(interface, start_values(interface, sets), "{guid}")})
