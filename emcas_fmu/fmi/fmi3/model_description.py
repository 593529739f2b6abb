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


def _variable(unit: FmuInterface, reference: int, array: Array, starts: Sequence[Any]) -> Element:
    v = array.variable
    given = v.causality in ("input", "parameter")
    return element(array.kind, {
        "name": unit.spelt(v.name), "valueReference": str(reference), "description": unit.respelt(v.description),
        "causality": v.causality, "variability": v.variability,
        "initial": "calculated" if v.causality == "output" else None,
        **description.typed_attributes(v),
        "start": " ".join(text(starts[place]) for place in array.places) if given else None,
    }, (element("Dimension", {"start": str(n)}) for n in array.dimensions))


def _variables(unit: FmuInterface, starts: Sequence[Any], clock: bool) -> Iterator[Element]:
    listed = arrays(unit)
    for reference, array in enumerate(listed):
        yield _variable(unit, reference, array, starts)
    yield _variable(unit, len(listed), Array(TIME, 0), starts)
    if clock:
        yield element("Clock", {
            "name": CLOCK, "valueReference": str(len(listed) + 1), "causality": "input", "variability": "discrete",
            "description": "ticks when the controllers sample (of fin 1, where sample times differ); they need no tick",
            "intervalVariability": "fixed"})


def _type(name: str, v: Variable) -> Element:
    if v.kind == "Real":
        return element("Float64Type", {"name": name, **description.real_type(v)})
    return element("EnumerationType", {"name": name}, description.enumeration_items(v))


def _structure(unit: FmuInterface) -> Element:
    """Return what each output depends on: of an array what any of its elements does."""
    listed = arrays(unit)
    names = [v.name for v in unit.variables]
    reference = {names[place]: i for i, array in enumerate(listed) for place in array.places}

    def unknowns(tag: str, dependencies: Mapping[str, tuple[str, ...]]) -> Iterator[Element]:
        for i, array in enumerate(listed):
            if array.variable.causality == "output":
                needed = {reference[name] for place in array.places for name in dependencies[names[place]]}
                yield element(tag, {"valueReference": str(i), "dependencies": " ".join(map(str, sorted(needed)))})

    return element("ModelStructure", {}, [
        *unknowns("Output", description.dependencies(unit)),
        *unknowns("InitialUnknown", description.initial_dependencies(unit))])


def model_description(starts: Sequence[Any], guid: str, *, options: Mapping[str, str] = MappingProxyType({}),
                      about: Mapping[str, str] = MappingProxyType({}), unit: FmuInterface = SINGLE,
                      clock: bool = False) -> Element:
    """Return the fmiModelDescription element; `options` are attributes of its CoSimulation element, `about` its own."""
    return element("fmiModelDescription", {
        "fmiVersion": "3.0", "modelName": unit.model, "instantiationToken": guid,
        "description": description.describe(unit), "version": __version__, **about,
        "variableNamingConvention": unit.spelling}, [
            element("CoSimulation", {"modelIdentifier": unit.model, **options}),
            description.unit_definitions(unit),
            element("TypeDefinitions", {}, (_type(name, v) for name, v in description.types(unit).items())),
            description.log_categories(3),
            description.default_experiment(),
            element("ModelVariables", {}, _variables(unit, starts, clock)),
            _structure(unit)])
