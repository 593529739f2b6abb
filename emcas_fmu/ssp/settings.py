"""Parameter sets of a structure: what each says about which variable, and whether it may."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

from ..actuators import NONLINEAR, get
from ..bench.fmu import model_of
from ..parameters import check_parameters
from .findings import Report, nearest
from .interface import Value, typed
from .structure import Binding, Element, Setting, Structure, elements, systems
from .units import conversion

Values = dict[tuple[str, str], Value]  # by path of the component (empty: the system) and name of the variable
Bound = tuple[str, Element, Binding]  # path of an element (with a dot at its end, if any), element, a set bound there


class Target(NamedTuple):
    """What a setting is for: path of an element (with a dot at its end, if any), the element and its variable."""

    path: str
    element: Element
    name: str


def _target(system: Element, name: str, path: str = "") -> Target | None:
    """Return the variable a hierarchical name means inside a system or component; None without such an element."""
    if not system.elements or name in system.connectors:
        return Target(path, system, name)
    for element in system.elements.values():
        if name.startswith(f"{element.name}."):
            return _target(element, name[len(element.name) + 1:], f"{path}{element.name}.")
    return None


def _bindings(structure: Structure) -> Iterator[Bound]:
    """Yield all bindings in the order they count in, the last most: inner ones first, then in the order given."""
    for path, system in reversed(list(systems(structure.system))):
        for element in system.elements.values():
            if element.type != "system":
                yield from ((f"{path}{element.name}.", element, b) for b in element.bindings)
        yield from ((path, system, b) for b in system.bindings)


def effective(structure: Structure) -> Values:
    """Return what the standard makes of all bindings together, without names that mean nothing and bad values."""
    values: Values = {}
    for bound in _bindings(structure):
        values.update(_values(*bound))
    return values


def _values(path: str, element: Element, binding: Binding) -> Values:
    values: Values = {}
    for setting in () if binding.mapped else binding.settings:
        target = _target(element, binding.prefix + setting.name, path)
        try:
            if target is not None:
                values[target.path.removesuffix("."), target.name] = setting.typed
        except ValueError:
            continue
    return values


def check_settings(structure: Structure, report: Report, model: str | None = None) -> None:
    """Check all parameter sets of a structure; `model` is the actuator of those FMUs that do not tell their own."""
    bound = list(_bindings(structure))
    for path, element, binding in bound:
        if binding.mapped:
            report.warning(structure.file, f"binding of {binding.file}", "has a ParameterMapping, which is not checked",
                           "check it yourself; libcosim, Ecos and fmpy ignore it")
            continue
        for setting in binding.settings:
            report.parameters += 1
            name = binding.prefix + setting.name
            target, place = _target(element, name, path), f"parameter {name}"
            if target is None:
                beginnings = [f"{n}." for n in element.elements]
                report.error(binding.file, place, "is of no element of the system", nearest(
                    name, [*element.connectors, *beginnings], f"begin it with one of {', '.join(beginnings)}"))
                continue
            if target.element is not element:
                report.warning(structure.file, f"binding of {binding.file}", "is at a system and sets parameters of "
                               "components, which libcosim and Ecos pass over; OMSimulator passes over a prefix",
                               "bind one set to each component")
            at, connectors = target.element, target.element.connectors
            if at.interface is None and at.type == "system" and target.name not in connectors:
                report.error(binding.file, place, f"the system has no connector {target.name}",
                             nearest(target.name, connectors, "remove it"))
            elif (variable := target if at.interface else _fed(target)) is not None:
                _check_variable(structure, binding, setting, place, variable, report)
    files = {structure.file, *(binding.file for _, _, binding in bound)}
    if not any(f.file in files for f in report.errors):  # else combinations of wrong numbers
        _check_combinations(structure, report, model)


def _fed(target: Target) -> Target | None:
    """Return the first variable of an FMU a connector of a system is wired to, however many systems further in."""
    for connection in target.element.connections:
        for near, (name, connector) in ((connection.start, connection.end), (connection.end, connection.start)):
            element = target.element.elements.get(name)
            if near != ("", target.name) or element is None:
                continue
            inner = Target(f"{target.path}{name}.", element, connector)
            if element.interface is not None:
                return inner
            if element.type == "system" and (variable := _fed(inner)) is not None:
                return variable
    return None


def _check_variable(structure: Structure, binding: Binding, setting: Setting, place: str, target: Target,
                    report: Report) -> None:
    interface = target.element.interface
    assert interface is not None
    port = interface.ports.get(target.name)
    if port is None:
        settable = [p.name for p in interface.ports.values() if p.settable]
        report.error(binding.file, place, f"the FMU has no variable {target.name}",
                     nearest(target.name, settable, "remove it"))
        return
    if not port.settable:
        report.error(binding.file, place, f"is {port.causality} of the FMU and cannot be set", "remove it")
        return
    if setting.type != port.kind:
        report.error(binding.file, place, f"is given as {setting.type}, but is {port.kind} in the FMU",
                     f"write ssv:{port.kind}")
        return
    try:
        value = setting.typed
    except ValueError as error:
        report.error(binding.file, place, f"{setting.value!r} is no {setting.type} ({error})",
                     "write a value of that type")
        return
    if value is False:
        report.warning(binding.file, place, "is false, which fmpy's read_ssv and simulate_ssp take for true",
                       "make it the FMU's start value instead: emcas build --parameters FILE")
    if setting.unit and setting.unit != port.unit:
        start = binding.units.get(setting.unit) or structure.units.get(setting.unit)
        convert = conversion(start, interface.units.get(port.unit))
        if convert is None or not convert.identity:
            remedy = f"give it in {port.unit}" if convert is None or isinstance(value, str) else (
                f"write {convert(float(value)):.12g} {port.unit}: no host converts here")
            report.error(binding.file, place, f"is given in {setting.unit}, but the FMU's variable is in "
                         f"{port.unit or 'no unit'}", remedy)
            return
    if not isinstance(value, (str, bool)) and not port.minimum <= value <= port.maximum:
        report.error(binding.file, place, f"is {setting.value} {port.unit}, outside {port.minimum:g} .. "
                     f"{port.maximum:g}", "give a value within the limits")


def _check_combinations(structure: Structure, report: Report, otherwise: str | None) -> None:
    """Combinations of parameters an actuator of ours refuses at its initialization."""
    values = effective(structure)
    for path, element in elements(structure.system):
        if element.interface is None:
            continue
        ports, model = element.interface.ports, model_of(element.interface.model) or otherwise or NONLINEAR
        table = get(model).parameters
        if any(v.name not in ports for v in table):
            continue
        numbers = {v.name: values.get((path, v.name), typed(v.kind, ports[v.name].start or "0")) for v in table}
        for problem in check_parameters(numbers, model):
            report.error(structure.file, f"component {path}", problem, "change one of them")
