"""Parameter sets of a structure: which variable each setting is for, and whether the FMU accepts it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress

from ..actuators import NONLINEAR, get
from ..bench.fmu import model_of
from ..parameters import check_parameters
from .findings import Report, nearest
from .interface import Interface, Value, typed
from .structure import Binding, Element, Setting, Structure
from .units import conversion

Target = tuple[str, str]  # component (empty: the system) and variable or connector
Values = dict[Target, Value]


def _bindings(system: Element) -> Iterator[tuple[Element, Binding]]:
    """Yield all bindings by priority, the highest last: a set at the system counts more than one at a component."""
    for element in (*system.elements.values(), system):
        yield from ((element, binding) for binding in element.bindings)


def effective(structure: Structure) -> Values:
    """Return the values that all parameter sets together give; those that are not of their type are skipped."""
    values: Values = {}
    for element, binding in _bindings(structure.system):
        owner = "" if element is structure.system else element.name
        for setting in binding.settings:
            with suppress(ValueError):
                values[owner, setting.name] = setting.typed
    return values


def check_settings(structure: Structure, report: Report, model: str | None = None) -> None:
    """Check all parameter sets of a structure; `model` is the actuator of FMUs whose name does not say it."""
    system = structure.system
    for element, binding in _bindings(system):
        for setting in binding.settings:
            report.parameters += 1
            place, interface, variable = f"parameter {setting.name}", element.interface, setting.name
            if element is system:
                if setting.name not in system.connectors:
                    report.error(binding.file, place, "is not a connector of the system",
                                 nearest(setting.name, system.connectors, "bind sets of components to these"))
                    continue
                interface, variable = _fed(system, setting.name)
            if interface is not None:
                for message, remedy in _problems(setting, interface, variable):
                    report.error(binding.file, place, message, remedy)
            if setting.type == "Boolean" and setting.value in ("false", "0"):
                report.warning(binding.file, place, "is false, which fmpy's read_ssv and simulate_ssp read as true",
                               "make it the FMU's start value instead: emcas build --parameters FILE")
    files = {structure.file, *(binding.file for _, binding in _bindings(system))}
    if not any(f.file in files for f in report.errors):  # combinations of wrong numbers say nothing
        _check_combinations(structure, report, model)


def _fed(system: Element, connector: str) -> tuple[Interface | None, str]:
    """Return FMU and variable of the first component that a connector of the system is wired to."""
    for connection in system.connections:
        for near, (component, variable) in ((connection.start, connection.end), (connection.end, connection.start)):
            if near == ("", connector) and component in system.elements:
                return system.elements[component].interface, variable
    return None, ""


def _problems(setting: Setting, interface: Interface, name: str) -> Iterator[tuple[str, str]]:
    """Yield what is wrong with a setting of the FMU's variable `name`, and the remedy."""
    variable = interface.variables.get(name)
    if variable is None:
        settable = [v.name for v in interface.variables.values() if v.settable]
        yield f"the FMU has no variable {name}", nearest(name, settable, "remove it")
    elif not variable.settable:
        yield f"is {variable.causality} of the FMU and cannot be set", "remove it"
    elif setting.type != variable.type:
        yield f"has the type {setting.type}, but is {variable.type} in the FMU", f"write ssv:{variable.type}"
    else:
        try:
            value = setting.typed
        except ValueError as error:
            yield f"{setting.value!r} is not of the type {setting.type} ({error})", "write a value of that type"
            return
        convert, unit = conversion(setting.unit, variable.unit), variable.unit
        if convert is None or not convert.identity:
            yield f"is in {setting.unit}, but the FMU's variable is in {unit}", (
                f"write it in {unit}" if convert is None
                else f"write {convert(float(value)):.12g} {unit.name}: no host converts here")
        elif not isinstance(value, (str, bool)) and not variable.minimum <= value <= variable.maximum:
            yield (f"is {setting.value} {unit.name}, outside {variable.minimum:g} .. {variable.maximum:g}",
                   "write a value within the limits")


def _check_combinations(structure: Structure, report: Report, otherwise: str | None) -> None:
    """Check for combinations of parameters that an actuator of this package refuses when it is initialized."""
    values = effective(structure)
    for name, element in structure.system.elements.items():
        if element.interface is None:
            continue
        variables, model = element.interface.variables, model_of(element.interface.model) or otherwise or NONLINEAR
        table = get(model).parameters
        if any(v.name not in variables for v in table):
            continue
        numbers = {v.name: values.get((name, v.name), typed(v.kind, variables[v.name].start or "0")) for v in table}
        for problem in check_parameters(numbers, model):
            report.error(structure.file, f"component {name}", problem, "change one of them")
