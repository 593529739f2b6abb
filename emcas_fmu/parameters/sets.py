"""Parameter sets: loaded from TOML files, checked as a whole, and written again."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from dataclasses import replace as dataclass_replace
from functools import lru_cache
from itertools import chain, groupby
from pathlib import Path
from types import MappingProxyType
from typing import Any

from ..actuators import (
    NONLINEAR,
    default_files,
    extension_inputs,
    fin_port,
    full_name,
    get,
    get_extension,
    is_shipped,
    parts,
)
from ..actuators.declaration import Actuator
from ..errors import EmcasError, declared_in, hint
from ..support.arguments import checked
from ..support.files import as_given, models_directory, named_sets
from ..support.writing import write
from . import schema, toml
from .checks import check_combinations, messages
from .entries import (
    IDENTIFIED,
    Entry,
    ParameterError,
    Scalar,
    as_text,
    declared_names,
    in_variables_unit,
    known_names,
    read_entries,
)
from .measured import MeasuredRecord, measured_records

# Largest ratio of constants that should be equal. Saturation and iron losses make measured constants differ by less; a
# mistake (rms for peak, phase for line to line) is 22 % or more.
_APART = 1.2

MADE_FOR = "made_for"
"""Key of a parameter file: the list of actuators or +extensions for which the file's values are meant."""
EXTENDS = "extends"
"""Key of a parameter file: the list of +extensions that the file adds to the actuator."""


@checked
@dataclass(frozen=True)
class ParameterSet:
    """A complete, checked set of an actuator's parameters.

    `entries` are in the actuator's order. `unused` are names in a user's file that only other actuators have. `files`
    are name, as passed, and SHA-256 of each file loaded over the defaults. `records` are those that the files name.
    """

    entries: tuple[Entry, ...]
    model: str = NONLINEAR
    unused: tuple[str, ...] = ()
    files: tuple[tuple[str, str], ...] = field(default=(), compare=False)
    records: tuple[MeasuredRecord, ...] = field(default=(), compare=False)

    def __repr__(self) -> str:
        changed = sum(not e.default for e in self.entries)
        return f"<ParameterSet of {self.model}: {len(self.entries)} values, {changed} over the default ones>"

    @property
    def actuator(self) -> Actuator:
        """The actuator that has these parameters."""
        return get(self.model)

    @property
    def values(self) -> Mapping[str, Scalar]:
        """Values by name in the variables' units (SI, temperature in degC); read-only."""
        return MappingProxyType({e.variable.name: e.value for e in self.entries})

    @property
    def estimates(self) -> tuple[str, ...]:
        """Names of the parameters that are engineering estimates."""
        return tuple(e.variable.name for e in self.entries if e.source == "estimate")

    @property
    def measured(self) -> tuple[MeasuredRecord, ...]:
        """The records of the files from which the set still has an identified value."""
        files = {e.file for e in self.entries if e.source == IDENTIFIED}
        return tuple(dict.fromkeys(record for record in self.records if record.file in files))

    def estimates_in(self, names: Collection[str]) -> tuple[str, ...]:
        """Return the engineering estimates whose names begin with one of `names`, which may be groups as ``heat.``."""
        prefixes = tuple(names)
        return tuple(name for name in self.estimates if name.startswith(prefixes))

    @property
    def estimated_outputs(self) -> Mapping[str, tuple[str, ...]]:
        """The names of the estimates from which outputs of extensions are computed, by output; others are left out."""
        estimates = {output: self.estimates_in(names) for output, names in extension_inputs(self.model).items()}
        return {output: names for output, names in estimates.items() if names}

    @property
    def warnings(self) -> tuple[str, ...]:
        """Messages about values that are allowed but unusual, one line each."""
        entries = {e.variable.name: e for e in self.entries}
        warnings = [_apart(entries[name], entries[other]) for name, other in self.actuator.equal_parameters]
        warnings += check_combinations(self.values, self.actuator, warnings=True)
        warnings += messages(self.actuator.supply_rules, self.nested(), warnings=True).values()
        warnings += map(self._of_another_size, parts(self.model)[1])
        if self.unused:
            warnings.append(f"the {self.actuator.name} actuator has no {', '.join(self.unused)}: not used")
        return tuple(filter(None, warnings))

    def _of_another_size(self, extension: str) -> str:
        """Return a warning if an extension in use has defaults of the default actuator's size; otherwise ""."""
        switch, actuator = get_extension(extension).command_switch, parts(self.model)[0]
        if not switch or actuator == NONLINEAR or not float(self.values[switch]) > 0.0:
            return ""
        left = [e.variable.name for e in self.entries if e.default and e.variable.name.startswith(f"{extension}.")]
        return (f"{', '.join(left)}: still the values for the default actuator, while {actuator} may be slower or "
                "faster; set them, or begin with a set made for it (emcas parameters --sets)") if left else ""

    def with_values(self, overrides: Mapping[str, object] | None = None, /, **more: object) -> ParameterSet:
        """Return a new checked set with some values replaced.

        Numbers are in the variables' units; text contains its unit ("50 mm"). An array may be replaced as a whole.
        Unlike in a file, a parameter that should be equal to a replaced one keeps its value. Raises ParameterError with
        all problems.
        """
        values = {**(overrides or {}), **more}
        document = {name: in_variables_unit(name, value, self.model) for name, value in values.items()}
        return _overridden(self, document, "replaced value", "")

    def having(self, values: Mapping[str, Any]) -> dict[str, Any]:
        """Return the items of `values`, by name, that are parameters of this actuator."""
        names = {e.variable.name for e in self.entries}
        return {name: value for name, value in values.items() if name in names}

    def nested(self) -> Any:
        """Return the values as attributes, ``p.kinematics.moment_arm``; arrays are tuples."""
        return self.actuator.namespace(self.values)


def shipped_file(kind: str, model: str) -> Path:
    """Return the first path that exists: models/KIND/MODEL.toml, models/KIND/ACTUATOR.toml, else models/KIND.toml."""
    named = (models_directory() / kind / f"{name}.toml" for name in (model, parts(model)[0]))
    return next((path for path in named if path.is_file()), models_directory() / f"{kind}.toml")


@checked
def parameter_file(name: Path | str, folder: Path = Path()) -> Path:
    """Return the path of a parameter file, relative to a folder, or of a shipped set by its name.

    Raises ParameterError for a name without a suffix that is neither a file nor a set.
    """
    path, sets = folder / name, named_sets()
    if path.is_file() or Path(name).name != str(name) or path.suffix:
        return path
    if str(name) not in sets:
        raise ParameterError(f"{name}: there is neither such a file nor a parameter set of that name"
                             f"{hint(name, sets)}; the sets are {', '.join(sets)}")
    return sets[str(name)]


@checked
def load_parameters(files: Path | str | Iterable[Path | str] | None = None, base: ParameterSet | None = None,
                    model: str = NONLINEAR) -> ParameterSet:
    """Return the default set of an actuator, or `base`, overridden by `files`: one file, or several in their order.

    A file may be the name of a shipped set (see `parameter_file`); its values for an actuator may be in
    ``models/sets/NAME/ACTUATOR.toml``. The set must be sound after each file. The defaults come from
    ``models/emcas.toml``, as far as the actuator has these parameters, then from the files of the actuator and its
    extensions. Some parameters, such as torque and back-EMF constant, are equal in SI units: if a file sets only one of
    them, the other follows.

    Raises ParameterError with all problems of a file, EmcasError for an unknown model, FileNotFoundError if
    ``models/emcas.toml`` is missing.
    """
    chosen = base if base is not None else _defaults(full_name(model))
    for name in [files] if isinstance(files, (str, Path)) else files or ():
        given = parameter_file(name)
        path = shipped_file(f"sets/{given.stem}", chosen.model) if _is_shipped_set(given) else given
        file = path.name if path == given else f"{given.stem}/{path.name}"
        document = _document(path)
        added = _names(document, EXTENDS, path)
        _require_made_for(_names(document, MADE_FOR, path), path, chosen.model, added)
        chosen = _extended(chosen, added, path)
        chosen = _overridden(chosen, document, str(path), file)
        content = path.read_bytes()
        chosen = dataclass_replace(
            chosen, files=(*chosen.files, (as_given(given), hashlib.sha256(content).hexdigest())),
            records=(*chosen.records, *measured_records(file, content)))
    return chosen


def _is_shipped_set(path: Path) -> bool:
    return named_sets().get(path.stem) == path


def _names(document: dict[str, Any], key: str, path: Path) -> tuple[str, ...]:
    """Remove the names of actuators or +extensions at `key` from a document, and return them; () without the key."""
    names = document.pop(key, ())
    if names != () and not (names and isinstance(names, list) and all(isinstance(each, str) for each in names)):
        raise ParameterError(f"{path}: {key} = {names!r}: write a list of names of actuators, or of "
                             'extensions with a +, such as ["elastic", "+heat"]')
    return tuple(names)


def _extended(base: ParameterSet, extensions: tuple[str, ...], path: Path) -> ParameterSet:
    """Return the set of the actuator of `base` with these +extensions; the values of `base` replace defaults."""
    actuator, present = parts(base.model)
    if not (added := [each.removeprefix("+") for each in extensions if each.removeprefix("+") not in present]):
        return base
    try:
        defaults = _defaults(full_name("+".join((actuator, *present, *added))))
    except EmcasError as error:
        raise ParameterError(f"{path}: {error}") from error
    present_entries = {e.variable.name: e for e in base.entries}
    return dataclass_replace(defaults, entries=tuple(present_entries.get(e.variable.name, e) for e in defaults.entries),
                             unused=base.unused, files=base.files, records=(*defaults.records, *base.records))


def _require_made_for(made_for: tuple[str, ...], path: Path, model: str, added: tuple[str, ...]) -> None:
    """Raise ParameterError if a file is made for actuators or +extensions, but for none of the shipped `model`.

    `added` are the extensions that the file adds. A user's actuator may use any file.
    """
    if not made_for:
        return
    actuator, extensions = parts(model)
    if is_shipped(model) and not {actuator, *(f"+{each}" for each in extensions), *added} & set(made_for):
        name = str(path)
        if _is_shipped_set(path):
            name = path.stem
            made_for = (*made_for, *(each.stem for each in sorted(path.with_suffix("").glob("*.toml"))))
        raise ParameterError(f"{name}: is made for {', '.join(made_for)} ({MADE_FOR}) and not for {model}, for which "
                             "its values have no meaning, or were not measured or tuned: leave it out, or choose a "
                             "model for which it is made")


def _defaults(model: str) -> ParameterSet:
    files = (models_directory() / "emcas.toml", *default_files(model))
    return _read_defaults(model, files, tuple(file.read_bytes() if file.is_file() else b"" for file in files))


@lru_cache(maxsize=128)
def _read_defaults(model: str, files: tuple[Path, ...], contents: tuple[bytes, ...]) -> ParameterSet:
    """Return the default set of files with these contents, `models/emcas.toml` first."""
    actuator, (shipped, *added) = get(model), files
    source = actuator.source or Path(actuator.name)

    def read(document: Mapping[str, Any], file: Path, origin: str = "") -> dict[str, Entry]:
        valid, problems = read_entries(document, str(file), file.name, origin, known_names(model))
        if problems:
            raise ParameterError(problems)
        return valid

    entries = read(_document(shipped), shipped)
    if not is_shipped(model):
        # Motor and fin of a user's actuator are not those of the thesis: only the fin port's limits, mounting and
        # sampling apply.
        none = {v.name: 0.0 for v in fin_port.TURNING if v.minimum <= 0.0}
        entries = {v.name: entries[v.name] for v in fin_port.PARAMETERS if v not in fin_port.TURNING} | read(
            {name: in_variables_unit(name, value, model) for name, value in none.items()}, source, "derived")
    entries |= read({name: in_variables_unit(name, value, model) for name, value in actuator.values.items()}, source,
                    "estimate")
    for file in added:
        entries |= read(_document(file), file)
    for v in actuator.parameters:
        if v.start is not None and v.name not in entries:
            text = as_text({"value": v.start, "unit": v.unit})
            entries[v.name] = Entry(v, v.start, text, "derived", "As declared; no file sets it.", "")
    where = [shipped, *added][-1] if is_shipped(model) else [source, *actuator.files][-1]
    if missing := [f"{declared_in(where, v.name) if where == actuator.source else where}: {v.name}: missing; the "
                   f"defaults must contain every parameter of the {actuator.name} actuator"
                   for v in actuator.file_entries if v.name not in entries]:
        raise ParameterError(missing)
    made = _checked(tuple(dataclass_replace(entries[v.name], default=True) for v in actuator.file_entries), model,
                    str(where))
    records = (measured_records(file.name, content) for file, content in zip(files, contents, strict=True))
    return dataclass_replace(made, records=tuple(chain.from_iterable(records)))


def are_defaults(parameters: ParameterSet) -> bool:
    """Return whether the values of a set are those of the nonlinear actuator's default set."""
    return parameters.model == NONLINEAR and dict(parameters.values) == dict(load_parameters().values)


def _document(path: Path) -> dict[str, Any]:
    # Numbers remain text: they are converted to the variable's unit in decimal arithmetic.
    contents = schema.document(path, ParameterError, str)[1]
    if other := schema.misplaced(contents):
        raise ParameterError(f"{path}: is not a parameter file: it {other}")
    return contents


def _overridden(base: ParameterSet, document: Mapping[str, Any], label: str, file: str) -> ParameterSet:
    """Return `base` with the entries of a document; the whole set is checked if each entry is valid.

    A file may contain parameters of other actuators; values from a program (`file` "") may not. Raises ParameterError.
    """
    known = (known_names if file else declared_names)(base.model)
    entries, problems = read_entries(document, label, file, "user", known)
    if file:
        _follow(entries, problems, label, base)
    names = {e.variable.name for e in base.entries}
    unused = tuple(name for name in entries if name not in names)
    if problems:
        raise ParameterError(problems)
    chosen = _checked(tuple(entries.get(e.variable.name, e) for e in base.entries), base.model, label)
    return dataclass_replace(chosen, unused=tuple(dict.fromkeys((*base.unused, *unused))),
                             files=base.files, records=base.records)


def _checked(entries: tuple[Entry, ...], model: str, label: str) -> ParameterSet:
    chosen = ParameterSet(entries, model)
    if problems := check_combinations(chosen.values, get(model)):
        raise ParameterError([f"{label}: {problem}" for problem in problems])
    return chosen


def _follow(entries: dict[str, Entry], problems: list[str], label: str, base: ParameterSet) -> None:
    """Add one of two equal parameters to a file's entries if this file and the files before set only the other one."""
    variables = {v.name: v for v in base.actuator.parameters}
    present = {e.variable.name: e for e in base.entries}
    shipped = {e.variable.name: e for e in _defaults(base.model).entries}
    for pair in base.actuator.equal_parameters:
        for leader, name in (pair, pair[::-1]):
            text = f"as {leader}"
            follows = present[name] == shipped[name] or present[name].text == text
            if leader not in entries or name in entries or not follows:
                continue
            value, variable = entries[leader].value, variables[name]
            if value < variable.minimum:
                problems.append(f"{label}: {leader} = {entries[leader].text}: {name}, which follows from it, must be "
                                f"at least {variable.minimum:.6g} {variable.unit}; set {name} too")
            note = f"Follows from {leader}, to which it is equal in SI units; the file does not set it."
            entries[name] = Entry(variable, value, text, "derived", note, entries[leader].file)
            break


def _apart(one: Entry, other: Entry) -> str:
    """Return a warning if two parameters that should be equal in SI units differ by more than _APART; otherwise ""."""
    low, high = sorted((one.value, other.value))
    if high <= _APART * low:
        return ""
    return (f"{one.variable.name} = {one.text} and {other.variable.name} = {other.text} are {one.value:.6g} and "
            f"{other.value:.6g} in SI units, where both are equal for a motor: check rms or peak, phase or "
            "line to line; or set only one in a file, and the other follows")


def write_parameters(parameters: ParameterSet, path: Path, comments: Iterable[str]) -> None:
    """Write a parameter file: `comments`, then the entries that differ from the model's default set.

    Further comments name the records of identified values. Values are in the variables' units, with source and note.
    Loading the file gives the same set. Raises EmcasError if the file cannot be written.
    """
    shipped = {e.variable.name: e for e in load_parameters(model=parameters.model).entries}
    lines = [*(f"# {comment}" for comment in (*comments, *(r.comment for r in parameters.measured))), ""]
    for array, group in groupby(parameters.entries, lambda e: e.variable.name.partition("[")[0]):
        entries = list(group)
        changed = [e for e in entries if e != shipped[e.variable.name]]
        if changed == entries and len({(e.source, e.note) for e in entries}) == 1:
            lines.append(_entry_line(array, entries))
        else:
            lines += [_entry_line(json.dumps(e.variable.name), [e]) for e in changed]
    write(path, "\n".join([*lines, ""]))


def _entry_line(key: str, entries: Sequence[Entry]) -> str:
    """Return the line of one value, or of a whole array whose elements have the same source and note."""
    first, values = entries[0], [e.value for e in entries]
    unit = {} if first.variable.kind == "Boolean" else {"unit": first.variable.unit}
    texts = {name: text for name, text in (("source", first.source), ("note", first.note)) if text}
    return f"{key} = {toml.literal({'value': values if len(values) > 1 else values[0], **unit, **texts})}"


