"""modelDescription.xml of FMI 2.0."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any
from xml.etree.ElementTree import Element

from ... import __version__
from ...variables import Variable
from .. import description
from ..description import element, limit, text
from ..interface import SINGLE, FmuInterface
from ..units import fmi_unit

_INITIAL = {"output": "calculated", "parameter": "exact"}


def _scalar(reference: int, v: Variable, start: Any) -> Element:
    unit = v.unit if v.kind == "Real" else None
    displays = fmi_unit(unit).displays if unit else ()
    typed = element(v.kind, {
        "declaredType": description.type_name(v) if v.items else None, "unit": unit,
        "displayUnit": displays[0][0] if displays else None, "min": limit(v.minimum), "max": limit(v.maximum),
        "nominal": None if v.nominal is None else text(v.nominal),
        "start": None if v.causality == "output" else text(start)})
    return element("ScalarVariable", {
        "name": v.name, "valueReference": str(reference), "description": v.description, "causality": v.causality,
        "variability": v.variability, "initial": _INITIAL.get(v.causality)}, [typed])


def _type_definitions(unit: FmuInterface) -> list[Element]:
    types = {description.type_name(v): v for v in unit.variables if v.items}
    return [element("SimpleType", {"name": name}, [element("Enumeration", {}, (
        element("Item", {"name": item, "value": str(value), "description": meaning})
        for value, (item, meaning) in enumerate(v.items, 1)))]) for name, v in types.items()]


def _structure(unit: FmuInterface) -> Element:
    def unknowns(tag: str, dependencies: Mapping[str, tuple[str, ...]]) -> Element:
        """Return an element of all outputs; their dependence on what they list has no particular structure."""
        return element(tag, {}, (element("Unknown", {
            "index": str(unit.reference[v.name] + 1),
            "dependencies": " ".join(str(unit.reference[name] + 1) for name in dependencies[v.name])})
            for v in unit.outputs))

    return element("ModelStructure", {}, [
        unknowns("Outputs", description.dependencies(unit)),
        unknowns("InitialUnknowns", description.initial_dependencies(unit))])


def model_description(starts: Sequence[Any], guid: str, *, options: Mapping[str, str], tool: str,
                      source_files: Sequence[str] = (), unit: FmuInterface = SINGLE) -> Element:
    """Return the fmiModelDescription element; `options` are attributes of its CoSimulation element."""
    files = [element("SourceFiles", {}, (element("File", {"name": name}) for name in source_files))]
    types = [element("TypeDefinitions", {}, _type_definitions(unit))]
    return element("fmiModelDescription", {
        "fmiVersion": "2.0", "modelName": unit.model, "guid": guid, "description": description.describe(unit),
        "version": __version__, "license": "MIT", "generationTool": tool, "variableNamingConvention": "structured"}, [
            element("CoSimulation", {"modelIdentifier": unit.model, **options}, files if source_files else ()),
            description.unit_definitions(unit),
            *(types if len(types[0]) else ()),
            description.log_categories(),
            description.default_experiment(),
            element("ModelVariables", {}, (_scalar(reference, v, start) for reference, (v, start) in enumerate(
                zip(unit.variables, starts, strict=True)))),
            _structure(unit)])
