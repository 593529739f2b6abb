"""modelDescription.xml and terminalsAndIcons.xml out of the variable table."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from math import isfinite
from typing import Any
from xml.etree.ElementTree import Element, SubElement, indent, tostring

from pythonfmu import Fmi2Slave

from .. import __version__
from ..actuators import NONLINEAR
from ..unit import BUS_OUTPUTS, MIXING, Unit
from ..unit import start_values as unit_starts
from ..variables import Variable
from .units import UNITS

SINGLE = Unit(1)
MODEL = SINGLE.model
DESCRIPTION = ("Nonlinear electromechanical control actuation system: brushless motor, current-mode drive, "
               "ball screw, lever and fin, with position, velocity and current loops")
STEP_SIZE, STOP_TIME = 1e-3, 1.0

# An output at a communication point depends at once on these inputs only: the state
# integrates the rest.
_DIRECT: dict[str, tuple[str, ...]] = {
    "motor_current": ("enable",),
    "motor_voltage": ("supply_voltage", "enable"),
    "motor_torque": ("enable",),
    "hinge_torque": ("aero_torque", "acceleration.x", "acceleration.y", "acceleration.z",
                     "attitude.roll", "attitude.pitch"),
    "supply_power": ("supply_voltage", "enable"),
    "tracking_error": ("fin_command",),
    "saturated": ("supply_voltage", "enable"),
}
_MIXED = tuple(v.name for v in MIXING)


def _dependencies(unit: Unit) -> dict[str, tuple[str, ...]]:
    """For each output, the inputs it depends on at once."""
    own = {**_DIRECT, **dict(unit.actuator.model.direct)}
    if unit.fins == 1:
        return own
    found = {unit.name(output, fin): (*(unit.name(i, fin) for i in inputs),
                                      *(_MIXED if "fin_command" in inputs else ()))
             for fin in range(unit.fins) for output, inputs in own.items()}
    every = tuple(dict.fromkeys(unit.name(i, fin) for fin in range(unit.fins) for i in own["supply_power"]))
    return {**found, "bus_voltage": ("supply_voltage",), "bus_current": every, "supply_power": every}


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
        if UNITS[v.unit].displays:
            typed["displayUnit"] = UNITS[v.unit].displays[0][0]
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
        unit = UNITS[name]
        element = SubElement(definitions, "Unit", {"name": name})
        base = {base: str(exponent) for base, exponent in unit.exponents.items()}
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
        own = output.partition(".")[0] if output.startswith("fin[") else ""
        return [index[v.name] for v in unit.parameters if v.name.startswith(own)]

    for tag in ("Outputs", "InitialUnknowns"):
        unknowns = SubElement(structure, tag)
        for v in unit.outputs:
            inputs = sorted(index[name] for name in direct.get(v.name, ()))
            known = inputs + parameters(v.name) if tag == "InitialUnknowns" else inputs
            SubElement(unknowns, "Unknown", {
                "index": str(index[v.name]), "dependencies": " ".join(map(str, known)),
                "dependenciesKind": " ".join(["dependent"] * len(known))})


def describe(unit: Unit) -> str:
    """What the unit is, in a sentence."""
    several = "" if unit.fins == 1 else f"; {unit.fins} fins on one bus"
    return (DESCRIPTION if unit.kind == NONLINEAR else unit.actuator.title) + several


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


_TERMINALS = (
    ("command", "what the flight computer sends and gets back",
     ("fin_command", "enable", "measured_fin_angle", "tracking_error", "saturated", "at_stop")),
    ("hinge", "the fin's shaft: moment in, motion out",
     ("aero_torque", "fin_angle", "fin_rate", "hinge_torque")),
    ("vehicle", "motion of the vehicle, for gravity and inertia",
     tuple(v.name for v in SINGLE.inputs if v.name.startswith(("acceleration.", "attitude.")))),
    ("bus", "electrical supply", ("supply_voltage", "supply_power")),
    ("motor", "motor and drive",
     ("motor_angle", "motor_speed", "motor_current", "motor_voltage", "motor_torque", "drive_reference",
      "nut_position")),
)


def _terminals(unit: Unit) -> Iterator[tuple[str, str, tuple[str, ...]]]:
    if unit.fins == 1:
        yield from _TERMINALS
        return
    yield "mixing", "deflections for moments about the body axes", tuple(v.name for v in MIXING)
    for name, description, members in _TERMINALS:
        if name == "vehicle":
            yield name, description, members
        elif name == "bus":
            yield name, description, ("supply_voltage", *(v.name for v in BUS_OUTPUTS))
        else:
            for fin in range(unit.fins):
                yield f"{name}{fin + 1}", f"fin {fin + 1}: {description}", tuple(unit.name(m, fin) for m in members)


def terminals_and_icons(unit: Unit = SINGLE) -> Element:
    """Inputs and outputs grouped for tools that draw terminals (FMI 3.0's file, ignored by others)."""
    root = Element("fmiTerminalsAndIcons", {"fmiVersion": "3.0"})
    graphical = SubElement(root, "GraphicalRepresentation")
    SubElement(graphical, "CoordinateSystem", {"x1": "-100", "y1": "-100", "x2": "100", "y2": "100",
                                               "suggestedScalingFactorTo_mm": "0.1"})
    SubElement(graphical, "Icon", {"x1": "-100", "y1": "-100", "x2": "100", "y2": "100"})
    terminals = SubElement(root, "Terminals")
    for name, description, members in _terminals(unit):
        terminal = SubElement(terminals, "Terminal", {"name": name, "matchingRule": "bus", "description": description})
        for member in members:
            SubElement(terminal, "TerminalMemberVariable",
                       {"variableName": member, "memberName": member, "variableKind": "signal"})
    return root


def to_bytes(root: Element) -> bytes:
    """The document as indented UTF-8."""
    indent(root)
    body: bytes = tostring(root, encoding="UTF-8", xml_declaration=True)
    return body + b"\n"
