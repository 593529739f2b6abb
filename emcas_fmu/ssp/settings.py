"""Parameter sets of a structure: what each says about which variable, and whether it may."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from ..actuators import NONLINEAR, get
from ..bench.fmu import model_of
from ..parameters import check_parameters
from .findings import Log, nearest
from .interface import Interface
from .structure import Binding, Element, Setting, Structure, systems
from .units import conversion

Value = float | int | bool | str
Values = dict[tuple[str, str], Value]  # by path of the component (empty: the system) and name of the variable


@dataclass(frozen=True)
class Target:
    """What a setting is for: the path of an element (with a dot at its end, if any), the element and its variable."""

    path: str
    element: Element
    name: str


def target(system: Element, name: str, path: str = "") -> Target | None:
    """The variable a hierarchical name means inside a system or component; None if there is no such element."""
    if not system.elements or name in system.connectors:
        return Target(path, system, name)
    for element in system.elements.values():
        if name.startswith(f"{element.name}."):
            return target(element, name[len(element.name) + 1:], f"{path}{element.name}.")
    return None


def _bindings(structure: Structure) -> Iterator[tuple[str, Element, Binding]]:
    """All bindings in the order they count in, the last most: inner ones first, then in the order given."""
    for path, system in reversed(list(systems(structure.system))):
        for element in system.elements.values():
            if element.type != "system":
                yield from ((f"{path}{element.name}.", element, b) for b in element.bindings)
        yield from ((path, system, b) for b in system.bindings)


def effective(structure: Structure) -> Values:
    """What the standard makes of all bindings together. Names that mean nothing and bad values are left out."""
    values: Values = {}
    for path, element, binding in _bindings(structure):
        values.update(_values(path, element, binding))
    return values


def _values(path: str, element: Element, binding: Binding) -> Values:
    values: Values = {}
    for setting in () if binding.mapped else binding.settings:
        found = target(element, binding.prefix + setting.name, path)
        try:
            if found is not None:
                values[found.path.removesuffix("."), found.name] = setting.typed
        except ValueError:
            continue
    return values


def check_settings(structure: Structure, interfaces: Mapping[int, Interface], loose: Sequence[Binding],
                   log: Log, model: str | None = None) -> None:
    """Check all parameter sets of a structure, and the `loose` ones with hierarchical names that belong to it.

    `model` is the actuator of those FMUs that do not tell their own.
    """
    bound = list(_bindings(structure))
    for path, element, binding in (*bound, *(("", structure.system, b) for b in loose)):
        if binding.mapped:
            log.warning(structure.file, f"binding of {binding.file}", "has a ParameterMapping, which is not checked",
                        "check it yourself; libcosim, Ecos and fmpy ignore it")
            continue
        for setting in binding.settings:
            log.parameters += 1
            found = target(element, binding.prefix + setting.name, path)
            place = f"parameter {binding.prefix}{setting.name}"
            if found is None:
                log.error(binding.file, place, "is of no element of the system", nearest(
                    binding.prefix + setting.name, [*element.connectors, *(f"{n}." for n in element.elements)],
                    f"begin it with one of {', '.join(f'{n}.' for n in element.elements)}"))
            elif id(found.element) in interfaces:
                _variable(structure, binding, setting, place, found, interfaces[id(found.element)], log)
            elif found.name not in found.element.connectors and found.element.type == "system":
                log.error(binding.file, place, f"the system has no connector {found.name}",
                          nearest(found.name, found.element.connectors, "remove it"))
            elif (fed := _fed(found, interfaces)) is not None:
                _variable(structure, binding, setting, place, fed, interfaces[id(fed.element)], log)
    files = {structure.file, *(binding.file for _, _, binding in bound)}
    if not any(f.level == "error" and f.file in files for f in log.findings):  # else it is asked of wrong numbers
        _sense(structure, interfaces, log, model)
    _agreement(structure, bound, loose, log)


def _fed(setting: Target, interfaces: Mapping[int, Interface]) -> Target | None:
    """The first variable of an FMU that a connector of a system is wired to, however many systems further in."""
    for connection in setting.element.connections:
        for near, far in ((connection.start, connection.end), (connection.end, connection.start)):
            element = setting.element.elements.get(far[0])
            if near != ("", setting.name) or element is None:
                continue
            inner = Target(f"{setting.path}{far[0]}.", element, far[1])
            if id(element) in interfaces:
                return inner
            if element.type == "system" and (found := _fed(inner, interfaces)) is not None:
                return found
    return None


def _variable(structure: Structure, binding: Binding, setting: Setting, place: str, found: Target,
              interface: Interface, log: Log) -> None:
    port = interface.ports.get(found.name)
    if port is None:
        settable = [p.name for p in interface.ports.values() if p.settable]
        log.error(binding.file, place, f"the FMU has no variable {found.name}",
                  nearest(found.name, settable, "remove it"))
        return
    if not port.settable:
        log.error(binding.file, place, f"is {port.causality} of the FMU and cannot be set", "remove it")
        return
    if setting.type != port.kind:
        log.error(binding.file, place, f"is given as {setting.type}, but is {port.kind} in the FMU",
                  f"write ssv:{port.kind}")
        return
    try:
        value = setting.typed
    except ValueError as error:
        log.error(binding.file, place, f"{setting.value!r} is no {setting.type} ({error})",
                  "write a value of that type")
        return
    if value is False:
        log.warning(binding.file, place, "is false, which fmpy's read_ssv and simulate_ssp take for true",
                    "make it the FMU's start value instead: emcas build --parameters FILE")
    if setting.unit and setting.unit != port.unit:
        mine = binding.units.get(setting.unit) or structure.units.get(setting.unit) or interface.units.get(setting.unit)
        theirs = interface.units.get(port.unit)
        factor = conversion(mine, theirs) if mine and theirs else None
        if factor is None or not factor.identity:
            remedy = f"give it in {port.unit}" if factor is None or isinstance(value, str) else (
                f"write {factor(float(value)):.12g} {port.unit}: no host converts here")
            log.error(binding.file, place, f"is given in {setting.unit}, but the FMU's variable is in "
                      f"{port.unit or 'no unit'}", remedy)
            return
    if not isinstance(value, (str, bool)) and not port.minimum <= value <= port.maximum:
        log.error(binding.file, place, f"is {setting.value} {port.unit}, outside {port.minimum:g} .. {port.maximum:g}",
                  "give a value within the limits")


def _agreement(structure: Structure, bound: Sequence[tuple[str, Element, Binding]], loose: Sequence[Binding],
               log: Log) -> None:
    """Sets for hosts that do not compose must say what the composed ones do, or hosts run different systems."""
    composed: Values = {}
    for path, element, binding in bound:
        if element.elements:
            composed.update(_values(path, element, binding))
    alone = [(path, element, binding) for path, element, binding in bound if not element.elements]
    for path, element, binding in (*alone, *(("", structure.system, b) for b in loose)):
        for (component, name), value in _values(path, element, binding).items():
            if composed.get((component, name), value) != value:
                log.warning(binding.file, f"parameter {'.'.join(filter(None, (component, name)))}",
                            f"is {value}, but {composed[component, name]} by the sets {structure.file} binds to its "
                            "system: hosts that read the one or the other differ",
                            "change both, or write the archive anew from a parameter file")


def _sense(structure: Structure, interfaces: Mapping[int, Interface], log: Log, otherwise: str | None) -> None:
    """Combinations an actuator of ours refuses at its initialization."""
    values = effective(structure)
    for path, system in systems(structure.system):
        for element in system.elements.values():
            interface = interfaces.get(id(element))
            if interface is None:
                continue
            model = model_of(interface.model) or otherwise or NONLINEAR
            table = get(model).parameters
            if any(v.name not in interface.ports for v in table):
                continue
            numbers: dict[str, Value] = {}
            for v in table:
                start = interface.ports[v.name].start or "0"
                numbers[v.name] = values.get((f"{path}{element.name}", v.name), Setting(
                    v.name, v.kind, start.lower() if v.kind == "Boolean" else start, "").typed)
            for problem in check_parameters(numbers, model):
                log.error(structure.file, f"component {path}{element.name}", problem, "change one of them")
