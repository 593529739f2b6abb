"""modelDescription.xml and terminalsAndIcons.xml out of what the actuator declares."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from math import isfinite
from typing import Any
from xml.etree.ElementTree import Element, indent, tostring

from pythonfmu import Fmi2Slave

from .. import __version__
from ..actuators import fin_port
from ..runtime import codegen
from ..variables import Terminal, Variable
from .interface import MIXING, FmuInterface
from .units import fmi_unit

SINGLE = FmuInterface(1)
STEP_SIZE, STOP_TIME = 1e-3, 1.0

_INITIAL = {"output": "calculated", "parameter": "exact"}
_MIXED = tuple(v.name for v in MIXING)


def _dependencies(unit: FmuInterface) -> dict[str, tuple[str, ...]]:
    """Return for each output the inputs it depends on at once."""
    direct = codegen.direct_inputs(unit.kind)
    if unit.fins == 1:
        return dict(direct)
    of_fins = {unit.name(output, fin): (*(unit.name(i, fin) for i in inputs),
                                        *(_MIXED if "fin_command" in inputs else ()))
               for fin in range(unit.fins) for output, inputs in direct.items()}
    supply = unit.actuator.supply
    if supply is None or unit.line is None:
        return of_fins
    power = direct.get(supply.power.name, ())
    every = tuple(dict.fromkeys(unit.name(i, fin) for fin in range(unit.fins) for i in power))
    drawn = tuple(dict.fromkeys((supply.input.name, *every)))  # power over what the line gives
    shared = zip((v.name for v in unit.line_outputs), ((supply.input.name,), drawn, every), strict=True)
    return {**of_fins, **dict(shared)}


def _text(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    return str(value) if isinstance(value, int) else repr(float(value)).removesuffix(".0")


def _limit(value: float) -> str | None:
    return _text(value) if isfinite(value) else None


def element(tag: str, attributes: Mapping[str, str | None], children: Iterable[Element] = ()) -> Element:
    """Return an element with `children` and those of its `attributes` that are not None."""
    made = Element(tag, {name: value for name, value in attributes.items() if value is not None})
    made.extend(children)
    return made


def _scalar(reference: int, v: Variable, start: Any) -> Element:
    unit = v.unit if v.kind == "Real" else None
    displays = fmi_unit(unit).displays if unit else ()
    typed = element(v.kind, {
        "declaredType": _type_name(v) if v.items else None, "unit": unit,
        "displayUnit": displays[0][0] if displays else None, "min": _limit(v.minimum), "max": _limit(v.maximum),
        "nominal": None if v.nominal is None else _text(v.nominal),
        "start": None if v.causality == "output" else _text(start)})
    return element("ScalarVariable", {
        "name": v.name, "valueReference": str(reference), "description": v.description, "causality": v.causality,
        "variability": v.variability, "initial": _INITIAL.get(v.causality)}, [typed])


def _type_name(v: Variable) -> str:
    """Name of an enumeration's type, one for all fins; it must not be that of a variable (FMI 2.0.5, section 2.2.3)."""
    return v.name.rpartition("].")[2] + "_type"


def _type_definitions(unit: FmuInterface) -> list[Element]:
    types = {_type_name(v): v for v in unit.variables if v.items}
    return [element("SimpleType", {"name": name}, [element("Enumeration", {}, (
        element("Item", {"name": item, "value": str(value), "description": description})
        for value, (item, description) in enumerate(v.items, 1)))]) for name, v in types.items()]


def _unit_definition(name: str) -> Element:
    unit = fmi_unit(name)
    base = element("BaseUnit", {
        **{base: str(exponent) for base, exponent in unit.exponents.items()},
        "factor": _text(unit.factor) if unit.factor != 1.0 else None,
        "offset": _text(unit.offset) if unit.offset else None})
    return element("Unit", {"name": name}, [
        base, *(element("DisplayUnit", {"name": name, "factor": _text(factor)}) for name, factor in unit.displays)])


def _structure(unit: FmuInterface) -> Element:
    index = {name: i + 1 for name, i in unit.reference.items()}
    direct = _dependencies(unit)

    def unknown(output: str, parameters: Iterable[Variable]) -> Element:
        needed = sorted(index[name] for name in direct.get(output, ())) + [index[v.name] for v in parameters]
        return element("Unknown", {
            "index": str(index[output]), "dependencies": " ".join(map(str, needed)),
            "dependenciesKind": " ".join(["dependent"] * len(needed))})

    def initial(output: str) -> Element:
        """Return what an output's initial value follows from: all parameters, or those of its fin."""
        fin = output.partition(".")[0] if output.startswith("fin[") else ""
        return unknown(output, (v for v in unit.parameters if v.name.startswith(fin)))

    return element("ModelStructure", {}, [
        element("Outputs", {}, (unknown(v.name, ()) for v in unit.outputs)),
        element("InitialUnknowns", {}, (initial(v.name) for v in unit.outputs))])


def describe(unit: FmuInterface) -> str:
    """Return what the unit is, in a sentence."""
    line = f" on one {unit.line.name}" if unit.line else ""
    return unit.actuator.title + ("" if unit.fins == 1 else f"; {unit.fins} fins{line}")


def model_description(starts: Sequence[Any], guid: str, *, options: Mapping[str, str], tool: str,
                      source_files: Sequence[str] = (), unit: FmuInterface = SINGLE) -> Element:
    """Return the fmiModelDescription element; `options` are attributes of its CoSimulation element."""
    files = [element("SourceFiles", {}, (element("File", {"name": name}) for name in source_files))]
    types = [element("TypeDefinitions", {}, _type_definitions(unit))]
    units = sorted({v.unit for v in unit.variables if v.kind == "Real"})
    return element("fmiModelDescription", {
        "fmiVersion": "2.0", "modelName": unit.model, "guid": guid, "description": describe(unit),
        "version": __version__, "license": "MIT", "generationTool": tool, "variableNamingConvention": "structured"}, [
            element("CoSimulation", {"modelIdentifier": unit.model, **options}, files if source_files else ()),
            element("UnitDefinitions", {}, map(_unit_definition, units)),
            *(types if len(types[0]) else ()),
            element("LogCategories", {}, (element("Category", {"name": name, "description": description})
                                          for name, description in Fmi2Slave.log_categories.items())),
            element("DefaultExperiment", {
                "startTime": "0", "stopTime": _text(STOP_TIME), "stepSize": _text(STEP_SIZE)}),
            element("ModelVariables", {}, (_scalar(reference, v, start) for reference, (v, start) in enumerate(
                zip(unit.variables, starts, strict=True)))),
            _structure(unit)])


def _terminals(unit: FmuInterface) -> Iterator[Terminal]:
    """Yield the terminals of the fin port and the actuator's; of several fins those of each."""
    actuator, several = unit.actuator, unit.fins > 1
    if several:
        yield Terminal("mixing", "deflections for moments about the body axes", _MIXED)
    for terminal in (*fin_port.TERMINALS, *actuator.terminals):
        if not several or terminal.name == "vehicle":
            yield terminal
            continue
        for fin in range(unit.fins):
            yield Terminal(f"{terminal.name}{fin + 1}", f"fin {fin + 1}: {terminal.description}",
                           tuple(unit.name(member, fin) for member in terminal.members))
    if supply := actuator.supply:
        outputs = unit.line_outputs if several else (supply.power,)
        yield Terminal(supply.line.group, supply.line.supply, (supply.input.name, *(v.name for v in outputs)))


def terminals_and_icons(unit: FmuInterface) -> Element:
    """Return inputs and outputs grouped for tools that draw terminals (FMI 3.0's file, ignored by others)."""
    corners = {"x1": "-100", "y1": "-100", "x2": "100", "y2": "100"}
    return element("fmiTerminalsAndIcons", {"fmiVersion": "3.0"}, [
        element("GraphicalRepresentation", {}, [
            element("CoordinateSystem", {**corners, "suggestedScalingFactorTo_mm": "0.1"}), element("Icon", corners)]),
        element("Terminals", {}, (
            element("Terminal", {"name": t.name, "matchingRule": "bus", "description": t.description}, (
                element("TerminalMemberVariable", {
                    "variableName": member, "memberName": member, "variableKind": "signal"}) for member in t.members))
            for t in _terminals(unit)))])


def to_bytes(root: Element) -> bytes:
    """Return the document as indented UTF-8."""
    indent(root)
    body: bytes = tostring(root, encoding="UTF-8", xml_declaration=True)
    return body + b"\n"
