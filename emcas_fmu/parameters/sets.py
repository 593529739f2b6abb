"""Load, check and freeze a parameter set: values with unit, source and note from TOML files."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from dataclasses import replace as dataclass_replace
from functools import lru_cache, partial
from itertools import groupby
from math import inf
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from ..actuators import NAMES, NONLINEAR, default_files, extension_inputs, fin_port, full_name, get, parts
from ..actuators.declaration import Actuator
from ..errors import hint
from ..ops.arrays import ARRAYS
from ..ops.floats import FLOATS
from ..rules import SHARES, Check, Rule, check_ranges, check_rules
from ..support.arguments import checked
from ..support.files import as_given, models_directory, named_sets
from ..support.writing import write
from . import schema
from .entries import (
    Entry,
    ParameterError,
    Value,
    as_text,
    declared_names,
    file_entry,
    in_variables_unit,
    known_names,
    read_entries,
)

__all__ = ["MADE_FOR", "Entry", "ParameterError", "ParameterSet", "Value", "are_defaults", "broken_rules",
           "check_combinations", "check_parameters", "file_entry", "load_parameters", "parameter_file",
           "require_sound", "write_parameters"]

# Measured ones differ by saturation and by iron losses, a slip (rms for peak, phase for line to line) by 22 % or more.
_APART = 1.2

MADE_FOR = "made_for"
"""Of a parameter file: for which actuators, or with which +extensions, its values are meant."""


@checked
@dataclass(frozen=True)
class ParameterSet:
    """A complete, checked set of an actuator's parameters.

    `entries` are in the actuator's order. `unused` names what a user's file gives and this actuator does not have,
    though another one has it. `files` are those over the defaults, as they were given, with their SHA-256.
    """

    entries: tuple[Entry, ...]
    model: str = NONLINEAR
    unused: tuple[str, ...] = ()
    files: tuple[tuple[str, str], ...] = field(default=(), compare=False)

    def __repr__(self) -> str:
        given = sum(not e.default for e in self.entries)
        return f"<ParameterSet of {self.model}: {len(self.entries)} values, {given} given over the default ones>"

    @property
    def actuator(self) -> Actuator:
        """Whose parameters they are."""
        return get(self.model)

    @property
    def values(self) -> Mapping[str, Value]:
        """Read-only values by name, in the variables' units (SI, temperature in degC)."""
        return MappingProxyType({e.variable.name: e.value for e in self.entries})

    @property
    def estimates(self) -> tuple[str, ...]:
        """Names of the parameters that rest on an engineering estimate."""
        return tuple(e.variable.name for e in self.entries if e.source == "estimate")

    def estimates_in(self, names: Collection[str]) -> tuple[str, ...]:
        """Return those of the named parameters, or groups such as ``heat.``, that rest on an engineering estimate."""
        begins = tuple(names)
        return tuple(name for name in self.estimates if name.startswith(begins))

    @property
    def estimated_outputs(self) -> Mapping[str, tuple[str, ...]]:
        """By outputs that extensions add, the estimates that the extension computes them with."""
        rests = {output: self.estimates_in(names) for output, names in extension_inputs(self.model).items()}
        return {output: names for output, names in rests.items() if names}

    @property
    def warnings(self) -> tuple[str, ...]:
        """What is allowed and worth a look, one line each."""
        entries = {e.variable.name: e for e in self.entries}
        warnings = [_apart(entries[name], entries[other]) for name, other in self.actuator.equal_parameters]
        warnings += check_combinations(self.values, self.actuator, warnings=True)
        warnings += _messages(self.actuator.supply_rules, self.nested(), warnings=True).values()
        if self.unused:
            warnings.append(f"the {self.actuator.name} actuator has no {', '.join(self.unused)}: not used")
        return tuple(filter(None, warnings))

    def with_values(self, overrides: Mapping[str, object] | None = None, /, **more: object) -> ParameterSet:
        """Return a new checked set with some values replaced; the old one stays as it is.

        Numbers are in the variables' units, strings carry their own ("50 mm"); arrays may be
        given whole. Nothing else changes, unlike with a file. Raises ParameterError.
        """
        given = {**(overrides or {}), **more}
        document = {name: in_variables_unit(name, value, self.model) for name, value in given.items()}
        return _overridden(self, document, "replaced value", "")

    def having(self, values: Mapping[str, Any]) -> dict[str, Any]:
        """Return those of the values whose parameters this actuator has."""
        names = {e.variable.name for e in self.entries}
        return {name: value for name, value in values.items() if name in names}

    def nested(self) -> Any:
        """Return the values as attributes, ``p.kinematics.moment_arm``; arrays are tuples."""
        return self.actuator.namespace(self.values)


@checked
def parameter_file(given: Path | str, folder: Path = Path()) -> Path:
    """Return the file that is meant: as seen from a folder, or, where there is none, a shipped set by its name.

    Raises ParameterError for a bare name that is neither.
    """
    path, sets = folder / given, named_sets()
    if path.is_file() or Path(given).name != str(given) or path.suffix:
        return path
    if str(given) not in sets:
        raise ParameterError(f"{given}: there is neither such a file nor a parameter set of that name"
                             f"{hint(given, sets)}; the sets are {', '.join(sets)}")
    return sets[str(given)]


@checked
def load_parameters(files: Path | str | Iterable[Path | str] | None = None, base: ParameterSet | None = None,
                    model: str = NONLINEAR) -> ParameterSet:
    """Return the default set of an actuator, or `base`, overridden by the user's `files`: one, or several in order.

    A file may be given by the name of a shipped set, as `parameter_file` has it; together with those before it, it must
    make a sound set. The defaults are those of ``models/emcas.toml`` that the actuator has, with its parameter files
    over them, and those of its extensions. Of parameters that are equal in SI units, such as torque and back-EMF
    constant, one follows where the user's file gives only the other.

    Raises ParameterError with all problems of a file, FileNotFoundError where the default set is missing.
    """
    chosen = base if base is not None else _defaults(full_name(model))
    for given in [files] if isinstance(files, (str, Path)) else files or ():
        path = parameter_file(given)
        document = _document(path)
        _require_made_for(document.pop(MADE_FOR, None), path, chosen.model)
        chosen = _overridden(chosen, document, str(path), path.name)
        read = as_given(path), hashlib.sha256(path.read_bytes()).hexdigest()
        chosen = dataclass_replace(chosen, files=(*chosen.files, read))
    return chosen


def _require_made_for(made_for: Any, path: Path, model: str) -> None:
    """Raise ParameterError where a file says that it is for actuators, or +extensions, other than this shipped one.

    Whether it suits an actuator of the user's the user knows.
    """
    if made_for is None:
        return
    if not isinstance(made_for, list) or not made_for or not all(isinstance(each, str) for each in made_for):
        raise ParameterError(f"{path}: {MADE_FOR} = {made_for!r}: expected a list of names of actuators, or of "
                             'extensions with a +, such as ["elastic", "+heat"]')
    actuator, extensions = parts(model)
    if actuator in NAMES and not {actuator, *(f"+{each}" for each in extensions)} & set(made_for):
        name = path.stem if named_sets().get(path.stem) == path else str(path)
        raise ParameterError(f"{name}: is made for {', '.join(made_for)} ({MADE_FOR}) and not for {model}, where its "
                             "values mean nothing or were measured or tuned for another actuator: leave it out, or "
                             "give such a --model")


def _defaults(model: str) -> ParameterSet:
    files = (models_directory() / "emcas.toml", *default_files(model))
    return _read_defaults(model, files, tuple(file.read_bytes() if file.is_file() else b"" for file in files))


@lru_cache(maxsize=128)
def _read_defaults(model: str, files: tuple[Path, ...], contents: tuple[bytes, ...]) -> ParameterSet:
    """Return the defaults of files with these contents, `models/emcas.toml` first."""
    actuator, shipped = get(model), files[0]
    entries: dict[str, Entry] = {}
    for file in files:
        given, problems = read_entries(_document(file), str(file), file.name, "", known_names(model))
        if problems:
            raise ParameterError(problems)
        # Of a user's actuator a motor's resistance, say, is not that of the thesis: only the fin port's are taken.
        entries |= given if file != shipped or parts(model)[0] in NAMES else {
            v.name: given[v.name] for v in fin_port.PARAMETERS}
    for v in actuator.parameters:
        if v.start is not None and v.name not in entries:
            text = as_text({"value": v.start, "unit": v.unit})
            entries[v.name] = Entry(v, v.start, text, "derived", "As declared; no file gives it.", "")
    where = files[-1] if len(files) > 1 else files[0]
    if missing := [f"{where}: {v.name}: missing; the defaults must give every parameter of the {actuator.name} actuator"
                   for v in actuator.file_entries if v.name not in entries]:
        raise ParameterError(missing)
    return _checked(tuple(dataclass_replace(entries[v.name], default=True) for v in actuator.file_entries), model,
                    str(where))


def check_parameters(values: Mapping[str, Any], model: str = NONLINEAR) -> list[str]:
    """Return the problems of an actuator's flat values: names missing or unknown, limits, combinations."""
    actuator = get(model)
    known = {v.name for v in actuator.file_entries}
    missing = [f"{v.name} is missing" for v in actuator.parameters if v.name not in values]
    unknown = [f"there is no parameter {name}{hint(name, known)}" for name in values if name not in known]
    if missing or unknown:
        return missing + unknown
    limits = [(v.name, v.minimum, v.maximum) for v in actuator.parameters if v.kind != "Boolean"]
    return check_ranges(values, limits) or check_combinations(values, actuator)


def require_sound(values: Mapping[str, Any], model: str = NONLINEAR) -> None:
    """Raise ParameterError with the problems of an actuator's flat values, if there are any."""
    if problems := check_parameters(values, model):
        raise ParameterError(problems)


def check_combinations(values: Mapping[str, Any], actuator: Actuator, warnings: bool = False) -> list[str]:
    """Return a message for each rule of the actuator that its values, within their ranges, break.

    Of the rules that refuse, or of those that only warn (`warnings`).
    """
    return list(broken_rules(values, actuator, warnings).values())


def broken_rules(values: Mapping[str, Any], actuator: Actuator, warnings: bool = False) -> dict[Rule, str]:
    """Return those rules with their messages; see `check_combinations`."""
    return _messages(actuator.all_rules, actuator.namespace(values), warnings)


def _messages(rules: Iterable[Rule], p: Any, warnings: bool) -> dict[Rule, str]:
    return {rule: message for rule in rules if rule.warning == warnings
            for message in check_rules([_asked(rule, p)], warnings)}


def _asked(rule: Rule, p: Any) -> Check:
    """Return a rule bound to parameters; of a scanned one all shares of the travel are evaluated at once."""
    each = partial(rule.check, FLOATS, p), *rule[1:]
    if not rule.scanned:
        return each
    shares = np.array(SHARES)
    try:
        with np.errstate(all="ignore"):  # places where the rule gives no number are left out
            broken = np.broadcast_to(rule.check(ARRAYS, p, shares)[0], shares.shape)
    except Exception:  # a user's rule that is none of traced code: tracing says so  # noqa: BLE001
        return each
    worst = SHARES[int(np.argmax(np.where(np.isnan(broken), -inf, broken)))]
    return lambda _: rule.check(FLOATS, p, worst), rule.message, False, rule.warning


def are_defaults(parameters: ParameterSet) -> bool:
    """Return whether a set is the nonlinear actuator's with its default values, wherever they come from."""
    return parameters.model == NONLINEAR and dict(parameters.values) == dict(load_parameters().values)


def _document(path: Path) -> dict[str, Any]:
    # Numbers stay text: they are converted to the table's unit in decimal arithmetic.
    contents = schema.document(path, ParameterError, str)[1]
    if other := schema.misplaced(contents):
        raise ParameterError(f"{path}: is no parameter file: it {other}")
    return contents


def _overridden(base: ParameterSet, document: Mapping[str, Any], label: str, file: str) -> ParameterSet:
    """Return `base` with the entries of a document, checked as a whole once each entry is sound.

    A user's file may give what other actuators have; a program may not.
    """
    known = (known_names if file else declared_names)(base.model)
    entries, problems = read_entries(document, label, file, "user", known)
    if file:
        _follow(entries, problems, label, base)
    have = {e.variable.name for e in base.entries}
    unused = tuple(name for name in entries if name not in have)
    if problems:
        raise ParameterError(problems)
    chosen = _checked(tuple(entries.get(e.variable.name, e) for e in base.entries), base.model, label)
    return dataclass_replace(chosen, unused=tuple(dict.fromkeys((*base.unused, *unused))),
                             files=base.files)


def _checked(entries: tuple[Entry, ...], model: str, label: str) -> ParameterSet:
    chosen = ParameterSet(entries, model)
    if problems := check_combinations(chosen.values, get(model)):
        raise ParameterError([f"{label}: {problem}" for problem in problems])
    return chosen


def _follow(entries: dict[str, Entry], problems: list[str], label: str, base: ParameterSet) -> None:
    """Add the one of two equal parameters to a file's entries where it, and those before it, give only the other."""
    variables = {v.name: v for v in base.actuator.parameters}
    before = {e.variable.name: e for e in base.entries}
    shipped = {e.variable.name: e for e in _defaults(base.model).entries}
    for pair in base.actuator.equal_parameters:
        for given, name in (pair, pair[::-1]):
            followed = before[name] == shipped[name] or before[name].text == _as(given)
            if given not in entries or name in entries or not followed:
                continue
            value, variable = entries[given].value, variables[name]
            if value < variable.minimum:
                problems.append(f"{label}: {given} = {entries[given].text}: {name}, which follows from it, must be at "
                                f"least {variable.minimum:.6g} {variable.unit}; give that too")
            entries[name] = Entry(variable, value, _as(given), "derived",
                                  f"Follows from {given}, to which it is equal in SI units; the file does not give it.",
                                  entries[given].file)
            break


def _as(given: str) -> str:
    return f"as {given}"


def _apart(one: Entry, other: Entry) -> str:
    """Return a warning where two parameters that are equal in SI units are far apart; else nothing."""
    low, high = sorted((one.value, other.value))
    if high <= _APART * low:
        return ""
    return (f"{one.variable.name} = {one.text} and {other.variable.name} = {other.text} are {one.value:.6g} and "
            f"{other.value:.6g} in SI units, where they are equal for one motor: check rms or peak, phase or "
            "line to line; or give only one in a file, and the other follows")


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
    write(path, "\n".join([*lines, ""]))


def _entry_line(key: str, entries: Sequence[Entry]) -> str:
    """Return the line of one value, or of an array whole: its elements are of one source and note."""
    first, texts = entries[0], [json.dumps(e.value) for e in entries]
    fields = [f"value = [{', '.join(texts)}]" if len(texts) > 1 else f"value = {texts[0]}"]
    if first.variable.kind != "Boolean":
        fields.append(f"unit = {json.dumps(first.variable.unit)}")
    fields += [f"{name} = {json.dumps(text, ensure_ascii=False)}"
               for name, text in (("source", first.source), ("note", first.note)) if text]
    return f"{key} = {{ {', '.join(fields)} }}"


