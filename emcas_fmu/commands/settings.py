"""The option --set: values of parameters, of the line that feeds them, and constants of inputs."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterable, Mapping

from ..actuators.line import LINES
from ..errors import EmcasError, hint
from ..fmi.interface import FmuInterface
from ..parameters import ParameterError, ParameterSet
from ..schema import In

_FIN = re.compile(r"fin\[(\d+)\]\.(.+)")


def read_settings(texts: Iterable[str], unit: FmuInterface) -> tuple[
        Mapping[int, dict[str, object]], dict[str, float], dict[str, float]]:
    """Return what --set gives: parameters by fin (0: of every fin), those of the line, and constants of inputs.

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
        value = _value(entry)
        if variable := inputs.get(name) or line.get(name):
            try:
                plain = not isinstance(value, (bool, str)) and variable.unit not in ("", "1")
                number = In(variable.unit, variable.minimum, variable.maximum, type=variable.kind).limited(
                    f"{value} {variable.unit}" if plain else value)
            except ValueError as error:
                raise EmcasError(f"--set {text}: {error}") from error
            (constants if name in inputs else of_line)[name] = float(number)
            continue
        fin = _FIN.fullmatch(name)
        number, own = (int(fin[1]), fin[2]) if fin and 1 <= int(fin[1]) <= unit.fins > 1 else (0, name)
        if own not in known:
            remedy = hint(own, [*inputs, *line, *known]) or (
                f"; its inputs are {', '.join(inputs)}; emcas parameters lists its parameters")
            raise EmcasError(f"--set {text}: the {unit.actuator.name} actuator has no such parameter or input{remedy}")
        parameters[number][own] = value
    return parameters, of_line, constants


def changed(base: ParameterSet, changes: Mapping[str, object]) -> ParameterSet:
    """Return a set with what --set gives. Raises ParameterError."""
    try:
        return base.with_values(changes)
    except ParameterError as error:
        raise ParameterError(f"--set {problem.removeprefix('replaced value: ')}"
                             for problem in error.problems) from error


def _value(entry: str) -> bool | float | str:
    """Return true, false, a number that is in the variable's unit, or text with a unit of its own."""
    if entry.lower() in ("true", "false"):
        return entry.lower() == "true"
    try:
        return float(entry)
    except ValueError:
        return entry
