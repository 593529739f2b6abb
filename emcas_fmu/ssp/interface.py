"""What an FMU in an archive says of itself."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from io import BytesIO
from math import inf
from typing import Any

from fmpy import read_model_description

from .schema import SspError
from .units import BASES, Unit

_KINDS = {"Real": "Real", "Float32": "Real", "Float64": "Real", "Boolean": "Boolean", "String": "String",
          "Enumeration": "Enumeration", "Binary": "Binary"}


@dataclass(frozen=True)
class Port:
    """A variable: its type by SSP's names, causality, unit (empty if none), limits and start value as written."""

    name: str
    kind: str
    causality: str
    settable: bool
    unit: str
    minimum: float
    maximum: float
    start: str | None


@dataclass(frozen=True)
class Interface:
    """An FMU: name, GUID, variables and units by name."""

    model: str
    guid: str
    ports: Mapping[str, Port]
    units: Mapping[str, Unit]

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of the inputs."""
        return tuple(p.name for p in self.ports.values() if p.causality == "input")


def read_interface(content: bytes, name: str) -> Interface:
    """The interface of an FMU file. Raises SspError if it is none."""
    try:
        description = read_model_description(BytesIO(content), validate=False)
        units = {u.name: Unit.of(u.name, {base: getattr(u.baseUnit, base) for base in (*BASES, "factor", "offset")})
                 for u in description.unitDefinitions if u.baseUnit is not None}
        ports = {v.name: _port(v) for v in description.modelVariables}
    except Exception as error:  # fmpy raises what its parsers raise: of zipfile, lxml, float and its own
        raise SspError(f"{name}: is not an FMU that can be read: {error}") from error
    return Interface(description.modelName, str(description.guid), ports, units)


def _port(v: Any) -> Port:
    kind = _KINDS.get(v.type, "Integer")
    declared = v.declaredType
    unit = v.unit or (declared.unit if declared is not None else None) or ""
    settable = v.causality in ("input", "parameter", "structuralParameter") or (
        v.initial in ("exact", "approx") and v.variability != "constant")

    def limit(attribute: str, otherwise: float) -> float:
        written = getattr(v, attribute) if getattr(v, attribute) is not None else getattr(declared, attribute, None)
        return otherwise if written is None or kind not in ("Real", "Integer") else float(written)

    start = v.start[0] if isinstance(v.start, list) and v.start else v.start
    return Port(v.name, kind, v.causality or "local", settable, unit, limit("min", -inf), limit("max", inf),
                None if start is None else str(start))
