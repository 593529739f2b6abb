"""Entries of a parameter file, each a value with unit, source and note: read and checked one by one."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from math import isclose, radians
from numbers import Integral, Real
from typing import Any

from ..actuators import EXTENSIONS, NAMES, get, get_extension, parts
from ..errors import EmcasError, hint
from ..variables import Variable
from . import schema

Scalar = float | int | bool

IDENTIFIED = "identified"
"""Source of a value that was identified from measurements."""

_FIELDS = ("value", "unit", "source", "note")
# A value within this relative distance from a limit is set to the limit: another unit in the file may round it.
_ROUNDING = 1e-12
# Present names by former names, for hints only.
_RENAMED = {f"friction.cold_{kind}_ratio": f"friction.table.{kind}" for kind in ("viscous", "coulomb")}


class ParameterError(EmcasError, ValueError):
    """Parameters that cannot be used; each of `problems` is a message with file, key, value and remedy."""

    def __init__(self, problems: str | Iterable[str]) -> None:
        each = (problems,) if isinstance(problems, str) else problems
        self.problems = tuple(" ".join(str(problem).splitlines()) for problem in each)  # names may contain line ends
        super().__init__("\n".join(self.problems))

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.problems,)


class Known:
    """Names that a file or program may use; `unknown` begins the message for any other name."""

    def __init__(self, variables: Iterable[Variable], unknown: str = "unknown parameter") -> None:
        self.unknown = unknown
        self.variables = {v.name: v for v in variables}
        self.lengths = Counter(name.partition("[")[0] for name in self.variables if "[" in name)  # of arrays
        self.names = [*self.variables, *self.lengths]
        self.groups = {"", *(name.rsplit(".", i)[0] for name in self.names for i in range(1, name.count(".") + 1))}


@cache
def _shipped() -> tuple[Variable, ...]:
    actuators = [get(name) for name in NAMES]
    extensions = [get_extension(name) for name in EXTENSIONS]
    return (*(v for actuator in actuators for v in actuator.file_entries),
            *(v for extension in extensions for actuator in actuators for v in extension.parameters(actuator)))


@cache
def known_names(model: str) -> Known:
    """Return the names that a user's file may use: those of all shipped actuators and of `model`, with all extensions.

    If `model` declares a name, its declaration applies. Raises EmcasError for an unknown model.
    """
    extensions, plain = map(get_extension, EXTENSIONS), get(parts(model)[0])
    return Known((*_shipped(), *(v for each in extensions for v in each.parameters(plain)), *get(model).file_entries))


@cache
def declared_names(model: str) -> Known:
    """Return the names of one actuator's file entries. Raises EmcasError for an unknown model."""
    return Known(get(model).file_entries, f"the {get(model).name} actuator has no such parameter")


@dataclass(frozen=True)
class Entry:
    """One value in its variable's unit, and its origin.

    `text` is the value as written, with its unit. `source` is ``thesis``, ``derived``, ``tuned`` or ``estimate`` in the
    default set, otherwise ``user``, ``identified`` or the user's word. `file` is the name of the file, empty for a
    value that a program sets. `default` is true in the default set.
    """

    variable: Variable
    value: Scalar
    text: str
    source: str
    note: str
    file: str
    default: bool = field(default=False, compare=False)


def read_entries(
    document: Mapping[str, Any], label: str, file: str, source: str, known: Known,
) -> tuple[dict[str, Entry], list[str]]:
    """Return the valid entries of a document by name, and messages about the others.

    `label` begins each message; `file` is the name of the file, `source` the source of entries that have none.
    """
    entries: dict[str, Entry] = {}
    errors: list[tuple[str, Mapping[str, Any], ValueError]] = []

    def is_group(name: str, table: Mapping[str, Any]) -> bool:
        return name not in known.names and "value" not in table and bool(table or name in known.groups)

    for key, written in schema.leaves(document, is_group):
        try:
            for name, fields in _scalars(key, written, known):
                try:
                    if name in entries:
                        raise ValueError("is set twice")
                    entries[name] = _entry(known.variables[name], fields, source, file)
                except ValueError as error:
                    errors.append((name, fields, error))
        except ValueError as error:
            errors.append((key, {"value": written}, error))
    problems = [f"{label}: {name} = {as_text(fields)}: {error}"
                for name, fields, error in errors[:schema.MOST_PROBLEMS]]
    return entries, problems + [f"{label}: {message}" for message in schema.further(errors)]


def _scalars(key: str, written: Any, known: Known) -> Iterator[tuple[str, Mapping[str, Any]]]:
    """Yield name and fields of the scalar that a key sets, or of each element of an array.

    Raises ValueError for an unknown name, a group, or an array of another length.
    """
    fields = written if isinstance(written, Mapping) else {"value": written}
    if key in known.variables:
        yield key, fields
    elif key in known.lengths:
        elements = fields.get("value")
        if not isinstance(elements, (list, tuple)) or len(elements) != known.lengths[key]:
            raise ValueError(f"expected an array of {known.lengths[key]} values")
        for i, element in enumerate(elements):
            yield f"{key}[{i}]", {**fields, "value": element}
    elif key in known.groups:
        raise ValueError("is a group of parameters; expected a table such as "
                         f"{next(name for name in known.names if name.startswith(key + '.'))}")
    else:
        raise _UnknownNameError(key, known)


class _UnknownNameError(ValueError):
    """An unknown name; the nearest known name is searched for only when the message is printed."""

    def __str__(self) -> str:
        key, known = self.args
        return f"{known.unknown}{hint(_RENAMED.get(key, key), known.names)}"


def _entry(variable: Variable, fields: Mapping[str, Any], source: str, file: str) -> Entry:
    """Return the entry of a scalar. Raises ValueError with the problem and the expected value."""
    for key in fields:
        if key not in _FIELDS:
            raise ValueError(f"unknown field {key!r}{hint(key, _FIELDS)}; "
                             f"an entry has {', '.join(_FIELDS)}")
    if "value" not in fields:
        raise ValueError("has no value")
    for key in _FIELDS[1:]:
        if not isinstance(fields.get(key, ""), str):
            raise ValueError(f"{key} = {fields[key]!r}: expected a string")
    return Entry(variable, _value(variable, fields), as_text(fields), fields.get("source", source),
                 fields.get("note", ""), file)


def _value(variable: Variable, fields: Mapping[str, Any]) -> Scalar:
    """Return the value of a scalar in the variable's unit. Raises ValueError with the problem."""
    if variable.kind == "Boolean" and "unit" in fields and isinstance(fields["value"], bool):
        raise ValueError("true and false have no unit")
    value: Scalar = schema.In.of(variable).number(fields["value"], fields.get("unit", ""))
    limits = (variable.minimum, variable.maximum)
    value = next((type(value)(limit) for limit in limits if isclose(value, limit, rel_tol=_ROUNDING)), value)
    if not limits[0] <= value <= limits[1]:
        unit = "" if variable.unit == "1" else f" {variable.unit}"
        degrees = variable.unit == "rad" and limits[0] <= radians(value) <= limits[1]
        raise ValueError(f"is {value:.6g}{unit}; it must be within {limits[0]:.6g} .. {limits[1]:.6g}{unit}"
                         f"{f'; did you mean {value:.6g} deg?' if degrees else ''}")
    return value


def in_variables_unit(name: str, value: object, model: str) -> object:
    """Return a program's value in a parameter file's form: a number as text with the unit of the variable `name`."""
    if isinstance(value, (list, tuple)):
        return [in_variables_unit(f"{name}[{i}]", element, model) for i, element in enumerate(value)]
    if isinstance(value, bool) or not isinstance(value, Real):
        return value
    variable = known_names(model).variables.get(name)
    unit = variable.unit if variable else ""
    text = str(int(value)) if isinstance(value, Integral) else repr(float(value))
    return f"{text} {unit}" if unit and unit != "1" else text


def file_entry(values: Sequence[float], unit: str, source: str, note: str) -> dict[str, object]:
    """Return the table of a parameter file for one value, or for an array, in `unit`."""
    texts = [repr(float(value)) for value in values]
    return {"value": texts if len(texts) > 1 else texts[0], "unit": unit, "source": source, "note": note}


def as_text(fields: Mapping[str, Any]) -> str:
    """Return the value in the fields of an entry as its file contains it, with its unit."""
    value, unit = fields.get("value", "(nothing)"), fields.get("unit", "")
    text = str(value).lower() if isinstance(value, bool) else schema.shortened(value)
    return text if unit in ("", "1") else f"{text} {unit}"
