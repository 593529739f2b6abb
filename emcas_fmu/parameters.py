"""Load, check and freeze a parameter set: values with unit, source and note from TOML files."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from itertools import groupby
from math import isclose
from numbers import Integral, Real
from pathlib import Path
from types import MappingProxyType
from typing import Any

from .actuators import NONLINEAR, every_own, get, parts
from .actuators.model import Actuator
from .consistency import check_consistency, check_ranges
from .errors import EmcasError
from .files import models_directory
from .toml import tomllib
from .tree import tree
from .units import describe, quantity
from .variables import FILE_ENTRIES, Variable

Value = float | int | bool

_VARIABLES = {v.name: v for v in FILE_ENTRIES + every_own()}
_TABLE = tuple(v.name for v in FILE_ENTRIES)
_LENGTHS = Counter(name.partition("[")[0] for name in _VARIABLES if "[" in name)  # of the arrays
_NAMES = [*_VARIABLES, *_LENGTHS]
_GROUPS = {"", *(name.rsplit(".", i)[0] for name in _NAMES for i in range(1, name.count(".") + 1))}
_FIELDS = ("value", "unit", "source", "note")
# A limit that reached the file through another unit is still that limit.
_ROUNDING = 1e-12
# One constant of the motor: K_t i w = K_e w i, the power that leaves the circuit and the one on the shaft.
_TORQUE, _BACK_EMF = "motor.torque_constant", "motor.back_emf_constant"
_FOLLOWS = {_TORQUE: _BACK_EMF, _BACK_EMF: _TORQUE}
# Measured ones differ by saturation and by iron losses, a slip (rms for peak, phase for line to line) by 22 % or more.
_APART = 1.2


class ParameterError(EmcasError, ValueError):
    """Parameters that cannot be used; `problems` has one message each, naming file, key, value and remedy."""

    def __init__(self, problems: Iterable[str]) -> None:
        self.problems = tuple(problems)
        super().__init__("\n".join(self.problems))

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.problems,)


@dataclass(frozen=True)
class Entry:
    """One value in its variable's unit, and where it comes from.

    `text` is the value as written; `source` is ``seed``, ``derived`` or ``estimate`` in the
    default set, and ``user`` or what the user calls it elsewhere; `file` is the name of the
    file, empty for values set in a program.
    """

    variable: Variable
    value: Value
    text: str
    source: str
    note: str
    file: str


@dataclass(frozen=True)
class ParameterSet:
    """A complete, checked set of a model's parameters.

    `entries` are in the order of the variable table's FILE_ENTRIES, then of the model's own.
    """

    entries: tuple[Entry, ...]
    model: str = NONLINEAR

    @property
    def values(self) -> Mapping[str, Value]:
        """Read-only values by name, in the variable table's units (SI, temperature in degC)."""
        return MappingProxyType({e.variable.name: e.value for e in self.entries})

    @property
    def warnings(self) -> tuple[str, ...]:
        """What is allowed and most likely a mistake, one line each."""
        torque, back_emf = (next(e for e in self.entries if e.variable.name == name) for name in (_TORQUE, _BACK_EMF))
        low, high = sorted((torque.value, back_emf.value))
        if high <= _APART * low:
            return ()
        return (f"{_TORQUE} = {torque.text} and {_BACK_EMF} = {back_emf.text} are {torque.value:.6g} and "
                f"{back_emf.value:.6g} in SI units, where they are equal for one motor: check rms or peak, phase or "
                "line to line; or give only one, and the other follows",)

    def replace(self, overrides: Mapping[str, object] | None = None, /, **more: object) -> ParameterSet:
        """A new checked set with some values replaced; the old one stays as it is.

        Numbers are in the variable table's units, strings carry their own ("50 mm"); arrays may be
        given whole. Nothing else changes, unlike with a file. Raises ParameterError.
        """
        given = {**(overrides or {}), **more}
        document = {name: _in_table_unit(name, value) for name, value in given.items()}
        return _overridden(self.entries, document, "replaced value", "", self.model)

    def nested(self) -> Any:
        """The values as attributes, ``p.kinematics.moment_arm``; arrays are tuples."""
        return tree(self.values)


def load_parameters(files: Path | str | Iterable[Path | str] | None = None, base: ParameterSet | None = None,
                    model: str = NONLINEAR) -> ParameterSet:
    """Return the default set of a model, or `base`, overridden by the user's `files`: one, or several in their order.

    Each file together with those before it must make a sound set. A model's default set is the nonlinear one's with
    ``models/actuators/MODEL.toml`` over it, which must give every parameter of its own, and
    ``models/options/OPTION.toml`` of each of its options.

    Torque and back-EMF constant are equal in SI units: where the user's file gives one of them, the other follows.

    Raises ParameterError with all problems of a file, FileNotFoundError where the default set is missing.
    """
    if base is not None:
        for path in [files] if isinstance(files, (str, Path)) else files or ():
            base = _overridden(base.entries, _document(Path(path)), str(path), Path(path).name, base.model)
        return base
    default = models_directory() / "emcas.toml"
    entries, problems = _entries(_document(default), str(default), default.name, "")
    missing = [f"{default}: {name}: missing; the default file must give every parameter"
               for name in _TABLE if name not in entries]
    if problems := problems or missing:
        raise ParameterError(problems)
    defaults = _overridden(tuple(entries[name] for name in _TABLE), {}, str(default), default.name, NONLINEAR)
    base_model, options = parts(model)
    shipped = [] if base_model == NONLINEAR else [models_directory() / "actuators" / f"{base_model}.toml"]
    shipped += [models_directory() / "options" / f"{option}.toml" for option in options]
    return load_parameters(files, _of_model(defaults, get(model), shipped) if shipped else defaults)


def _of_model(defaults: ParameterSet, actuator: Actuator, files: Sequence[Path]) -> ParameterSet:
    entries: dict[str, Entry] = {}
    for file in files:
        found, problems = _entries(_document(file), str(file), file.name, "")
        if problems:
            raise ParameterError(problems)
        entries |= found
    where = ", ".join(map(str, files))
    if missing := [f"{where}: {v.name}: missing; every parameter of the model's own must be given"
                   for v in actuator.own if v.name not in entries]:
        raise ParameterError(missing)
    chosen = [entries.get(e.variable.name, e) for e in defaults.entries]
    return _overridden((*chosen, *(entries[v.name] for v in actuator.own)), {}, where, files[-1].name, actuator.name)


def check_parameters(values: Mapping[str, Any], model: str = NONLINEAR) -> list[str]:
    """Problems of a model's flat values in the table's units: names missing or unknown, limits, combinations."""
    table = get(model).parameters
    missing = [f"{v.name} is missing" for v in table if v.name not in values]
    unknown = [f"there is no parameter {name}{_hint(name, _NAMES)}" for name in values if name not in _VARIABLES]
    if missing or unknown:
        return missing + unknown
    limits = [(v.name, v.minimum, v.maximum) for v in table if v.kind != "Boolean"]
    return check_ranges(values, limits) or check_consistency({v.name: values[v.name] for v in table})


def are_defaults(parameters: ParameterSet) -> bool:
    """Whether a set is the nonlinear model's with its default values, wherever they come from."""
    return parameters.model == NONLINEAR and dict(parameters.values) == dict(load_parameters().values)


def _document(path: Path) -> dict[str, Any]:
    try:
        # Floats stay text: they are converted to the table's unit in decimal arithmetic.
        document: dict[str, Any] = tomllib.loads(path.read_text(encoding="utf-8-sig"), parse_float=str)
    except OSError as error:
        raise ParameterError([f"{path}: cannot be read: {error.strerror or error}"]) from error
    except UnicodeDecodeError as error:
        raise ParameterError([f"{path}: is not a text file in UTF-8: {error}"]) from error
    except (ValueError, RecursionError) as error:
        raise ParameterError([f"{path}: is not valid TOML: {error}"]) from error
    return document


def _overridden(base: tuple[Entry, ...], document: Mapping[str, Any], label: str, file: str,
                model: str) -> ParameterSet:
    """`base` with the entries of a document, checked as a whole once each entry is sound."""
    entries, problems = _entries(document, label, file, "user")
    if file:
        _follow(entries, problems, label)
    known = {e.variable.name for e in base}
    problems += [f"{label}: {name}: the {model} model has no such parameter" for name in entries if name not in known]
    chosen = ParameterSet(tuple(entries.get(e.variable.name, e) for e in base), model)
    problems = problems or [f"{label}: {problem}" for problem in check_consistency(chosen.values)]
    if problems:
        raise ParameterError(problems)
    return chosen


def _follow(entries: dict[str, Entry], problems: list[str], label: str) -> None:
    """Add the torque or back-EMF constant to a file's entries where it gives only the other."""
    for given, name in _FOLLOWS.items():
        if given not in entries or name in entries:
            continue
        value, variable = entries[given].value, _VARIABLES[name]
        if value < variable.minimum:
            problems.append(f"{label}: {given} = {entries[given].text}: {name}, which follows from it, must be at "
                            f"least {variable.minimum:.6g} {variable.unit}; give that too")
        entries[name] = Entry(variable, value, f"as {given}", "derived",
                              f"Follows from {given}, to which it is equal in SI units; the file does not give it.",
                              entries[given].file)
        return


def _entries(
    document: Mapping[str, Any], label: str, file: str, source: str,
) -> tuple[dict[str, Entry], list[str]]:
    """The sound entries of a document and the problems of the others."""
    entries: dict[str, Entry] = {}
    problems = []
    for key, written in _leaves(document):
        try:
            for name, fields in _scalars(key, written):
                try:
                    if name in entries:
                        raise ValueError("given twice")
                    entries[name] = _entry(_VARIABLES[name], fields, source, file)
                except ValueError as error:
                    problems.append(f"{label}: {name} = {_text(fields)}: {error}")
        except ValueError as error:
            problems.append(f"{label}: {key} = {_text({'value': written})}: {error}")
    return entries, problems


def _leaves(node: Mapping[str, Any], path: str = "") -> Iterator[tuple[str, Any]]:
    """Dotted keys with what is written there; tables that are no entry are descended into."""
    for part, written in node.items():
        key = f"{path}.{part}" if path else part
        descend = isinstance(written, Mapping) and key not in _NAMES and "value" not in written
        if descend and (written or key in _GROUPS):
            yield from _leaves(written, key)
        else:
            yield key, written


def _scalars(key: str, written: Any) -> Iterator[tuple[str, Mapping[str, Any]]]:
    """Names and fields of a key's scalars: one, or one an element of an array."""
    fields = written if isinstance(written, Mapping) else {"value": written}
    if key in _VARIABLES:
        yield key, fields
    elif key in _LENGTHS:
        elements = fields.get("value")
        if not isinstance(elements, (list, tuple)) or len(elements) != _LENGTHS[key]:
            raise ValueError(f"expected an array of {_LENGTHS[key]} values")
        for i, element in enumerate(elements):
            yield f"{key}[{i}]", {**fields, "value": element}
    elif key in _GROUPS:
        raise ValueError("is a group of parameters; expected a table such as "
                         f"{next(name for name in _NAMES if name.startswith(key + '.'))}")
    else:
        raise ValueError(f"unknown parameter{_hint(key, _NAMES)}")


def _entry(variable: Variable, fields: Mapping[str, Any], source: str, file: str) -> Entry:
    """The entry of a scalar. Raises ValueError, saying what is wrong and what was expected."""
    for field in fields:
        if field not in _FIELDS:
            raise ValueError(f"unknown field {field!r}{_hint(field, _FIELDS)}; "
                             f"an entry has {', '.join(_FIELDS)}")
    if "value" not in fields:
        raise ValueError("has no value")
    for field in _FIELDS[1:]:
        if not isinstance(fields.get(field, ""), str):
            raise ValueError(f"{field} = {fields[field]!r}: expected a string")
    if variable.kind == "Boolean":
        value: Value = _boolean(fields)
    else:
        value = _number(variable, fields["value"], fields.get("unit", ""))
    return Entry(variable, value, _text(fields), fields.get("source", source), fields.get("note", ""), file)


def _boolean(fields: Mapping[str, Any]) -> bool:
    if not isinstance(fields["value"], bool):
        raise ValueError("expected true or false")
    if "unit" in fields:
        raise ValueError("true and false have no unit")
    return fields["value"]


def _number(variable: Variable, written: Any, written_unit: str) -> float | int:
    # TOML floats are text here, see _document.
    if not isinstance(written, (int, str)):
        raise ValueError(f"expected {describe(variable.unit)}")
    value = quantity(str(written), written_unit, variable.unit)
    limits = (variable.minimum, variable.maximum)
    value = next((limit for limit in limits if isclose(value, limit, rel_tol=_ROUNDING)), value)
    if check_ranges({variable.name: value}, [(variable.name, *limits)]):
        unit = "" if variable.unit == "1" else f" {variable.unit}"
        raise ValueError(f"is {value:.6g}{unit}; it must be within {limits[0]:.6g} .. {limits[1]:.6g}{unit}")
    if variable.kind == "Integer" and not float(value).is_integer():
        raise ValueError("expected a whole number")
    return int(value) if variable.kind == "Integer" else value


def _in_table_unit(name: str, value: object) -> object:
    """What a parameter file would say for a value given in a program."""
    if isinstance(value, (list, tuple)):
        return [_in_table_unit(f"{name}[{i}]", element) for i, element in enumerate(value)]
    if isinstance(value, bool) or not isinstance(value, Real):
        return value
    unit = _VARIABLES[name].unit if name in _VARIABLES else ""
    text = str(int(value)) if isinstance(value, Integral) else repr(float(value))
    return f"{text} {unit}" if unit and unit != "1" else text


def write_parameters(parameters: ParameterSet, path: Path, comments: Iterable[str]) -> None:
    """Write a parameter file of all that a set has changed from its model's default set, below lines of comment.

    Values are in the variable table's units, each with its source and note: loaded, the file gives the same set.
    """
    shipped = {e.variable.name: e for e in load_parameters(model=parameters.model).entries}
    lines = [*(f"# {comment}" for comment in comments), ""]
    for array, group in groupby(parameters.entries, lambda e: e.variable.name.partition("[")[0]):
        entries = list(group)
        changed = [e for e in entries if e != shipped[e.variable.name]]
        if changed == entries and len({(e.source, e.note) for e in entries}) == 1:
            lines.append(_entry_line(array, entries))
        else:
            lines += [_entry_line(json.dumps(e.variable.name), [e]) for e in changed]
    path.write_text("\n".join([*lines, ""]), encoding="utf-8", newline="\n")


def _entry_line(key: str, entries: Sequence[Entry]) -> str:
    """The line of one value, or of an array whole: its elements are of one source and note."""
    first, texts = entries[0], [json.dumps(e.value) for e in entries]
    fields = [f"value = [{', '.join(texts)}]" if len(texts) > 1 else f"value = {texts[0]}"]
    if first.variable.kind != "Boolean":
        fields.append(f"unit = {json.dumps(first.variable.unit)}")
    fields += [f"{name} = {json.dumps(text, ensure_ascii=False)}"
               for name, text in (("source", first.source), ("note", first.note)) if text]
    return f"{key} = {{ {', '.join(fields)} }}"


def file_entry(values: Sequence[float], unit: str, source: str, note: str) -> dict[str, object]:
    """Return what a parameter file would say of a value, or of an array, in the variable table's unit."""
    texts = [repr(float(value)) for value in values]
    return {"value": texts if len(texts) > 1 else texts[0], "unit": unit, "source": source, "note": note}


def _text(fields: Mapping[str, Any]) -> str:
    """A value as its file has it, with its unit."""
    value, unit = fields.get("value", "(nothing)"), fields.get("unit", "")
    text = str(value).lower() if isinstance(value, bool) else str(value)
    return text if unit in ("", "1") else f"{text} {unit}"


def _hint(word: str, known: Iterable[str]) -> str:
    close = get_close_matches(word, list(known), 1)
    return f"; did you mean {close[0]}?" if close else ""
