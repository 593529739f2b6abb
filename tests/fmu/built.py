"""FMUs of one parameter set from both back ends."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any

from emcas_fmu.fmi import python
from emcas_fmu.fmi.fmi2.slave import Slave
from emcas_fmu.fmi.interface import FmuInterface, start_values
from emcas_fmu.fmi.package import build
from emcas_fmu.parameters import ParameterSet
from emcas_fmu.runtime import codegen
from emcas_fmu.runtime.compiler import local_platform
from emcas_fmu.trace.python_source import python_source


def both(parameters: ParameterSet, folder: Path, fins: int = 1) -> Mapping[str, Path]:
    """Their files by back end, the native one for this platform; without references, which take long to make."""
    local = local_platform()
    assert local is not None
    return {"python": build(parameters, folder / "python.fmu", fins=fins, references=False).path,
            "native": build(parameters, folder / "native.fmu", "native", [local.name], fins=fins,
                            references=False).path}


@cache
def _programs(unit: FmuInterface) -> tuple[dict[str, Any], dict[str, Any]]:
    """Its kernel and its checks, run as the unit's modules."""
    kernel: dict[str, Any] = {}
    checks: dict[str, Any] = {}
    exec(codegen.source(unit.fins > 1, unit.kind, unit.spelt), kernel)
    exec(python_source(codegen.traced_rules(unit.kind), "Rules", unit.spelt), checks)
    return kernel, checks


def slave_class(unit: FmuInterface, sets: Sequence[Mapping[str, Any]]) -> type[Slave]:
    """The Python unit's class in this process, on the package's own modules; `sets` are the fins' values."""
    kernel, checks = _programs(unit)
    return type("Local", (Slave,), {
        "make": staticmethod(kernel["make"]), "make_checks": staticmethod(checks["make"]),
        **python.slave_attributes(unit, start_values(unit, sets), "{guid}")})
