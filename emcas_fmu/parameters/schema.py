"""TOML files as pydantic models; the message of an error has a line `FILE: KEY = VALUE: reason` for each problem."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import inf
from pathlib import Path
from typing import Annotated, Any, TypeVar

from pydantic import BaseModel, ConfigDict, PlainValidator, ValidationError, create_model, model_validator
from pydantic_core import InitErrorDetails, PydanticCustomError, core_schema

from ..errors import EmcasError, hint, unreadable
from ..units import describe, quantity
from ..variables import Variable
from .toml import tomllib

MOST_PROBLEMS = 20
"""Most problems of a file that are listed; the others are only counted."""
_MOST_NESTED = 50  # most tables and lists inside each other
_LONGEST_INTEGER = 64  # bits of a whole number, by the TOML specification
_LONGEST_SHOWN = 60  # most characters of a value in a message

T = TypeVar("T")
M = TypeVar("M", bound="Table")
Location = tuple[int | str, ...]
# Messages for pydantic's errors that a TOML file can cause.
_REASONS = {"string_type": "must be a string", "bool_type": "expected true or false", "list_type": "must be a list",
            "int_type": "expected a whole number", "dict_type": "expected a table", "model_type": "expected a table",
            "too_short": "must have at least one entry", "greater_than_equal": "must be at least {ge}",
            "less_than_equal": "must be at most {le}"}


class Table(BaseModel):
    """A table of a file. Its keys are the fields of the class; other keys are refused."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, arbitrary_types_allowed=True)

    @classmethod
    def of_kind(cls, kind: str, fields: Mapping[str, Any]) -> type[Any]:
        """Return the class of tables of a kind, with further fields, each defined by its type and default."""
        return create_model(kind, __base__=cls, kind=(str, ...), **fields)

    @model_validator(mode="wrap")
    @classmethod
    def _in_words(cls, written: Any, handler: Any) -> Any:
        try:
            return handler(written)
        except ValidationError as error:
            problems = error.errors(include_url=False)
            raise failure([*(_worded(problem, list(cls.model_fields)) for problem in problems[:MOST_PROBLEMS]),
                           *(((), message, None) for message in further(problems))]) from error


def failure(problems: Iterable[tuple[Location, str, Any]]) -> ValidationError:
    """Return an error with `problems`: for each the keys that lead to it in the table, the reason and the entry."""
    return ValidationError.from_exception_data("table", [
        InitErrorDetails(type=PydanticCustomError("reason", reason), loc=location, input=written)
        for location, reason, written in problems])


def further(problems: Sequence[Any]) -> list[str]:
    """Return a list with a message about the problems beyond MOST_PROBLEMS; it is empty if there are none."""
    return [f"and {len(problems) - MOST_PROBLEMS} more problems"] if len(problems) > MOST_PROBLEMS else []


def _worded(problem: Any, keys: list[str]) -> tuple[Location, str, Any]:
    kind, location, written, context = problem["type"], problem["loc"], problem["input"], problem.get("ctx", {})
    if kind in ("extra_forbidden", "missing"):
        reason = (f"{location[-1]} is missing" if kind == "missing" else
                  f"unknown key {location[-1]!r}{hint(location[-1], keys)}")
        return location[:-1], f"{reason}; there is {', '.join(keys)}", None
    if kind == "literal_error":
        return location, unknown(written, re.findall("'(.*?)'", context["expected"])), written
    if kind == "value_error":
        return location, str(context["error"]), written
    return location, _REASONS[kind].format(**context) if kind in _REASONS else problem["msg"], written


def unknown(word: Any, known: Iterable[str]) -> str:
    """Return the message for an unknown word, with the nearest known word and all of them."""
    words = list(known)
    return f"{hint(word, words).removeprefix('; ')} there is {', '.join(words)}".lstrip()


def parameter_of(name: str, variables: Mapping[str, Variable], remedy: str = "") -> Variable:
    """Return the parameter with a name. Raises ValueError, whose message ends with `remedy`, if there is none."""
    if name not in variables:
        raise ValueError(f"there is no such parameter{hint(name, variables)}{remedy}")
    return variables[name]


def named(tables: Any) -> Iterator[tuple[str, Any]]:
    """Yield name (key `name`, or ``[index]``) and table of each table in a list. Raises ValueError if it is no list."""
    if not isinstance(tables, list):
        raise ValueError("must be a list of tables")
    for i, table in enumerate(tables):
        yield str(table.get("name", f"[{i}]")) if isinstance(table, Mapping) else f"[{i}]", table


def leaves(table: Mapping[str, Any], is_group: Callable[[str, Mapping[str, Any]], Any], prefix: str = "",
           ) -> Iterator[tuple[str, Any]]:
    """Yield the dotted names and values of a table and of the tables in it for which `is_group(name, table)` holds."""
    for key, written in table.items():
        name = f"{prefix}{key}"
        if isinstance(written, Mapping) and is_group(name, written):
            yield from leaves(written, is_group, f"{name}.")
        else:
            yield name, written


def each(entries: Any, read: Callable[[str, Any], T]) -> dict[str, T]:
    """Return the entries of a table, or of pairs of name and entry, each converted by `read(name, entry)`.

    Raises ValidationError with the problems, at most about MOST_PROBLEMS, each with its entry's name; ValueError if it
    is no table.
    """
    if isinstance(entries, Mapping):
        entries = entries.items()
    elif not isinstance(entries, (tuple, Iterator)):  # neither can come from a TOML file
        raise ValueError("expected a table")
    values: dict[str, T] = {}
    problems: list[tuple[Location, str, Any]] = []
    for name, written in entries:
        if len(problems) >= MOST_PROBLEMS:
            problems.append(((), "the entries after these are not checked", None))
            break
        try:
            if name in values:
                raise ValueError("appears twice")
            values[name] = read(name, written)
        except ValidationError as error:
            problems += [((name, *location), reason, entry) for location, reason, entry in
                         (_worded(problem, []) for problem in error.errors())]
        except (ValueError, EmcasError) as error:
            problems.append(((name,), str(error), written))
    if problems:
        raise failure(problems)
    return values


def kind_of(written: Any, kinds: Iterable[str], key: str = "kind") -> str:
    """Return the kind of a table, the value of its `key`.

    Raises ValueError if the key is missing, ValidationError for a kind that is not in `kinds`.
    """
    known = list(kinds)
    if not isinstance(written, Mapping) or key not in written:
        raise ValueError(f"expected a table with a {key}; there is {', '.join(known)}")
    if written[key] not in known:
        raise failure([((key,), unknown(written[key], known), written[key])])
    return str(written[key])


@dataclass(frozen=True)
class In:
    """Format of a quantity: its unit and, in this unit, its limits and the `base` to which a percentage refers.

    `Annotated[float, In("rad")]` declares a field with this format. `type` is Real, Integer or Boolean.
    """

    unit: str
    minimum: float = -inf
    maximum: float = inf
    base: float | None = None
    type: str = "Real"

    def number(self, written: Any, unit: str = "") -> Any:
        """Return the value of an entry in this format's unit. Raises ValueError for another quantity or type.

        `unit` is the unit of the entry if its text contains none. Limits are not checked.
        """
        if self.type == "Boolean":
            if not isinstance(written, bool):
                raise ValueError("expected true or false")
            return written
        if isinstance(written, bool) or not isinstance(written, (int, float, str)):
            raise ValueError(f"expected {describe(self.unit)}")
        text = str(written).strip()
        if text.endswith("%") and self.base is not None:
            if self.unit == "degC":
                raise ValueError("a percentage of a temperature has no meaning; write it with a unit such as degC")
            value = quantity(text, "", "1") * self.base
        else:
            value = quantity(text, unit, self.unit)
        if self.type == "Integer":
            if not value.is_integer():
                raise ValueError("expected a whole number")
            return int(value)
        return value

    def limited(self, written: Any) -> Any:
        """Return the value of an entry in this format's unit. Raises ValueError, also beyond the limits."""
        value = self.number(written)
        if not self.minimum <= value <= self.maximum:
            raise ValueError(f"must be {self.limits}")
        return value

    @classmethod
    def of(cls, variable: Variable, base: float | None = None) -> In:
        """Return the format of a parameter or input."""
        return cls(variable.unit, variable.minimum, variable.maximum, base, variable.kind)

    @property
    def suffix(self) -> str:
        """The unit after a number: a space and the unit, empty for a pure number."""
        return "" if self.unit == "1" else f" {self.unit}"

    @property
    def limits(self) -> str:
        """The limits in words."""
        return f"within {self.minimum:g} .. {self.maximum:g}{self.suffix}"

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> core_schema.CoreSchema:
        return core_schema.no_info_plain_validator_function(self.limited)


WrittenNumber = Annotated[Any, PlainValidator(lambda written, info: info.context.number(written))]
"""A field in the unit of the validation context, which is an `In`; limits are not checked."""


def document(path: Path, error: type[EmcasError], number: Callable[[str], Any] = float) -> tuple[str, dict[str, Any]]:
    """Return text and contents of a TOML file, with decimal numbers as `number(text)`. Raises `error` if that fails."""
    try:
        text = path.read_text(encoding="utf-8-sig")
        contents = tomllib.loads(text, parse_float=number)
        _check_contents(contents)
        return text, contents
    except (OSError, UnicodeDecodeError) as problem:
        raise error(unreadable(path, problem)) from problem
    except (ValueError, RecursionError) as problem:
        raise error(f"{path}: is not valid TOML: {problem}") from problem


# Kinds of files, each by a table that no other kind has.
_PURPOSES = {"tunables": "a tuning study; run it with `emcas tune FILE`",
             "vary": "a campaign; run it with `emcas campaign FILE`",
             "requirements": "a file of requirements; use it as `--requirements FILE`"}


def misplaced(contents: Mapping[str, Any], expected: str = "") -> str:
    """Return the kind of a file in words if it is another kind than that with the `expected` table; otherwise ""."""
    return next((f"is {kind}" for key, kind in _PURPOSES.items() if key in contents and key != expected), "")


def _check_contents(contents: Mapping[str, Any]) -> None:
    """Raise ValueError for tables or lists that are nested too deeply, and for a whole number of too many bits."""
    nodes: list[tuple[Any, int]] = [(contents, 0)]
    while nodes:
        node, depth = nodes.pop()
        if depth > _MOST_NESTED:
            raise ValueError(f"tables or lists are more than {_MOST_NESTED} inside each other")
        if isinstance(node, int) and node.bit_length() >= _LONGEST_INTEGER:
            raise ValueError(f"a whole number has more than {_LONGEST_INTEGER} bits")
        nodes += [(each, depth + 1) for each in
                  (node.values() if isinstance(node, dict) else node if isinstance(node, list) else ())]


def read(model: type[M], written: Mapping[str, Any], path: Path, error: type[EmcasError], context: Any = None) -> M:
    """Return a file's contents as a `model`, validated with `context`. Raises `error` with a line for each problem."""
    try:
        return model.model_validate(written, context=context)
    except ValidationError as caught:
        raise error("\n".join(_line(path, problem) for problem in caught.errors(include_url=False))) from None


def load(model: type[M], path: Path, error: type[EmcasError], context: Any = None) -> M:
    """Return the contents of a TOML file as a `model`, as :func:`read` does."""
    return read(model, document(path, error)[1], path, error, context)


def shortened(written: object) -> str:
    """Return a value as text for a message, shortened."""
    text = str(written)
    return text if len(text) <= _LONGEST_SHOWN else f"{text[:_LONGEST_SHOWN]}…"


def _line(path: Path, problem: Any) -> str:
    location, written = ".".join(map(str, problem["loc"])), problem["input"]
    if isinstance(written, bool):
        written = str(written).lower()
    value = f" = {shortened(written)}" if isinstance(written, (int, float, str)) else ""
    return f"{path}: {location}{value}: {problem['msg']}" if location else f"{path}: {problem['msg']}"
