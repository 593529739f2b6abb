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


def _scalar(interface: FmuInterface, reference: int, v: Variable, start: Any) -> Element:
    typed = element(v.kind, {
        **description.typed_attributes(v), "start": None if v.causality == "output" else text(start)})
    return element("ScalarVariable", {
        "name": interface.spelt(v.name), "valueReference": str(reference),
        "description": interface.respelt(v.description), "causality": v.causality,
        "variability": v.variability, "initial": _INITIAL.get(v.causality)}, [typed])


def _simple_type(name: str, v: Variable) -> Element:
    return element("SimpleType", {"name": name}, [
        element("Real", description.real_type(v)) if v.kind == "Real" else element(
            "Enumeration", {}, description.enumeration_items(v))])


def _structure(interface: FmuInterface) -> Element:
    def unknowns(tag: str, dependencies: Mapping[str, tuple[str, ...]]) -> Element:
        """Return an element with the dependencies of all outputs."""
        return element(tag, {}, (element("Unknown", {
            "index": str(interface.reference[v.name] + 1),
            "dependencies": " ".join(str(interface.reference[name] + 1) for name in dependencies[v.name])})
            for v in interface.outputs))

    return element("ModelStructure", {}, [
        unknowns("Outputs", description.dependencies(interface)),
        unknowns("InitialUnknowns", description.initial_dependencies(interface))])


def model_description(starts: Sequence[Any], guid: str, *, options: Mapping[str, str] = MappingProxyType({}),
                      about: Mapping[str, str] = MappingProxyType({}), source_files: Sequence[str] = (),
                      interface: FmuInterface = SINGLE) -> Element:
    """Return the fmiModelDescription element; `options` are attributes of its CoSimulation element, `about` its own."""
    files = [element("SourceFiles", {}, (element("File", {"name": name}) for name in source_files))]
    types = (_simple_type(name, v) for name, v in description.types(interface).items())
    return element("fmiModelDescription", {
        "fmiVersion": "2.0", "modelName": interface.model, "guid": guid, "description": description.describe(interface),
        "version": __version__, **about, "variableNamingConvention": interface.spelling}, [
            element("CoSimulation", {"modelIdentifier": interface.model, **options}, files if source_files else ()),
            description.unit_definitions(interface),
            element("TypeDefinitions", {}, types),
            description.log_categories(2),
            description.default_experiment(),
            element("ModelVariables", {}, (
                _scalar(interface, reference, v, start)
                for reference, (v, start) in enumerate(zip(interface.variables, starts, strict=True)))),
            _structure(interface)])
