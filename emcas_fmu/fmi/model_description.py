"""modelDescription.xml of FMI 2.0 and 3.0."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from math import isfinite
from types import MappingProxyType
from typing import Any
from xml.etree.ElementTree import Element

from pythonfmu import Fmi2Slave

from .. import __version__
from ..units import factor
from ..variables import Variable
from .description import dependencies, describe, element, initial_dependencies, text, type_name, types
from .fmi3.arrays import CLOCK, KINDS, Array
from .format import Format
from .interface import FmuInterface
from .units import DIFFERENCES, default_display, display, fmi_unit, quantity

STEP_SIZE, STOP_TIME = 1e-3, 1.0  # s
# Relative tolerance for a host's solvers; it does not affect the FMU.
TOLERANCE = 1e-4

_INITIAL = {"output": "calculated", "parameter": "exact"}


def model_description(fmi: Format, interface: FmuInterface, starts: Sequence[Any], guid: str, *,
                      options: Mapping[str, str] = MappingProxyType({}),
                      about: Mapping[str, str] = MappingProxyType({}), sources: bool = False) -> Element:
    """Return the fmiModelDescription element of an interface whose variables have the start values `starts`.

    `options` are attributes of its CoSimulation element, `about` of the root. With `sources` an element of FMI 2.0
    names the file to compile; FMI 3.0 has it in buildDescription.xml.
    """
    files = [element("SourceFiles", {}, [element("File", {"name": fmi.main})])] if sources and not fmi.is_3 else []
    categories = ((name, words.replace("fmi2", f"fmi{fmi.version}"))
                  for name, words in Fmi2Slave.log_categories.items())
    return element("fmiModelDescription", {
        "fmiVersion": f"{fmi.version}.0", "modelName": interface.model,
        "instantiationToken" if fmi.is_3 else "guid": guid, "description": describe(interface),
        "version": __version__, **about, "variableNamingConvention": interface.spelling}, [
            element("CoSimulation", {"modelIdentifier": interface.identifier, **options}, files),
            unit_definitions(interface),
            element("TypeDefinitions", {}, (_type(fmi, name, v) for name, v in types(interface).items())),
            element("LogCategories", {}, (
                element("Category", {"name": name, "description": words}) for name, words in categories)),
            element("DefaultExperiment", {"startTime": "0", "stopTime": text(STOP_TIME), "tolerance": text(TOLERANCE),
                                          "stepSize": text(STEP_SIZE)}),
            element("ModelVariables", {}, (
                _variable(fmi, interface, reference, array, starts)
                for reference, array in fmi.references(interface))),
            element("ModelStructure", {}, _structure(fmi, interface))])


def unit_definitions(interface: FmuInterface) -> Element:
    """Return the UnitDefinitions element, the same in all versions."""
    shown: dict[str, set[str]] = {}
    for v in interface.variables:
        if v.kind == "Real" and v.name not in interface.actuator.hidden:
            shown.setdefault(v.unit, set()).update(filter(None, (display(v), default_display(quantity(v)))))
    return element("UnitDefinitions", {}, (_unit_definition(name, shown[name]) for name in sorted(shown)))


def _unit_definition(name: str, displays: Collection[str]) -> Element:
    unit = fmi_unit(name)
    base = element("BaseUnit", {
        **{base: str(exponent) for base, exponent in unit.exponents.items()},
        "factor": text(unit.factor) if unit.factor != 1.0 else None,
        "offset": text(unit.offset) if unit.offset else None})
    return element("Unit", {"name": name}, [base, *(
        element("DisplayUnit", {"name": shown, "factor": text(factor(name, shown))}) for shown in sorted(displays))])


def real_type(v: Variable) -> dict[str, str | None]:
    """Return the attributes of the type of a real variable."""
    name = quantity(v)
    return {"quantity": name, "unit": v.unit, "displayUnit": default_display(name) or None,
            "relativeQuantity": "true" if name in DIFFERENCES else None}


def typed_attributes(v: Variable) -> dict[str, str | None]:
    """Return the attributes of a variable that depend on its type, without the start value.

    A real variable repeats the unit of its type, for readers that ignore types.
    """
    unit, shown = (v.unit, display(v)) if v.kind == "Real" else (None, None)
    return {"declaredType": type_name(v), "unit": unit,
            "displayUnit": None if unit is None or shown == default_display(quantity(v)) else shown,
            "min": text(v.minimum) if isfinite(v.minimum) else None,
            "max": text(v.maximum) if isfinite(v.maximum) else None,
            "nominal": None if v.nominal is None else text(v.nominal)}


def _type(fmi: Format, name: str, v: Variable) -> Element:
    attributes = {} if v.items else real_type(v)
    items = [element("Item", {"name": item, "value": str(value), "description": meaning})
             for value, (item, meaning) in enumerate(v.items, 1)]
    if fmi.is_3:
        return element(f"{KINDS[v.kind]}Type", {"name": name, **attributes}, items)
    return element("SimpleType", {"name": name}, [element(v.kind, attributes, items)])


def _variable(fmi: Format, interface: FmuInterface, reference: int, array: Array, starts: Sequence[Any]) -> Element:
    v = array.variable
    if v == CLOCK:
        interval = starts[interface.reference[interface.name("controller.sample_time", 0)]]
        return element("Clock", {
            "name": v.name, "valueReference": str(reference), "causality": v.causality, "variability": v.variability,
            "description": v.description, "intervalVariability": "fixed", "intervalDecimal": text(interval)})
    start = " ".join(text(starts[i]) for i in array.indices) if v.causality in ("input", "parameter") else None
    typed = {**typed_attributes(v), "start": start}
    common = {"name": interface.spelt(v.name), "valueReference": str(reference),
              "description": interface.respelt(v.description), "causality": v.causality, "variability": v.variability}
    if not fmi.is_3:
        return element("ScalarVariable", {**common, "initial": _INITIAL.get(v.causality)}, [element(v.kind, typed)])
    return element(array.kind, {**common, "initial": "calculated" if v.causality == "output" else None, **typed},
                   (element("Dimension", {"start": str(n)}) for n in array.dimensions))


def _structure(fmi: Format, interface: FmuInterface) -> Iterable[Element]:
    """Return the elements with the dependencies of each output; an array has those of all its elements."""
    outputs = [array for array in fmi.variables(interface) if array.variable.causality == "output"]
    names = [v.name for v in interface.variables]
    reference = {names[i]: str(k) for k, array in enumerate(fmi.variables(interface), 1)
                 for i in array.indices}

    def unknowns(tag: str, of: Mapping[str, Collection[str]]) -> Iterator[Element]:
        for array in outputs:
            needed = {reference[name] for i in array.indices for name in of[names[i]]}
            yield element(tag, {"valueReference" if fmi.is_3 else "index": reference[names[array.first]],
                                "dependencies": " ".join(sorted(needed, key=int))})

    direct, initial = dependencies(interface), initial_dependencies(interface)
    if fmi.is_3:
        return (*unknowns("Output", direct), *unknowns("InitialUnknown", initial))
    return (element("Outputs", {}, unknowns("Unknown", direct)),
            element("InitialUnknowns", {}, unknowns("Unknown", initial)))
