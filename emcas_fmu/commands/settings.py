"""The option --set: values of parameters, of the shared supply, and of constant inputs."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterable, Mapping

from ..actuators import EXTENSIONS, get_extension
from ..actuators.line import LINES
from ..errors import EmcasError, hint
from ..fmi.interface import FmuInterface
from ..parameters import ParameterError, ParameterSet
from ..parameters.schema import In

_FIN = re.compile(r"fin\[(\d+)\]\.(.+)")


def read_settings(texts: Iterable[str], unit: FmuInterface) -> tuple[
        Mapping[int, dict[str, object]], dict[str, float], dict[str, float]]:
    """Return the values of --set: parameters by fin (0: all fins), parameters of the supply, and constant inputs.

    Raises EmcasError.
    """
    inputs = {v.name: v for v in (*unit.actuator.inputs, *unit.inputs)}
    line = {v.name: v for each in LINES.values() for v in each.parameters} if unit.fins > 1 else {}
    known = {part for v in unit.actuator.file_entries for part in (v.name, v.name.partition("[")[0])}
    parameters: dict[int, dict[str, object]] = defaultdict(dict)
    of_line: dict[str, float] = {}
    constants: dict[str, float] = {}
    for text in texts:
        name, separator, entry = (part.strip() for part in text.partition("="))
        if not (name and separator and entry):
            raise EmcasError(f"--set {text}: expected a name and a value, as in --set controller.position.kp=70")
        if variable := inputs.get(name) or line.get(name):
            (constants if name in inputs else of_line)[name] = entered(f"--set {text}", entry, In.of(variable))
            continue
        fin = _FIN.fullmatch(name)
        number, parameter = (int(fin[1]), fin[2]) if fin and 1 <= int(fin[1]) <= unit.fins > 1 else (0, name)
        if parameter not in known:
            if fin and not number:
                raise EmcasError(f"--set {text}: there is no fin {fin[1]}; " + (
                    f"fins are 1 to {unit.fins}" if unit.fins > 1 else "fin[N] needs --fins, several fins"))
            raise EmcasError(f"--set {text}: {_unknown(parameter, unit, [*inputs, *line, *known])}")
        parameters[number][parameter] = _value(entry)
    return parameters, of_line, constants


def entered(option: str, entry: str, how: In) -> float:
    """Return the value of an option, a number in the unit of `how` unless the text has one. Raises EmcasError."""
    value = _value(entry)
    plain = not isinstance(value, (bool, str)) and how.unit not in ("", "1")
    try:
        return float(how.limited(f"{value} {how.unit}" if plain else value))
    except ValueError as error:
        raise EmcasError(f"{option}: {error}") from error


def _unknown(name: str, unit: FmuInterface, known: Iterable[str]) -> str:
    """Return why an FMU does not have a name: it belongs to several fins or to an extension, or is misspelt."""
    if unit.fins == 1 and name in {v.name for each in LINES.values() for v in each.parameters}:
        return "needs --fins, several fins that share a supply"
    lacks = f"the {unit.actuator.name} actuator has no such parameter or input"
    for extension in EXTENSIONS:
        if any(v.name == name for v in get_extension(extension).parameters(unit.actuator)):
            return f"{lacks}; it is of an extension: --model {unit.kind}+{extension}"
    return lacks + (hint(name, known) or f"; its inputs are {', '.join(v.name for v in unit.inputs)}; "
                                         "emcas parameters lists its parameters")


def changed(base: ParameterSet, changes: Mapping[str, object]) -> ParameterSet:
    """Return a parameter set with the values of --set. Raises ParameterError."""
    try:
        return base.with_values(changes)
    except ParameterError as error:
        raise ParameterError(f"--set {problem.removeprefix('replaced value: ')}"
                             for problem in error.problems) from error


def _value(entry: str) -> bool | float | str:
    """Return true, false, a number in the variable's unit, or text with a unit."""
    if entry.lower() in ("true", "false"):
        return entry.lower() == "true"
    try:
        return float(entry)
    except ValueError:
        return entry
