"""The variables and units of an FMU in an archive."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from io import BytesIO
from math import inf
from typing import Any

from fmpy import read_model_description

from ..support.archives import reading
from .schema import SspError
from .units import BASES, Unit

Value = float | int | bool | str
_KINDS = {"Real": "Real", "Float32": "Real", "Float64": "Real", "Boolean": "Boolean", "String": "String",
          "Enumeration": "Enumeration", "Binary": "Binary"}


@dataclass(frozen=True)
class Port:
    """A variable: its type by SSP's names, causality, unit (empty if none), limits and start value as text."""

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


def typed(kind: str, text: str) -> Value:
    """Return a value of one of SSP's types from its text. Raises ValueError if it is not of that type."""
    if kind == "Boolean":
        if text not in ("true", "false", "1", "0"):
            raise ValueError(f"{text!r} is neither true nor false")
        return text in ("true", "1")
    if kind == "Integer":
        return int(text)
    return float(text) if kind == "Real" else text


def read_interface(content: bytes, name: str) -> Interface:
    """Return the interface of an FMU file. Raises SspError if it is none."""
    with reading(content, name, "an FMU", SspError):
        pass
    try:
        description = read_model_description(BytesIO(content), validate=False)
        units = {u.name: Unit.of({base: getattr(u.baseUnit, base) for base in (*BASES, "factor", "offset")})
                 for u in description.unitDefinitions if u.baseUnit is not None}
        ports = {v.name: _port(v) for v in description.modelVariables}
    except Exception as error:  # fmpy raises what its parsers raise: of zipfile, lxml, float and its own
        raise SspError(f"{name}: is not an FMU that can be read: {error}") from error
    if description.fmiVersion != "2.0":
        raise SspError(f"{name}: is of FMI {description.fmiVersion}; hosts of SSP 1.0 know FMUs of FMI 2.0: build "
                       "it without --fmi 3")
    return Interface(description.modelName, str(description.guid), ports, units)


def _port(v: Any) -> Port:
    kind = _KINDS.get(v.type, "Integer")
    unit = v.unit or getattr(v.declaredType, "unit", None) or ""
    settable = v.causality in ("input", "parameter", "structuralParameter") or (
        v.initial in ("exact", "approx") and v.variability != "constant")

    def limit(attribute: str, otherwise: float) -> float:
        texts = [getattr(holder, attribute, None) for holder in (v, v.declaredType) if kind in ("Real", "Integer")]
        return next((float(text) for text in texts if text is not None), otherwise)

    start = v.start[0] if isinstance(v.start, list) and v.start else v.start
    if start is not None:
        start = str(start).lower() if kind == "Boolean" else str(start)
    return Port(v.name, kind, v.causality or "local", settable, unit, limit("min", -inf), limit("max", inf), start)
