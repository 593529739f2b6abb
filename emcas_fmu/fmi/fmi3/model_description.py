"""modelDescription.xml of FMI 3.0."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import Any
from xml.etree.ElementTree import Element

from ... import __version__
from ...variables import Variable
from .. import description
from ..description import element, text
from ..interface import SINGLE, FmuInterface
from .arrays import CLOCK, TIME, Array, arrays


def _variable(interface: FmuInterface, reference: int, array: Array, starts: Sequence[Any]) -> Element:
    v = array.variable
    has_start = v.causality in ("input", "parameter")
    return element(array.kind, {
        "name": interface.spelt(v.name), "valueReference": str(reference),
        "description": interface.respelt(v.description), "causality": v.causality, "variability": v.variability,
        "initial": "calculated" if v.causality == "output" else None,
        **description.typed_attributes(v),
        "start": " ".join(text(starts[i]) for i in array.indices) if has_start else None,
    }, (element("Dimension", {"start": str(n)}) for n in array.dimensions))


def _variables(interface: FmuInterface, starts: Sequence[Any], clock: bool) -> Iterator[Element]:
    listed = arrays(interface)
    for reference, array in enumerate(listed):
        yield _variable(interface, reference, array, starts)
    yield _variable(interface, len(listed), Array(TIME, 0), starts)
    if clock:
        yield element("Clock", {
            "name": CLOCK, "valueReference": str(len(listed) + 1), "causality": "input", "variability": "discrete",
            "description": "ticks when the controllers sample (of fin 1, where sample times differ); they need no tick",
            "intervalVariability": "fixed"})


def _type(name: str, v: Variable) -> Element:
    if v.kind == "Real":
        return element("Float64Type", {"name": name, **description.real_type(v)})
    return element("EnumerationType", {"name": name}, description.enumeration_items(v))


def _structure(interface: FmuInterface) -> Element:
    """Return the dependencies of each output; an array has those of all its elements."""
    listed = arrays(interface)
    names = [v.name for v in interface.variables]
    reference = {names[index]: i for i, array in enumerate(listed) for index in array.indices}

    def unknowns(tag: str, dependencies: Mapping[str, tuple[str, ...]]) -> Iterator[Element]:
        for i, array in enumerate(listed):
            if array.variable.causality == "output":
                needed = {reference[name] for index in array.indices for name in dependencies[names[index]]}
                yield element(tag, {"valueReference": str(i), "dependencies": " ".join(map(str, sorted(needed)))})

    return element("ModelStructure", {}, [
        *unknowns("Output", description.dependencies(interface)),
        *unknowns("InitialUnknown", description.initial_dependencies(interface))])


def model_description(starts: Sequence[Any], guid: str, *, options: Mapping[str, str] = MappingProxyType({}),
                      about: Mapping[str, str] = MappingProxyType({}), interface: FmuInterface = SINGLE,
                      clock: bool = False) -> Element:
    """Return the fmiModelDescription element; `options` are attributes of its CoSimulation element, `about` its own."""
    return element("fmiModelDescription", {
        "fmiVersion": "3.0", "modelName": interface.model, "instantiationToken": guid,
        "description": description.describe(interface), "version": __version__, **about,
        "variableNamingConvention": interface.spelling}, [
            element("CoSimulation", {"modelIdentifier": interface.model, **options}),
            description.unit_definitions(interface),
            element("TypeDefinitions", {}, (_type(name, v) for name, v in description.types(interface).items())),
            description.log_categories(3),
            description.default_experiment(),
            element("ModelVariables", {}, _variables(interface, starts, clock)),
            _structure(interface)])
