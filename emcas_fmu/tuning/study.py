"""A tuning study: what may change, in which cases it is judged, and what is required. Read from TOML."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from ..actuators import NONLINEAR, get
from ..errors import EmcasError, hint, require_known
from ..parameters import ParameterSet
from ..toml import tomllib
from ..units import UnitError, quantity
from .experiments import FIGURES, KINDS, Test

_VARIABLES = {v.name: v for v in get(NONLINEAR).file_entries}


class StudyError(EmcasError):
    """A study that cannot be used; the message names file, entry and remedy."""


@dataclass(frozen=True)
class Tunable:
    """A parameter to be found between two positive bounds, SI; searched on a logarithmic scale."""

    name: str
    lower: float
    upper: float


@dataclass(frozen=True)
class Case:
    """Circumstances: values of parameters that differ from the set being tuned, SI."""

    name: str
    values: Mapping[str, Any]


@dataclass(frozen=True)
class Requirement:
    """A figure of a test and its limit, in the figure's unit, in the cases named."""

    name: str
    test: Test
    figure: str
    sense: str
    limit: float
    cases: tuple[str, ...]
    source: str

    @property
    def unit(self) -> str:
        """Unit of the limit and of what is measured."""
        return FIGURES[self.figure].unit


@dataclass(frozen=True)
class Study:
    """All of a study, for the parameter set `base`."""

    base: ParameterSet
    tunables: tuple[Tunable, ...]
    cases: tuple[Case, ...]
    requirements: tuple[Requirement, ...]

    def values(self, case: Case, gains: Mapping[str, float]) -> dict[str, Any]:
        """The flat parameters of a case with these gains."""
        return {**self.base.values, **case.values, **gains}

    @property
    def digest(self) -> str:
        """A hash of all that decides what is measured for given gains."""
        tuned = {t.name for t in self.tunables}
        parts = [{n: v for n, v in self.base.values.items() if n not in tuned}, *map(asdict, self.tunables),
                 *map(asdict, self.cases), *map(asdict, self.requirements)]
        return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()[:16]


def load_study(path: Path, base: ParameterSet) -> Study:
    """The study of a TOML file (see models/tuning.toml) for a parameter set. Raises StudyError."""
    try:
        document = tomllib.loads(path.read_text(encoding="utf-8-sig"))
    except (OSError, ValueError) as error:
        raise StudyError(f"{path}: cannot be read: {error}") from error
    require_known(document, ("tunables", "cases", "requirements"), str(path), StudyError)
    tunables = tuple(_tunable(path, name, entry) for name, entry in _table(document, "tunables", path).items())
    cases = tuple(_case(path, name, entry, base) for name, entry in _table(document, "cases", path).items())
    names = tuple(case.name for case in cases)
    listed = document.get("requirements")
    if not isinstance(listed, list) or not listed:
        raise StudyError(f"{path}: needs at least one [[requirements]]")
    for case in cases:
        if both := sorted(set(case.values) & {t.name for t in tunables}):
            raise StudyError(f"{path}: cases.{case.name}: {', '.join(both)} is to be tuned and cannot be set by a case")
    limit_angle = float(base.values["command.limit"])
    requirements = tuple(_requirement(path, entry, names, limit_angle) for entry in listed)
    twice = sorted({r.name for r in requirements if [q.name for q in requirements].count(r.name) > 1})
    if twice:
        raise StudyError(f"{path}: requirement {', '.join(twice)} is given twice")
    return Study(base, tunables, cases, requirements)


def _table(document: Mapping[str, Any], key: str, path: Path) -> Mapping[str, Any]:
    table = document.get(key)
    if not isinstance(table, dict) or not table:
        raise StudyError(f"{path}: needs a table [{key}]")
    return table


def _number(where: str, written: Any, unit: str) -> float:
    if isinstance(written, bool) or not isinstance(written, (int, float, str)):
        raise StudyError(f"{where}: expected a number with a unit such as {unit}")
    try:
        return quantity(str(written), "", unit)
    except UnitError as error:
        raise StudyError(f"{where} = {written}: {error}") from error


def _variable(where: str, name: str) -> Any:
    if name not in _VARIABLES:
        raise StudyError(f"{where}: there is no parameter {name!r}{hint(name, _VARIABLES)}")
    return _VARIABLES[name]


def _tunable(path: Path, name: str, entry: Any) -> Tunable:
    where = f"{path}: tunables.{name}"
    variable = _variable(where, name)
    if not isinstance(entry, dict) or set(entry) != {"lower", "upper"}:
        raise StudyError(f"{where}: expected {{ lower = ..., upper = ... }}")
    lower, upper = (_number(f"{where}.{side}", entry[side], variable.unit) for side in ("lower", "upper"))
    if not max(variable.minimum, 0.0) <= lower < upper <= variable.maximum or lower <= 0.0:
        raise StudyError(f"{where}: expected 0 < lower < upper, within {variable.minimum:g} .. {variable.maximum:g} "
                         f"{variable.unit}")
    return Tunable(name, lower, upper)


def _case(path: Path, name: str, entry: Any, base: ParameterSet) -> Case:
    where = f"{path}: cases.{name}"
    if not isinstance(entry, dict):
        raise StudyError(f"{where}: expected a table of parameters")
    changes: dict[str, object] = {}
    for key, written in entry.items():
        _variable(where, key)
        if isinstance(written, str) and written.strip().endswith("%"):
            share = _number(f"{where}.{key}", written, "1")
            changes[key] = float(base.values[key]) * share
        else:
            changes[key] = written
    try:
        values = base.replace(changes).values
    except EmcasError as error:
        raise StudyError(f"{where}: {error}") from error
    return Case(name, {key: values[key] for key in changes})


def _requirement(path: Path, entry: Any, cases: tuple[str, ...], limit_angle: float) -> Requirement:
    where = f"{path}: requirement {entry.get('name', '?') if isinstance(entry, dict) else '?'}"
    if not isinstance(entry, dict):
        raise StudyError(f"{where}: expected a table")
    require_known(entry, ("name", "test", "figure", "maximum", "minimum", "cases", "source"), where, StudyError)
    for key in ("name", "test", "figure"):
        if key not in entry:
            raise StudyError(f"{where}: {key} is missing")
    if len({"maximum", "minimum"} & set(entry)) != 1:
        raise StudyError(f"{where}: needs either maximum or minimum")
    test = _test(where, entry["test"], limit_angle)
    figure = entry["figure"]
    available = [name for name, f in FIGURES.items() if test.kind in f.kinds]
    if figure not in available:
        raise StudyError(f"{where}: a {test.kind} test has no figure {figure!r}{hint(figure, available)}; "
                         f"it has {', '.join(available)}")
    sense = "maximum" if "maximum" in entry else "minimum"
    limit = _number(f"{where}.{sense}", entry[sense], FIGURES[figure].unit)
    if limit <= 0.0:
        raise StudyError(f"{where}: the {sense} must be above 0")
    for key in ("name", "figure", "source"):
        if not isinstance(entry.get(key, ""), str):
            raise StudyError(f"{where}: {key} must be a string")
    listed = entry.get("cases", list(cases))
    if not isinstance(listed, list) or not listed or not all(isinstance(name, str) for name in listed):
        raise StudyError(f"{where}: cases must be a list of names, at least one")
    chosen = tuple(listed)
    if unknown := [name for name in chosen if name not in cases]:
        raise StudyError(f"{where}: there is no case {', '.join(unknown)}; there is {', '.join(cases)}")
    return Requirement(entry["name"], test, figure, sense, limit, chosen, entry.get("source", ""))


def _test(where: str, entry: Any, limit_angle: float) -> Test:
    if not isinstance(entry, dict) or entry.get("kind") not in KINDS:
        raise StudyError(f"{where}: test needs a kind, one of {', '.join(KINDS)}")
    kind = entry["kind"]
    units = KINDS[kind]
    require_known(entry, ("kind", *units), f"{where}: test", StudyError)
    numbers = {key: _number(f"{where}: test.{key}", entry[key], unit) for key, unit in units.items() if key in entry}
    if numbers.get("amplitude", 0.0) > limit_angle * (1.0 + 1e-9):
        raise StudyError(f"{where}: test.amplitude = {entry['amplitude']} is beyond command.limit = "
                         f"{limit_angle:g} rad")
    try:
        return Test(kind, **numbers)
    except ValueError as error:
        raise StudyError(f"{where}: test: {error}") from error
