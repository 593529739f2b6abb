"""What the descriptions of every FMI version share: units, dependencies, terminals, text of numbers."""

from __future__ import annotations

import hashlib
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from math import degrees, isfinite
from pathlib import PurePath
from typing import Any
from xml.etree.ElementTree import Element, indent, tostring

from pythonfmu import Fmi2Slave

from .. import __author__, __copyright__, __license__, __version__
from ..actuators import fin_port
from ..errors import EmcasError
from ..parameters import ParameterSet, load_parameters
from ..reference.files import parameters_hash
from ..runtime import codegen
from ..support import dates
from ..trace.dependencies import ZERO
from ..units import factor
from ..variables import Terminal, Variable
from .interface import AZIMUTH, FINS, MIXING, FmuInterface
from .units import DIFFERENCES, default_display, display, fmi_unit, quantity

STEP_SIZE, STOP_TIME = 1e-3, 1.0
# Relative, for a host's own solvers: the unit steps as it does, which is within 2e-5 of the travel of its references.
TOLERANCE = 1e-4

_MIXED = tuple(v.name for v in MIXING)


def element(tag: str, attributes: Mapping[str, str | None], children: Iterable[Element] = ()) -> Element:
    """Return an element with `children` and those of its `attributes` that are not None."""
    made = Element(tag, {name: value for name, value in attributes.items() if value is not None})
    made.extend(children)
    return made


def text(value: Any) -> str:
    """Return a value as XML has it: true, 3, 0.25."""
    if isinstance(value, bool):
        return "true" if value else "false"
    return str(value) if isinstance(value, int) else repr(float(value)).removesuffix(".0")


def limit(value: float) -> str | None:
    """Return a limit as XML has it; None where there is none."""
    return text(value) if isfinite(value) else None


def to_bytes(root: Element) -> bytes:
    """Return the document as indented UTF-8."""
    indent(root)
    body: bytes = tostring(root, encoding="UTF-8", xml_declaration=True)
    return body + b"\n"


def describe(unit: FmuInterface) -> str:
    """Return what the unit is, in a sentence."""
    line = f" on one {unit.line.name}" if unit.line else ""
    return unit.actuator.title + ("" if unit.fins == 1 else f"; {unit.fins} fins{line}")


def about(unit: FmuInterface, sets: Sequence[ParameterSet], tool: str) -> dict[str, str]:
    """Return the attributes that tell people whose a unit is, when and by what `tool` it was made, and its parameters.

    None of them is part of the interface. `sets` are the fins' parameters. Raises EmcasError for a SOURCE_DATE_EPOCH
    that is no number.
    """
    marks = [parameters_hash(each.values) for each in sets]
    mark = marks[0] if unit.fins == 1 else hashlib.sha256("".join(marks).encode()).hexdigest()
    return {"description": f"{describe(unit)}; {parameters_in_words(unit, sets)}",
            "version": f"{__version__}+{mark[:8]}" if _changed(unit, sets) else __version__,
            "author": __author__, "copyright": __copyright__, "license": __license__,
            "generationTool": tool, "generationDateAndTime": dates.reproducible()}


def parameters_in_words(unit: FmuInterface, sets: Sequence[ParameterSet]) -> str:
    """Return what is special about the fins' parameters: where fins stand, and by which files how many values differ
    from the actuator's default ones."""
    places = [f"{degrees(each.values[AZIMUTH]):g}" for each in sets]
    at = "" if unit.fins == 1 else f"fins at {', '.join(places)} deg; "
    changed = len(_changed(unit, sets))
    if not changed:
        return f"{at}default parameters"
    files = dict.fromkeys(PurePath(file).name for each in sets for file, _ in each.files)
    return f"{at}{changed} value{'s' * (changed > 1)} changed" + (f" by {', '.join(files)}" if files else "")


def _changed(unit: FmuInterface, sets: Sequence[ParameterSet]) -> set[str]:
    """Return the names of parameters and start values that are not an actuator's default ones in every fin."""
    shipped = load_parameters(model=unit.kind).values
    changed = {name for each in sets for name, value in each.values.items() if value != shipped[name]}
    return changed if unit.fins == 1 else changed - {AZIMUTH}


def of_fin(name: str) -> str:
    """Return a variable's structured name without what says of which fin it is, or that it is an array of theirs."""
    return name.rpartition("].")[2].removeprefix(FINS)


def type_name(v: Variable) -> str | None:
    """Name of a variable's type, one for all fins: its quantity, or an enumeration's own; None of others.

    No variable may be called so (FMI 2.0.5, section 2.2.3).
    """
    if v.items:
        return of_fin(v.name) + "_type"
    return quantity(v) or None if v.kind == "Real" else None


def types(unit: FmuInterface) -> dict[str, Variable]:
    """Return a variable of each type by the type's name. Raises EmcasError where a variable is called so."""
    named = {name: v for v in unit.variables if (name := type_name(v))}
    if clash := [v.name for v in unit.variables if unit.spelt(v.name) in named]:
        raise EmcasError(f"{unit.actuator.name}: {clash[0]} is what the model description calls a type; give the "
                         "variable another name")
    return dict(sorted(named.items()))


def real_type(v: Variable) -> dict[str, str | None]:
    """Return the attributes of the type of a real variable."""
    of = quantity(v)
    return {"quantity": of, "unit": v.unit, "displayUnit": default_display(of) or None,
            "relativeQuantity": "true" if of in DIFFERENCES else None}


def enumeration_items(v: Variable) -> Iterator[Element]:
    """Yield the items of an enumeration's type."""
    for value, (item, meaning) in enumerate(v.items, 1):
        yield element("Item", {"name": item, "value": str(value), "description": meaning})


def typed_attributes(v: Variable) -> dict[str, str | None]:
    """Return the attributes of a variable that go with its type but its start.

    Of a real variable's type they repeat the unit alone, for readers of no types.
    """
    unit, shown = (v.unit, display(v)) if v.kind == "Real" else (None, None)
    return {"declaredType": type_name(v), "unit": unit,
            "displayUnit": None if unit is None or shown == default_display(quantity(v)) else shown,
            "min": limit(v.minimum), "max": limit(v.maximum),
            "nominal": None if v.nominal is None else text(v.nominal)}


def unit_definitions(unit: FmuInterface) -> Element:
    """Return the UnitDefinitions element, which all versions write alike."""
    shown: dict[str, set[str]] = {}
    for v in unit.variables:
        if v.kind == "Real":
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


def log_categories(version: int) -> Element:
    """Return the LogCategories element of a version of FMI; pythonfmu's words are of the second."""
    return element("LogCategories", {}, (
        element("Category", {"name": name, "description": description.replace("fmi2", f"fmi{version}")})
        for name, description in Fmi2Slave.log_categories.items()))


def default_experiment() -> Element:
    """Return the DefaultExperiment element."""
    return element("DefaultExperiment", {"startTime": "0", "stopTime": text(STOP_TIME), "tolerance": text(TOLERANCE),
                                         "stepSize": text(STEP_SIZE)})


def dependencies(unit: FmuInterface) -> dict[str, tuple[str, ...]]:
    """Return for each output the inputs it depends on at once, at a communication point."""
    return _of_unit(unit, codegen.direct_inputs(unit.kind), _MIXED)


def initial_dependencies(unit: FmuInterface) -> dict[str, tuple[str, ...]]:
    """Return for each output the inputs and parameters its initial value depends on."""
    values = codegen.initial_values(unit.kind)
    listed = _of_unit(unit, {output: value.names for output, value in values.items()}, (*_MIXED, AZIMUTH))
    if unit.line and unit.actuator.supply and values[unit.actuator.supply.power.name] == ZERO:
        listed[unit.line.outputs[1].name] = ()  # nothing is drawn
    return listed


def _of_unit(unit: FmuInterface, of_one: Mapping[str, Collection[str]], mixed: tuple[str, ...],
             ) -> dict[str, tuple[str, ...]]:
    """Return what each output of a unit depends on; `of_one` is that of a single fin, whose command is `mixed`."""
    def of_fin(fin: int, output: str) -> set[str]:
        needed = of_one.get(output, ())
        more = mixed if unit.fins > 1 and fin_port.COMMAND.name in needed else ()
        return {name if name in _MIXED else unit.name(name, fin) for name in (*needed, *more)}

    listed = {unit.name(v.name, fin): of_fin(fin, v.name) for fin in range(unit.fins) for v in unit.actuator.outputs}
    if unit.line and unit.actuator.supply:
        source, power = {unit.actuator.supply.input.name}, unit.actuator.supply.power.name
        every = set().union(*(of_fin(fin, power) for fin in range(unit.fins)))
        drawn = source | every  # power over what the line gives
        listed |= zip((v.name for v in unit.line_outputs), (source, drawn, every), strict=True)
    return {v.name: tuple(sorted(listed[v.name], key=unit.reference.__getitem__)) for v in unit.outputs}


def _terminals(unit: FmuInterface, arrays: bool) -> Iterator[Terminal]:
    """Yield the terminals of the fin port and the actuator's; of several fins those of each, or of `arrays` of them."""
    actuator, several = unit.actuator, unit.fins > 1
    if several:
        yield Terminal("mixing", "deflections for moments about the body axes", _MIXED)
    for terminal in (*fin_port.TERMINALS, *actuator.terminals):
        if not several or terminal.name == "vehicle":
            yield terminal
            continue
        if arrays:
            yield Terminal(terminal.name, terminal.description, tuple(map(unit.array_name, terminal.members)))
            continue
        for fin in range(unit.fins):
            yield Terminal(f"{terminal.name}{fin + 1}", f"fin {fin + 1}: {terminal.description}",
                           tuple(unit.name(member, fin) for member in terminal.members))
    if supply := actuator.supply:
        outputs = unit.line_outputs if several else (supply.power,)
        yield Terminal(supply.line.group, supply.line.supply, (supply.input.name, *(v.name for v in outputs)))


def terminals_and_icons(unit: FmuInterface, arrays: bool = False) -> Element:
    """Return inputs and outputs grouped for tools that draw terminals (FMI 3.0's file, ignored by others).

    With `arrays` the variables of several fins are arrays.
    """
    corners = {"x1": "-100", "y1": "-100", "x2": "100", "y2": "100"}
    return element("fmiTerminalsAndIcons", {"fmiVersion": "3.0"}, [
        element("GraphicalRepresentation", {}, [
            element("CoordinateSystem", {**corners, "suggestedScalingFactorTo_mm": "0.1"}), element("Icon", corners)]),
        element("Terminals", {}, (
            element("Terminal", {"name": t.name, "matchingRule": "bus", "description": t.description}, (
                element("TerminalMemberVariable", {
                    "variableName": unit.spelt(member), "memberName": unit.spelt(of_fin(member)),
                    "variableKind": "signal"}) for member in t.members))
            for t in _terminals(unit, arrays)))])
