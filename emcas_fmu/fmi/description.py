"""Descriptions of an FMU in words and in XML: title, author, types, dependencies, terminals."""

from __future__ import annotations

import hashlib
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from math import degrees
from pathlib import PurePath
from typing import Any
from xml.etree.ElementTree import Element, indent, tostring

from .. import __author__, __copyright__, __license__, __version__
from ..actuators import fin_port
from ..errors import EmcasError
from ..parameters import ParameterSet, load_parameters
from ..reference.files import parameters_hash
from ..runtime import codegen
from ..support import dates
from ..trace.dependencies import ZERO
from ..variables import Terminal, Variable
from .interface import AZIMUTH, FINS, MIXING, FmuInterface
from .units import quantity

_MIXED = tuple(v.name for v in MIXING)


def element(tag: str, attributes: Mapping[str, str | None], children: Iterable[Element] = ()) -> Element:
    """Return an XML element with `children` and `attributes`, without attributes that are None."""
    result = Element(tag, {name: value for name, value in attributes.items() if value is not None})
    result.extend(children)
    return result


def text(value: Any) -> str:
    """Return a value as text for XML: true, 3, 0.25."""
    if isinstance(value, bool):
        return "true" if value else "false"
    return str(value) if isinstance(value, int) else repr(float(value)).removesuffix(".0")


def to_bytes(root: Element) -> bytes:
    """Return an XML document as indented UTF-8."""
    indent(root)
    body: bytes = tostring(root, encoding="UTF-8", xml_declaration=True)
    return body + b"\n"


def describe(interface: FmuInterface) -> str:
    """Return a phrase that describes the FMU."""
    line = f" on one {interface.line.name}" if interface.line else ""
    return interface.actuator.title + ("" if interface.fins == 1 else f"; {interface.fins} fins{line}")


def about(interface: FmuInterface, sets: Sequence[ParameterSet], tool: str) -> dict[str, str]:
    """Return the attributes of a model description that only inform people: description, version, author, `tool`, date.

    `sets` are the fins' parameters. Raises EmcasError if SOURCE_DATE_EPOCH is not a valid time [s].
    """
    hashes = [parameters_hash(each.values) for each in sets]
    digest = hashes[0] if interface.fins == 1 else hashlib.sha256("".join(hashes).encode()).hexdigest()
    return {"description": f"{describe(interface)}; {parameters_in_words(interface, sets)}",
            "version": f"{__version__}+{digest[:8]}" if _changed(interface, sets) else __version__,
            "author": __author__, "copyright": __copyright__, "license": __license__,
            "generationTool": tool, "generationDateAndTime": dates.reproducible()}


def parameters_in_words(interface: FmuInterface, sets: Sequence[ParameterSet]) -> str:
    """Return a phrase on the fins' parameters: azimuths, and the number and files of values that are not default."""
    angles = [f"{degrees(each.values[AZIMUTH]):g}" for each in sets]
    at = "" if interface.fins == 1 else f"fins at {', '.join(angles)} deg; "
    changed = len(_changed(interface, sets))
    if not changed:
        return f"{at}default parameters"
    files = dict.fromkeys(PurePath(file).name for each in sets for file, _ in each.files)
    return f"{at}{changed} value{'s' * (changed > 1)} changed" + (f" by {', '.join(files)}" if files else "")


def _changed(interface: FmuInterface, sets: Sequence[ParameterSet]) -> set[str]:
    """Return the parameters and start values that differ from the default in a fin, except azimuths of several fins."""
    shipped = load_parameters(model=interface.kind).values
    changed = {name for each in sets for name, value in each.values.items() if value != shipped[name]}
    return changed if interface.fins == 1 else changed - {AZIMUTH}


def without_fin(name: str) -> str:
    """Return a variable's structured name without the prefix of a fin or of an array of all fins."""
    return name.rpartition("].")[2].removeprefix(FINS)


def type_name(v: Variable) -> str | None:
    """Return the name of a variable's type, which is the same for all fins; None for a variable without a type.

    The type of a Real is its quantity, if any; an enumeration has its own type. No variable may have the name of a
    type (FMI 2.0.5, section 2.2.3).
    """
    if v.items:
        return without_fin(v.name) + "_type"
    return quantity(v) or None if v.kind == "Real" else None


def types(interface: FmuInterface) -> dict[str, Variable]:
    """Return one variable of each type, by the type's name. Raises EmcasError if a variable has the name of a type."""
    hidden = interface.actuator.hidden
    named = {name: v for v in interface.variables if (name := type_name(v)) and v.name not in hidden}
    if clash := [v.name for v in interface.variables if interface.spelt(v.name) in named]:
        raise EmcasError(f"{interface.actuator.name}: {clash[0]} is the name of a type in the model description; "
                         "give the variable another name")
    return dict(sorted(named.items()))


def dependencies(interface: FmuInterface) -> dict[str, tuple[str, ...]]:
    """Return for each output the names of the inputs that act on it directly, at a communication point."""
    inputs = {v.name for v in interface.inputs if v.causality == "input"}
    return {output: tuple(name for name in names if name in inputs)
            for output, names in _for_all_fins(interface, codegen.direct_inputs(interface.kind), _MIXED).items()}


def initial_dependencies(interface: FmuInterface) -> dict[str, tuple[str, ...]]:
    """Return for each output the names of the inputs and parameters on which its initial value depends."""
    values = codegen.initial_values(interface.kind)
    listed = _for_all_fins(interface, {output: value.names for output, value in values.items()}, (*_MIXED, AZIMUTH))
    if interface.line and interface.actuator.supply:
        source, started = interface.actuator.supply.input.name, codegen.line_started_by(interface.kind)
        listed = {output: tuple(sorted({*names, *started}, key=interface.reference.__getitem__))
                  if source in names else names for output, names in listed.items()}
        if values[interface.actuator.supply.power.name] == ZERO:
            listed[interface.line.outputs[1].name] = ()  # without power at the start there is no current or flow
    return listed


def _for_all_fins(interface: FmuInterface, of_one: Mapping[str, Collection[str]], mixed: tuple[str, ...],
                  ) -> dict[str, tuple[str, ...]]:
    """Return the dependencies of each output of all fins from `of_one`, the dependencies in a single actuator.

    With several fins, an output that depends on the command also depends on the variables `mixed`.
    """
    def needed_by(fin: int, output: str) -> set[str]:
        needed = of_one.get(output, ())
        more = mixed if interface.fins > 1 and fin_port.COMMAND.name in needed else ()
        return {name if name in _MIXED else interface.name(name, fin) for name in (*needed, *more)}

    listed = {interface.name(v.name, fin): needed_by(fin, v.name)
              for fin in range(interface.fins) for v in interface.actuator.outputs}
    if interface.line and interface.actuator.supply:
        source, power = {interface.actuator.supply.input.name}, interface.actuator.supply.power.name
        every = set().union(*(needed_by(fin, power) for fin in range(interface.fins)))
        current = source | every  # the power divided by the line's voltage or pressure
        listed |= zip((v.name for v in interface.line_outputs), (source, current, every), strict=True)
    return {v.name: tuple(sorted(listed[v.name], key=interface.reference.__getitem__)) for v in interface.outputs}


def _terminals(interface: FmuInterface, arrays: bool) -> Iterator[Terminal]:
    """Yield the terminals: mixing, fin port, actuator, supply. A fin's are repeated for each fin, unless `arrays`."""
    actuator, several = interface.actuator, interface.fins > 1
    if several and all(map(interface.is_input, _MIXED)):
        yield Terminal("mixing", "deflections for moments about the body axes", _MIXED)
    inputs = {v.name for v in actuator.inputs if interface.is_input(v.name)}
    present = inputs.union(v.name for v in actuator.outputs) - actuator.hidden
    for listed in (*fin_port.TERMINALS, *actuator.terminals):
        terminal = replace(listed, members=tuple(name for name in listed.members if name in present))
        if not terminal.members:
            continue
        if not several or terminal.name == "vehicle":
            yield terminal
        elif arrays:
            yield replace(terminal, members=tuple(map(interface.array_name, terminal.members)))
        else:
            yield from (Terminal(f"{terminal.name}{fin + 1}", f"fin {fin + 1}: {terminal.description}",
                                 tuple(interface.name(member, fin) for member in terminal.members))
                        for fin in range(interface.fins))
    if supply := actuator.supply:
        outputs = interface.line_outputs if several else (supply.power,)
        source = inputs.intersection([supply.input.name])
        yield Terminal(supply.line.group, supply.line.supply, (*source, *(v.name for v in outputs)))


def terminals_and_icons(interface: FmuInterface, arrays: bool = False) -> Element:
    """Return the root of terminalsAndIcons.xml (FMI 3.0): inputs and outputs, grouped in terminals.

    With `arrays` the variables of several fins are arrays.
    """
    corners = {"x1": "-100", "y1": "-100", "x2": "100", "y2": "100"}
    return element("fmiTerminalsAndIcons", {"fmiVersion": "3.0"}, [
        element("GraphicalRepresentation", {}, [
            element("CoordinateSystem", {**corners, "suggestedScalingFactorTo_mm": "0.1"}), element("Icon", corners)]),
        element("Terminals", {}, (
            element("Terminal", {"name": t.name, "matchingRule": "bus", "description": t.description}, (
                element("TerminalMemberVariable", {
                    "variableName": interface.spelt(member), "memberName": interface.spelt(without_fin(member)),
                    "variableKind": "signal"}) for member in t.members))
            for t in _terminals(interface, arrays)))])
