"""modelDescription.xml and terminalsAndIcons.xml out of the variable table."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import isfinite
from typing import Any
from xml.etree.ElementTree import Element, SubElement, indent, tostring

from pythonfmu import Fmi2Slave

from .. import __version__
from ..variables import INPUTS, OUTPUTS, VARIABLES, Variable
from .units import UNITS

MODEL = "EMCAS"
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


def start_values(parameters: Mapping[str, Any]) -> tuple[Any, ...]:
    """Start value of every variable, in table order; 0 or False for outputs."""

    def start(v: Variable) -> Any:
        if v.causality == "output":
            return False if v.kind == "Boolean" else 0.0
        if v.causality == "input" and v.key is None:
            return v.start
        return parameters[v.key or v.name]

    return tuple(start(v) for v in VARIABLES)


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
    SubElement(SubElement(parent, "ScalarVariable", attributes), v.kind, typed)


def _unit_definitions(root: Element) -> None:
    definitions = SubElement(root, "UnitDefinitions")
    for name in sorted({v.unit for v in VARIABLES if v.kind == "Real"}):
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


def _structure(root: Element) -> None:
    index = {v.name: i for i, v in enumerate(VARIABLES, start=1)}
    structure = SubElement(root, "ModelStructure")
    initial_parameters = [index[v.name] for v in VARIABLES if v.causality == "parameter"]
    for tag in ("Outputs", "InitialUnknowns"):
        unknowns = SubElement(structure, tag)
        for v in OUTPUTS:
            inputs = sorted(index[name] for name in _DIRECT.get(v.name, ()))
            # The initial state follows from the parameters.
            known = inputs + initial_parameters if tag == "InitialUnknowns" else inputs
            SubElement(unknowns, "Unknown", {
                "index": str(index[v.name]), "dependencies": " ".join(map(str, known)),
                "dependenciesKind": " ".join(["dependent"] * len(known))})


def model_description(starts: Sequence[Any], guid: str, *, options: Mapping[str, str], tool: str,
                      source_files: Sequence[str] = ()) -> Element:
    """The fmiModelDescription element; `options` are attributes of its CoSimulation element."""
    root = Element("fmiModelDescription", {
        "fmiVersion": "2.0", "modelName": MODEL, "guid": guid, "description": DESCRIPTION,
        "version": __version__, "license": "MIT", "generationTool": tool,
        "variableNamingConvention": "structured"})
    simulation = SubElement(root, "CoSimulation", {"modelIdentifier": MODEL, **options})
    if source_files:
        listed = SubElement(simulation, "SourceFiles")
        for name in source_files:
            SubElement(listed, "File", {"name": name})
    _unit_definitions(root)
    categories = SubElement(root, "LogCategories")
    for name, description in Fmi2Slave.log_categories.items():
        SubElement(categories, "Category", {"name": name, "description": description})
    SubElement(root, "DefaultExperiment", {"startTime": "0", "stopTime": _text(STOP_TIME),
                                           "stepSize": _text(STEP_SIZE)})
    variables = SubElement(root, "ModelVariables")
    for reference, (v, start) in enumerate(zip(VARIABLES, starts, strict=True)):
        _scalar(variables, reference, v, start)
    _structure(root)
    return root


def terminals_and_icons() -> Element:
    """Inputs and outputs grouped for tools that draw terminals (FMI 3.0's file, ignored by others)."""
    root = Element("fmiTerminalsAndIcons", {"fmiVersion": "3.0"})
    graphical = SubElement(root, "GraphicalRepresentation")
    SubElement(graphical, "CoordinateSystem", {"x1": "-100", "y1": "-100", "x2": "100", "y2": "100",
                                               "suggestedScalingFactorTo_mm": "0.1"})
    SubElement(graphical, "Icon", {"x1": "-100", "y1": "-100", "x2": "100", "y2": "100"})
    terminals = SubElement(root, "Terminals")
    groups = (
        ("command", "what the flight computer sends and gets back",
         ("fin_command", "enable", "measured_fin_angle", "tracking_error", "saturated", "at_stop")),
        ("hinge", "the fin's shaft: moment in, motion out",
         ("aero_torque", "fin_angle", "fin_rate", "hinge_torque")),
        ("vehicle", "motion of the vehicle, for gravity and inertia",
         tuple(v.name for v in INPUTS if v.name.startswith(("acceleration.", "attitude.")))),
        ("bus", "electrical supply", ("supply_voltage", "supply_power")),
        ("motor", "motor and drive",
         ("motor_angle", "motor_speed", "motor_current", "motor_voltage", "motor_torque", "drive_reference",
          "nut_position")),
    )
    for name, description, members in groups:
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
