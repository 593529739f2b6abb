"""The option --set: values of parameters, of the shared supply, and of constant inputs."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterable, Mapping

from ..actuators import EXTENSIONS, get_extension
from ..actuators.supply_line import LINES
from ..errors import EmcasError, hint
from ..fmi.interface import FmuInterface
from ..parameters import ParameterError, ParameterSet
from ..parameters.schema import In

_FIN = re.compile(r"fin\[(\d+)\]\.(.+)")


def read_settings(texts: Iterable[str], interface: FmuInterface) -> tuple[
        Mapping[int, dict[str, object]], dict[str, float], dict[str, float]]:
    """Return the values of --set: parameters by fin (0: all fins), parameters of the supply, and constant inputs.

    Values of the supply and of inputs are in SI; those of parameters keep their unit: a number, a Boolean, or a text
    such as '5 deg'. Raises EmcasError.
    """
    inputs = {v.name: v for v in (*interface.actuator.inputs, *interface.inputs)}
    supply = {v.name: v for each in LINES.values() for v in each.parameters} if interface.fins > 1 else {}
    known = {part for v in interface.actuator.file_entries for part in (v.name, v.name.partition("[")[0])}
    parameters: dict[int, dict[str, object]] = defaultdict(dict)
    of_supply: dict[str, float] = {}
    constants: dict[str, float] = {}
    for text in texts:
        name, separator, entry = (part.strip() for part in text.partition("="))
        if not (name and separator and entry):
            raise EmcasError(f"--set {text}: expected a name and a value, as in --set controller.position.kp=70")
        if variable := inputs.get(name) or supply.get(name):
            (constants if name in inputs else of_supply)[name] = entered(f"--set {text}", entry, In.of(variable))
            continue
        fin = _FIN.fullmatch(name)
        number, parameter = (int(fin[1]), fin[2]) if fin and 1 <= int(fin[1]) <= interface.fins > 1 else (0, name)
        if parameter not in known:
            if fin and not number:
                raise EmcasError(f"--set {text}: there is no fin {fin[1]}; " + (
                    f"fins are 1 to {interface.fins}" if interface.fins > 1 else "fin[N] needs several fins: --fins"))
            raise EmcasError(f"--set {text}: {_unknown(parameter, interface, [*inputs, *supply, *known])}")
        parameters[number][parameter] = _value(entry)
    return parameters, of_supply, constants


def entered(option: str, entry: str, how: In) -> float:
    """Return an option's value in the unit of `how` from its text. Raises EmcasError.

    The text is a number with or without unit or, if `how` is Boolean, true or false (returned as 1 or 0).
    """
    value = _value(entry)
    unitless = not isinstance(value, (bool, str)) and how.unit not in ("", "1")
    try:
        return float(how.limited(f"{value} {how.unit}" if unitless else value))
    except ValueError as error:
        raise EmcasError(f"{option}: {error}") from error


def _unknown(name: str, interface: FmuInterface, known: Iterable[str]) -> str:
    """Return the reason why a name is refused: it needs several fins or an extension, or does not exist."""
    if interface.fins == 1 and name in {v.name for each in LINES.values() for v in each.parameters}:
        return "needs --fins: only several fins share a supply"
    lacks = f"the {interface.actuator.name} actuator has no such parameter or input"
    for extension in EXTENSIONS:
        if any(v.name == name for v in get_extension(extension).parameters(interface.actuator)):
            return f"{lacks}; it belongs to an extension: --model {interface.kind}+{extension}"
    return lacks + (hint(name, known) or f"; its inputs are {', '.join(v.name for v in interface.inputs)}; "
                                         "emcas parameters lists its parameters")


def changed(base: ParameterSet, changes: Mapping[str, object]) -> ParameterSet:
    """Return a parameter set with the values of --set. Raises ParameterError with the problem of each value."""
    try:
        return base.with_values(changes)
    except ParameterError as error:
        raise ParameterError(f"--set {problem.removeprefix('replaced value: ')}"
                             for problem in error.problems) from error


def _value(entry: str) -> bool | float | str:
    """Return the value of a text: true, false, a number in the variable's unit, or a text with a unit."""
    if entry.lower() in ("true", "false"):
        return entry.lower() == "true"
    try:
        return float(entry)
    except ValueError:
        return entry
