"""FMUs of one parameter set from both back ends, and those that tests need only to run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from emcas_fmu.fmi import figures, python
from emcas_fmu.fmi.fmi2.slave import Slave
from emcas_fmu.fmi.interface import FmuInterface, start_values
from emcas_fmu.fmi.package import build
from emcas_fmu.parameters import ParameterSet
from emcas_fmu.runtime import codegen, compiler
from emcas_fmu.trace.python_source import python_source


def both(parameters: ParameterSet, folder: Path, fins: int = 1) -> Mapping[str, Path]:
    """Their files by back end, the native one lean; without references and pictures, which take long."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(figures, "response_pictures", lambda _: ())
        python_unit = build(parameters, folder / "python.fmu", "python", fins=fins, references=False).path
    return {"python": python_unit, "native": lean(parameters, folder / "native.fmu", fins=fins)}


def lean(parameters: ParameterSet, path: Path, **options: Any) -> Path:
    """Its native file for this platform with no more than a run needs: not optimised, no pictures, no references.

    The bits of its results are those of an optimised one.
    """
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(compiler, "FLAGS", (*compiler.FLAGS, "-O0"))
        patch.setattr(figures, "response_pictures", lambda _: ())
        return build(parameters, path, "native", _local(), references=False, **options).path


def _local() -> list[str]:
    local = compiler.local_platform()
    assert local is not None
    return [local.name]


@cache
def _programs(unit: FmuInterface) -> tuple[dict[str, Any], dict[str, Any], dict[str, Any]]:
    """Its kernel, its checks and those of its line, run as the unit's modules."""
    kernel: dict[str, Any] = {}
    checks: dict[str, Any] = {}
    line_checks: dict[str, Any] = {"make": None}
    exec(codegen.source(unit.fins > 1, unit.kind, unit.spelt), kernel)
    exec(python_source(codegen.traced_rules(unit.kind), "Rules", unit.spelt), checks)
    if unit.line and unit.line.rules:
        exec(python_source(codegen.traced_line_rules(unit.kind), "Rules", unit.spelt), line_checks)
    return kernel, checks, line_checks


def slave_class(unit: FmuInterface, sets: Sequence[Mapping[str, Any]]) -> type[Slave]:
    """The Python unit's class in this process, on the package's own modules; `sets` are the fins' values."""
    kernel, checks, line_checks = _programs(unit)
    return type("Local", (Slave,), {
        "make": staticmethod(kernel["make"]), "make_checks": staticmethod(checks["make"]),
        "make_line_checks": staticmethod(line_checks["make"]),
        **python.slave_attributes(unit, start_values(unit, sets), "{guid}")})
