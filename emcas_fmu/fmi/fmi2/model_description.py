"""modelDescription.xml of FMI 2.0."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any
from xml.etree.ElementTree import Element

from ... import __version__
from ...variables import Variable
from .. import description
from ..description import element, text
from ..interface import SINGLE, FmuInterface

_INITIAL = {"output": "calculated", "parameter": "exact"}


def _scalar(unit: FmuInterface, reference: int, v: Variable, start: Any) -> Element:
    typed = element(v.kind, {
        **description.typed_attributes(v), "start": None if v.causality == "output" else text(start)})
    return element("ScalarVariable", {
        "name": unit.spelt(v.name), "valueReference": str(reference), "description": unit.respelt(v.description),
        "causality": v.causality, "variability": v.variability, "initial": _INITIAL.get(v.causality)}, [typed])


def _simple_type(name: str, v: Variable) -> Element:
    return element("SimpleType", {"name": name}, [
        element("Real", description.real_type(v)) if v.kind == "Real" else element(
            "Enumeration", {}, description.enumeration_items(v))])


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


def model_description(starts: Sequence[Any], guid: str, *, options: Mapping[str, str] = MappingProxyType({}),
                      about: Mapping[str, str] = MappingProxyType({}), source_files: Sequence[str] = (),
                      unit: FmuInterface = SINGLE) -> Element:
    """Return the fmiModelDescription element; `options` are attributes of its CoSimulation element, `about` its own."""
    files = [element("SourceFiles", {}, (element("File", {"name": name}) for name in source_files))]
    types = (_simple_type(name, v) for name, v in description.types(unit).items())
    return element("fmiModelDescription", {
        "fmiVersion": "2.0", "modelName": unit.model, "guid": guid, "description": description.describe(unit),
        "version": __version__, **about, "variableNamingConvention": unit.spelling}, [
            element("CoSimulation", {"modelIdentifier": unit.model, **options}, files if source_files else ()),
            description.unit_definitions(unit),
            element("TypeDefinitions", {}, types),
            description.log_categories(2),
            description.default_experiment(),
            element("ModelVariables", {}, (_scalar(unit, reference, v, start) for reference, (v, start) in enumerate(
                zip(unit.variables, starts, strict=True)))),
            _structure(unit)])
