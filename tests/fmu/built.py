"""FMUs of one parameter set from both back ends."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from emcas_fmu.compiler import local_platform
from emcas_fmu.fmi.fins import FinsSlave
from emcas_fmu.fmi.package import build
from emcas_fmu.fmi.slave import Slave, Table
from emcas_fmu.kernels import program
from emcas_fmu.ops.python_source import python_source
from emcas_fmu.parameters import ParameterSet
from emcas_fmu.unit import Unit, start_values


def both(parameters: ParameterSet, folder: Path, fins: int = 1) -> Mapping[str, Path]:
    """Their files by back end, the native one for this platform."""
    local = local_platform()
    assert local is not None
    return {"python": build(parameters, folder / "python.fmu", fins=fins).path,
            "native": build(parameters, folder / "native.fmu", "native", [local.name], fins=fins).path}


def slave_class(unit: Unit, sets: Sequence[Mapping[str, Any]]) -> type[Slave]:
    """The Python unit's class in this process, on the package's own modules; `sets` are the fins' values."""
    actuator, here, several = unit.actuator, program.places(unit.kind), unit.fins > 1
    rows = tuple((v.name, "Integer" if v.items else v.kind, v.causality, v.variability, v.minimum, v.maximum)
                 for v in unit.variables)
    places = tuple((*(row[i] for i in here.direct), None if here.supply is None else row[here.supply],
                    *(row[i] for i in here.further)) for row in unit.places)
    checks = python_source(program.traced_rules(unit.kind), "Rules")
    space: dict[str, Any] = {}
    exec(checks, space)
    members: dict[str, Any] = {
        "make": staticmethod(program.make(several, unit.kind)), "make_checks": staticmethod(space["make"]),
        "rules": tuple((rule.message, rule.scanned) for rule in actuator.all_rules),
        "table": Table(rows, start_values(unit, sets), "{guid}"), "places": places, "sizes": program.sizes(actuator)}
    if several:
        outputs = [v.name for v in actuator.outputs]
        members |= {"names": tuple(v.name for v in actuator.parameters),
                    "power": outputs.index(actuator.supply.power.name) if actuator.supply else None}
    return type("Local", (FinsSlave if several else Slave,), members)
