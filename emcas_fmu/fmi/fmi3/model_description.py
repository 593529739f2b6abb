"""modelDescription.xml of FMI 3.0."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any
from xml.etree.ElementTree import Element

from ... import __version__
from .. import description
from ..description import element, limit, text
from ..interface import SINGLE, FmuInterface
from ..units import fmi_unit
from .arrays import CLOCK, TIME, Array, arrays


def _variable(reference: int, array: Array, starts: Sequence[Any]) -> Element:
    v = array.variable
    unit = v.unit if v.kind == "Real" else None
    displays = fmi_unit(unit).displays if unit else ()
    given = v.causality in ("input", "parameter")
    return element(array.kind, {
        "name": v.name, "valueReference": str(reference), "description": v.description, "causality": v.causality,
        "variability": v.variability, "initial": "calculated" if v.causality == "output" else None,
        "declaredType": description.type_name(v) if v.items else None, "unit": unit,
        "displayUnit": displays[0][0] if displays else None, "min": limit(v.minimum), "max": limit(v.maximum),
        "nominal": None if v.nominal is None else text(v.nominal),
        "start": " ".join(text(starts[place]) for place in array.places) if given else None,
    }, (element("Dimension", {"start": str(n)}) for n in array.dimensions))


def _variables(unit: FmuInterface, starts: Sequence[Any], clock: bool) -> Iterator[Element]:
    listed = arrays(unit)
    for reference, array in enumerate(listed):
        yield _variable(reference, array, starts)
    yield _variable(len(listed), Array(TIME, 0), starts)
    if clock:
        yield element("Clock", {
            "name": CLOCK, "valueReference": str(len(listed) + 1), "causality": "input", "variability": "discrete",
            "description": "ticks when the controllers sample (of fin 1, where sample times differ); they need no tick",
            "intervalVariability": "fixed"})


def _type_definitions(unit: FmuInterface) -> list[Element]:
    types = {description.type_name(v): v for v in unit.variables if v.items}
    return [element("EnumerationType", {"name": name}, (
        element("Item", {"name": item, "value": str(value), "description": meaning})
        for value, (item, meaning) in enumerate(v.items, 1))) for name, v in types.items()]


def _structure(unit: FmuInterface) -> Element:
    """Return what each output depends on: of an array what any of its elements does."""
    listed = arrays(unit)
    names = [v.name for v in unit.variables]
    reference = {names[place]: i for i, array in enumerate(listed) for place in array.places}
    direct = description.dependencies(unit)
    parameters = [i for i, array in enumerate(listed) if array.variable.causality == "parameter"]

    def unknown(tag: str, i: int, others: Iterable[int]) -> Element:
        needed = {reference[name] for place in listed[i].places for name in direct.get(names[place], ())} | {*others}
        return element(tag, {"valueReference": str(i), "dependencies": " ".join(map(str, sorted(needed))),
                             "dependenciesKind": " ".join(["dependent"] * len(needed))})

    outputs = [i for i, array in enumerate(listed) if array.variable.causality == "output"]
    return element("ModelStructure", {}, [
        *(unknown("Output", i, ()) for i in outputs), *(unknown("InitialUnknown", i, parameters) for i in outputs)])


def model_description(starts: Sequence[Any], guid: str, *, options: Mapping[str, str], tool: str,
                      source_files: Sequence[str] = (), unit: FmuInterface = SINGLE, clock: bool = False) -> Element:
    """Return the fmiModelDescription element; `options` are attributes of its CoSimulation element.

    Source files are named by buildDescription.xml alone in FMI 3.0.
    """
    del source_files
    types = [element("TypeDefinitions", {}, _type_definitions(unit))]
    return element("fmiModelDescription", {
        "fmiVersion": "3.0", "modelName": unit.model, "instantiationToken": guid,
        "description": description.describe(unit), "version": __version__, "license": "MIT", "generationTool": tool,
        "variableNamingConvention": "structured"}, [
            element("CoSimulation", {"modelIdentifier": unit.model, **options}),
            description.unit_definitions(unit),
            *(types if len(types[0]) else ()),
            description.log_categories(),
            description.default_experiment(),
            element("ModelVariables", {}, _variables(unit, starts, clock)),
            _structure(unit)])
