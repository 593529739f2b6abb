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


@dataclass(frozen=True)
class FmuVariable:
    """A variable of an FMU: type, causality, unit (nameless if it has none), limits, and start value as text."""

    name: str
    type: str
    causality: str
    settable: bool
    unit: Unit
    minimum: float
    maximum: float
    start: str | None


@dataclass(frozen=True)
class Interface:
    """An FMU: name, GUID and variables by name."""

    model: str
    guid: str
    variables: Mapping[str, FmuVariable]


def typed(kind: str, text: str) -> Value:
    """Return a value of a type of FMI 2.0 from its text. Raises ValueError if the text is not of that type."""
    if kind == "Boolean":
        if text not in ("true", "false", "1", "0"):
            raise ValueError(f"{text!r} is neither true nor false")
        return text in ("true", "1")
    if kind == "Integer":
        return int(text)
    return float(text) if kind == "Real" else text


def read_interface(content: bytes, name: str) -> Interface:
    """Return the interface of an FMU of FMI 2.0. Raises SspError, naming the file `name`, if it is not one."""
    with reading(content, name, "an FMU", SspError):
        pass
    try:
        description = read_model_description(BytesIO(content), validate=False)
        units = {u.name: Unit.defined(u.name, {a: getattr(u.baseUnit, a) for a in (*BASES, "factor", "offset")})
                 for u in description.unitDefinitions if u.baseUnit is not None}
        variables = {v.name: _variable(v, units) for v in description.modelVariables}
    except Exception as error:  # fmpy raises what its parsers raise: of zipfile, lxml, float and its own
        raise SspError(f"{name}: is not an FMU that can be read: {error}") from error
    if description.fmiVersion != "2.0":
        raise SspError(f"{name}: is of FMI {description.fmiVersion}; hosts of SSP 1.0 know FMUs of FMI 2.0: build "
                       "it without --fmi 3")
    return Interface(description.modelName, str(description.guid), variables)


def _variable(v: Any, units: Mapping[str, Unit]) -> FmuVariable:
    def limit(attribute: str, otherwise: float) -> float:
        text = getattr(v, attribute) or getattr(v.declaredType, attribute, None)
        return otherwise if text is None or v.type not in ("Real", "Integer") else float(text)

    start = str(v.start).lower() if v.type == "Boolean" and v.start is not None else v.start
    settable = v.causality in ("input", "parameter") or (
        v.initial in ("exact", "approx") and v.variability != "constant")
    unit = v.unit or getattr(v.declaredType, "unit", None) or ""
    return FmuVariable(v.name, v.type, v.causality or "local", settable, units.get(unit, Unit(unit)),
                       limit("min", -inf), limit("max", inf), start)
