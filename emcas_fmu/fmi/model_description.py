"""modelDescription.xml and terminalsAndIcons.xml out of what the actuator declares."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from math import isfinite
from typing import Any
from xml.etree.ElementTree import Element, SubElement, indent, tostring

from pythonfmu import Fmi2Slave

from .. import __version__
from ..actuators import fin_port
from ..kernels import program
from ..unit import BUS_CURRENT, BUS_VOLTAGE, MIXING, Unit
from ..unit import start_values as unit_starts
from ..variables import Terminal, Variable
from .units import fmi_unit

SINGLE = Unit(1)
MODEL = SINGLE.model
STEP_SIZE, STOP_TIME = 1e-3, 1.0

_MIXED = tuple(v.name for v in MIXING)


def _dependencies(unit: Unit) -> dict[str, tuple[str, ...]]:
    """Return for each output the inputs it depends on at once."""
    direct = program.direct_inputs(unit.kind)
    if unit.fins == 1:
        return dict(direct)
    of_fins = {unit.name(output, fin): (*(unit.name(i, fin) for i in inputs),
                                        *(_MIXED if "fin_command" in inputs else ()))
               for fin in range(unit.fins) for output, inputs in direct.items()}
    supply = unit.actuator.supply
    if supply is None:
        return of_fins
    power = direct.get(supply.power.name, ())
    every = tuple(dict.fromkeys(unit.name(i, fin) for fin in range(unit.fins) for i in power))
    current = tuple(dict.fromkeys((supply.input.name, *every)))  # power over voltage
    return {**of_fins, BUS_VOLTAGE.name: (supply.input.name,), BUS_CURRENT.name: current, supply.power.name: every}


def start_values(parameters: Mapping[str, Any]) -> tuple[Any, ...]:
    """Start value of every variable of a single actuator, in table order; 0 or False for outputs."""
    return unit_starts(SINGLE, [parameters])


def _text(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int):
        return str(value)
    return repr(float(value)).removesuffix(".0")


def _number(v: Variable, value: float) -> str:
    return str(int(value)) if v.kind == "Integer" else _text(value)


def _scalar(parent: Element, reference: int, v: Variable, start: Any) -> None:
    attributes = {"name": v.name, "valueReference": str(reference), "description": v.description,
                  "causality": v.causality, "variability": v.variability}
    if v.causality == "output":
        attributes["initial"] = "calculated"
    if v.causality == "parameter":
        attributes["initial"] = "exact"
    typed: dict[str, str] = {}
    if v.kind == "Real":
        typed["unit"] = v.unit
        if displays := fmi_unit(v.unit).displays:
            typed["displayUnit"] = displays[0][0]
    if isfinite(v.minimum):
        typed["min"] = _number(v, v.minimum)
    if isfinite(v.maximum):
        typed["max"] = _number(v, v.maximum)
    if v.nominal is not None:
        typed["nominal"] = _text(v.nominal)
    if v.causality != "output":
        typed["start"] = _text(start)
    if v.items:
        typed = {"declaredType": _type_name(v), **typed}
    SubElement(SubElement(parent, "ScalarVariable", attributes), v.kind, typed)


def _type_name(v: Variable) -> str:
    """Name of an enumeration's type, one for all fins; it must not be that of a variable (FMI 2.0.5, section 2.2.3)."""
    return v.name.rpartition("].")[2] + "_type"


def _type_definitions(root: Element, unit: Unit) -> None:
    types = {_type_name(v): v for v in unit.variables if v.items}
    if not types:
        return
    definitions = SubElement(root, "TypeDefinitions")
    for name, v in types.items():
        listed = SubElement(SubElement(definitions, "SimpleType", {"name": name}), "Enumeration")
        for value, (item, description) in enumerate(v.items, 1):
            SubElement(listed, "Item", {"name": item, "value": str(value), "description": description})


def _unit_definitions(root: Element, shown: Unit) -> None:
    definitions = SubElement(root, "UnitDefinitions")
    for name in sorted({v.unit for v in shown.variables if v.kind == "Real"}):
        unit = fmi_unit(name)
        element = SubElement(definitions, "Unit", {"name": name})
        base = {base: str(exponent) for base, exponent in unit.exponents.items()}
        if unit.factor != 1.0:
            base["factor"] = _text(unit.factor)
        if unit.offset:
            base["offset"] = _text(unit.offset)
        SubElement(element, "BaseUnit", base)
        for display, factor, offset in unit.displays:
            attributes = {"name": display, "factor": _text(factor)}
            if offset:
                attributes["offset"] = _text(offset)
            SubElement(element, "DisplayUnit", attributes)


def _structure(root: Element, unit: Unit) -> None:
    index = {name: i + 1 for name, i in unit.reference.items()}
    structure = SubElement(root, "ModelStructure")
    direct = _dependencies(unit)

    def parameters(output: str) -> list[int]:
        """Indices of the parameters an output's initial value follows from: all, or those of its fin."""
        fin = output.partition(".")[0] if output.startswith("fin[") else ""
        return [index[v.name] for v in unit.parameters if v.name.startswith(fin)]

    for tag in ("Outputs", "InitialUnknowns"):
        unknowns = SubElement(structure, tag)
        for v in unit.outputs:
            inputs = sorted(index[name] for name in direct.get(v.name, ()))
            needed = inputs + parameters(v.name) if tag == "InitialUnknowns" else inputs
            SubElement(unknowns, "Unknown", {
                "index": str(index[v.name]), "dependencies": " ".join(map(str, needed)),
                "dependenciesKind": " ".join(["dependent"] * len(needed))})


def describe(unit: Unit) -> str:
    """What the unit is, in a sentence."""
    bus = " on one bus" if unit.actuator.supply else ""
    return unit.actuator.title + ("" if unit.fins == 1 else f"; {unit.fins} fins{bus}")


def model_description(starts: Sequence[Any], guid: str, *, options: Mapping[str, str], tool: str,
                      source_files: Sequence[str] = (), unit: Unit = SINGLE) -> Element:
    """The fmiModelDescription element; `options` are attributes of its CoSimulation element."""
    root = Element("fmiModelDescription", {
        "fmiVersion": "2.0", "modelName": unit.model, "guid": guid, "description": describe(unit),
        "version": __version__, "license": "MIT", "generationTool": tool,
        "variableNamingConvention": "structured"})
    simulation = SubElement(root, "CoSimulation", {"modelIdentifier": unit.model, **options})
    if source_files:
        listed = SubElement(simulation, "SourceFiles")
        for name in source_files:
            SubElement(listed, "File", {"name": name})
    _unit_definitions(root, unit)
    _type_definitions(root, unit)
    categories = SubElement(root, "LogCategories")
    for name, description in Fmi2Slave.log_categories.items():
        SubElement(categories, "Category", {"name": name, "description": description})
    SubElement(root, "DefaultExperiment", {"startTime": "0", "stopTime": _text(STOP_TIME),
                                           "stepSize": _text(STEP_SIZE)})
    variables = SubElement(root, "ModelVariables")
    for reference, (v, start) in enumerate(zip(unit.variables, starts, strict=True)):
        _scalar(variables, reference, v, start)
    _structure(root, unit)
    return root


def _terminals(unit: Unit) -> Iterator[Terminal]:
    """Yield the terminals of the fin port and the actuator's; of several fins those of each."""
    actuator, several = unit.actuator, unit.fins > 1
    supply = () if actuator.supply is None else (actuator.supply.input.name, actuator.supply.power.name)
    if several:
        yield Terminal("mixing", "deflections for moments about the body axes", tuple(v.name for v in MIXING))
    for terminal in (*fin_port.TERMINALS, *actuator.terminals):
        if not several or terminal.name == "vehicle":
            yield terminal
            continue
        for fin in range(unit.fins):
            yield Terminal(f"{terminal.name}{fin + 1}", f"fin {fin + 1}: {terminal.description}",
                           tuple(unit.name(member, fin) for member in terminal.members))
    if supply:
        members = (supply[0], *(v.name for v in unit.bus_outputs)) if several else supply
        yield Terminal("bus", "electrical supply", members)


def terminals_and_icons(unit: Unit = SINGLE) -> Element:
    """Inputs and outputs grouped for tools that draw terminals (FMI 3.0's file, ignored by others)."""
    root = Element("fmiTerminalsAndIcons", {"fmiVersion": "3.0"})
    graphical = SubElement(root, "GraphicalRepresentation")
    SubElement(graphical, "CoordinateSystem", {"x1": "-100", "y1": "-100", "x2": "100", "y2": "100",
                                               "suggestedScalingFactorTo_mm": "0.1"})
    SubElement(graphical, "Icon", {"x1": "-100", "y1": "-100", "x2": "100", "y2": "100"})
    terminals = SubElement(root, "Terminals")
    for described in _terminals(unit):
        terminal = SubElement(terminals, "Terminal", {"name": described.name, "matchingRule": "bus",
                                                      "description": described.description})
        for member in described.members:
            SubElement(terminal, "TerminalMemberVariable",
                       {"variableName": member, "memberName": member, "variableKind": "signal"})
    return root


def to_bytes(root: Element) -> bytes:
    """The document as indented UTF-8."""
    indent(root)
    body: bytes = tostring(root, encoding="UTF-8", xml_declaration=True)
    return body + b"\n"
