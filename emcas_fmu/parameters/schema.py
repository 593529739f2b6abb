"""TOML files as pydantic models; an error has a line for each problem, as `FILE: KEY = VALUE: reason`."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import inf
from pathlib import Path
from typing import Annotated, Any, TypeVar

from pydantic import BaseModel, ConfigDict, PlainValidator, ValidationError, model_validator
from pydantic_core import InitErrorDetails, PydanticCustomError, core_schema

from ..errors import EmcasError, hint, unreadable
from ..units import describe, quantity
from ..variables import Variable
from .toml import tomllib

MOST_PROBLEMS = 20
"""How many problems of a file are listed; of the others their number is."""
_MOST_NESTED = 50  # tables and lists inside each other
_LONGEST_INTEGER = 64  # bits, as TOML has it
_LONGEST_SHOWN = 60  # characters of a value in a message

T = TypeVar("T")
M = TypeVar("M", bound="Table")
Place = tuple[int | str, ...]
# Of pydantic's errors, those that TOML can cause, as a user reads them.
_REASONS = {"string_type": "must be a string", "bool_type": "expected true or false", "list_type": "must be a list",
            "int_type": "expected a whole number", "dict_type": "expected a table", "model_type": "expected a table",
            "too_short": "must have at least one entry", "greater_than_equal": "must be at least {ge}",
            "less_than_equal": "must be at most {le}"}


class Table(BaseModel):
    """A table of a file: its keys are the fields, and no others."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, arbitrary_types_allowed=True)

    @model_validator(mode="wrap")
    @classmethod
    def _in_words(cls, written: Any, handler: Any) -> Any:
        try:
            return handler(written)
        except ValidationError as error:
            problems = error.errors(include_url=False)
            raise failure([*(_worded(problem, list(cls.model_fields)) for problem in problems[:MOST_PROBLEMS]),
                           *(((), said, None) for said in further(problems))]) from error


def failure(problems: Iterable[tuple[Place, str, Any]]) -> ValidationError:
    """Return an error of several problems, each with its place below the table, the reason and the entry."""
    return ValidationError.from_exception_data("table", [
        InitErrorDetails(type=PydanticCustomError("reason", reason), loc=place, input=written)
        for place, reason, written in problems])


def further(problems: Sequence[Any]) -> list[str]:
    """Return what to say of problems beyond those that are listed."""
    return [f"and {len(problems) - MOST_PROBLEMS} problems more"] if len(problems) > MOST_PROBLEMS else []


def _worded(problem: Any, keys: list[str]) -> tuple[Place, str, Any]:
    kind, place, written, context = problem["type"], problem["loc"], problem["input"], problem.get("ctx", {})
    if kind in ("extra_forbidden", "missing"):
        what = f"{place[-1]} is missing" if kind == "missing" else f"unknown key {place[-1]!r}{hint(place[-1], keys)}"
        return place[:-1], f"{what}; there is {', '.join(keys)}", None
    if kind == "literal_error":
        return place, unknown(written, re.findall("'(.*?)'", context["expected"])), written
    if kind == "value_error":
        return place, str(context["error"]), written
    return place, _REASONS[kind].format(**context) if kind in _REASONS else problem["msg"], written


def unknown(word: Any, known: Iterable[str]) -> str:
    """Return what to say of a word that is none of those there are."""
    words = list(known)
    return f"{hint(word, words).removeprefix('; ')} there is {', '.join(words)}".lstrip()


def parameter_of(name: str, variables: Mapping[str, Variable], remedy: str = "") -> Variable:
    """Return the parameter of a name; `remedy` ends the message of the ValueError where there is none."""
    if name not in variables:
        raise ValueError(f"there is no such parameter{hint(name, variables)}{remedy}")
    return variables[name]


def named(tables: Any) -> Iterator[tuple[str, Any]]:
    """Yield the tables of a list with the names they give themselves. Raises ValueError."""
    if not isinstance(tables, list):
        raise ValueError("must be a list of tables")
    for i, table in enumerate(tables):
        yield str(table.get("name", f"[{i}]")) if isinstance(table, Mapping) else f"[{i}]", table


def leaves(table: Mapping[str, Any], is_group: Callable[[str, Mapping[str, Any]], Any], prefix: str = "",
           ) -> Iterator[tuple[str, Any]]:
    """Yield dotted names with what is written there; a table, by its name, for which `is_group` holds is gone into."""
    for key, written in table.items():
        name = f"{prefix}{key}"
        if isinstance(written, Mapping) and is_group(name, written):
            yield from leaves(written, is_group, f"{name}.")
        else:
            yield name, written


def each(entries: Any, read: Callable[[str, Any], T]) -> dict[str, T]:
    """Read the entries of a table, or of pairs of name and entry.

    Raises ValidationError with the problems of all of them, each below its name; ValueError for what is no table.
    """
    if isinstance(entries, Mapping):
        entries = entries.items()
    elif not isinstance(entries, (tuple, Iterator)):  # which no TOML file has
        raise ValueError("expected a table")
    values: dict[str, T] = {}
    problems: list[tuple[Place, str, Any]] = []
    for name, written in entries:
        if len(problems) >= MOST_PROBLEMS:
            problems.append(((), "further entries are not looked at", None))
            break
        try:
            if name in values:
                raise ValueError("is given twice")
            values[name] = read(name, written)
        except ValidationError as error:
            problems += [((name, *place), reason, given) for place, reason, given in
                         (_worded(problem, []) for problem in error.errors())]
        except (ValueError, EmcasError) as error:
            problems.append(((name,), str(error), written))
    if problems:
        raise failure(problems)
    return values


def kind_of(written: Any, kinds: Iterable[str], key: str = "kind") -> str:
    """Return which of several kinds of table this is, by its `key`. Raises ValueError or ValidationError."""
    known = list(kinds)
    if not isinstance(written, Mapping) or key not in written:
        raise ValueError(f"expected a table with a {key}; there is {', '.join(known)}")
    if written[key] not in known:
        raise failure([((key,), unknown(written[key], known), written[key])])
    return str(written[key])


@dataclass(frozen=True)
class In:
    """How a quantity is written: `unit`, limits, and the value a percentage refers to (`base`), all in that unit.

    As an annotation, `Annotated[float, In("rad")]`, a field of this quantity. `type` is Real, Integer or Boolean.
    """

    unit: str
    minimum: float = -inf
    maximum: float = inf
    base: float | None = None
    type: str = "Real"

    def number(self, written: Any) -> Any:
        """Return the value of what is written, in the unit; limits are not looked at. Raises ValueError."""
        if self.type == "Boolean":
            if not isinstance(written, bool):
                raise ValueError("expected true or false")
            return written
        if isinstance(written, bool) or not isinstance(written, (int, float, str)):
            raise ValueError(f"expected {describe(self.unit)}")
        text = str(written).strip()
        if text.endswith("%") and self.base is not None:
            if self.unit == "degC":
                raise ValueError("a percentage of a temperature says nothing; give it with a unit such as degC")
            value = quantity(text, "", "1") * self.base
        else:
            value = quantity(text, "", self.unit)
        if self.type == "Integer":
            if not value.is_integer():
                raise ValueError("expected a whole number")
            return int(value)
        return value

    def limited(self, written: Any) -> Any:
        """Return the value of what is written, if it is within the limits. Raises ValueError."""
        value = self.number(written)
        if not self.minimum <= value <= self.maximum:
            raise ValueError(f"must be {self.limits}")
        return value

    @classmethod
    def of(cls, variable: Variable, base: float | None = None) -> In:
        """Return how a value of a parameter or input is written."""
        return cls(variable.unit, variable.minimum, variable.maximum, base, variable.kind)

    @property
    def limits(self) -> str:
        """Between what values lie, for people."""
        unit = "" if self.unit == "1" else f" {self.unit}"
        return f"within {self.minimum:g} .. {self.maximum:g}{unit}"

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> core_schema.CoreSchema:
        return core_schema.no_info_plain_validator_function(self.limited)


Quantity = Annotated[Any, PlainValidator(lambda written, info: info.context.number(written))]
"""A field in the unit of the `In` that is the context; its limits are not looked at."""


def document(path: Path, error: type[EmcasError], number: Callable[[str], Any] = float) -> tuple[str, dict[str, Any]]:
    """Return text and contents of a TOML file; `number` makes what a decimal number becomes. Raises `error`."""
    try:
        text = path.read_text(encoding="utf-8-sig")
        contents = tomllib.loads(text, parse_float=number)
        _check_contents(contents)
        return text, contents
    except (OSError, UnicodeDecodeError) as problem:
        raise error(unreadable(path, problem)) from problem
    except (ValueError, RecursionError) as problem:
        raise error(f"{path}: is not valid TOML: {problem}") from problem


# What a file is, by a table that only this kind has.
_KINDS = {"tunables": "a tuning study; run it with `emcas tune FILE`",
          "vary": "a campaign; run it with `emcas campaign FILE`",
          "requirements": "a file of requirements; give it as `--requirements FILE`"}


def misplaced(contents: Mapping[str, Any], expected: str = "") -> str:
    """Return what a file is by its contents if it is not of the kind with the `expected` table; else nothing."""
    return next((f"is {what}" for key, what in _KINDS.items() if key in contents and key != expected), "")


def _check_contents(contents: Mapping[str, Any]) -> None:
    """Raise ValueError for what nests too deep to be gone through, or a whole number that no line can hold."""
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
    """Return a file's contents as `model`, whose validators are given `context`. Raises `error` with all problems."""
    try:
        return model.model_validate(written, context=context)
    except ValidationError as caught:
        raise error("\n".join(_line(path, problem) for problem in caught.errors(include_url=False))) from None


def load(model: type[M], path: Path, error: type[EmcasError], context: Any = None) -> M:
    """Return a TOML file as `model`; see `read`."""
    return read(model, document(path, error)[1], path, error, context)


def shortened(written: object) -> str:
    """Return a value as it is shown in a message."""
    text = str(written)
    return text if len(text) <= _LONGEST_SHOWN else f"{text[:_LONGEST_SHOWN]}…"


def _line(path: Path, problem: Any) -> str:
    place, written = ".".join(map(str, problem["loc"])), problem["input"]
    if isinstance(written, bool):
        written = str(written).lower()
    value = f" = {shortened(written)}" if isinstance(written, (int, float, str)) else ""
    return f"{path}: {place}{value}: {problem['msg']}" if place else f"{path}: {problem['msg']}"
