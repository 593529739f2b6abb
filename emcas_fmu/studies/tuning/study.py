"""A tuning study, read from TOML: the tunable parameters, the cases and the requirements."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable
from dataclasses import asdict, dataclass, replace
from functools import cache
from math import log
from pathlib import Path
from typing import Annotated, Any, TypeVar

from pydantic import Field, PlainValidator, ValidationInfo

from ...actuators import NAMES, NONLINEAR, is_shipped, parts
from ...bench.requirements import (
    NOMINAL,
    Case,
    Cases,
    Requirement,
    Requirements,
    Specification,
    load_requirements,
    variable_of,
)
from ...bench.subject import ParameterSubject
from ...errors import EmcasError, hint
from ...parameters import ParameterSet, load_parameters, shipped_file
from ...parameters.schema import In, Table, WrittenNumber, document, each, read
from ...support import extras

_OVER, _WITHOUT = "over", "without"  # keys of a study that changes another study
_AT_BOUND = 0.01  # largest distance from a bound, as a share of the logarithmic range, at which a value is at the bound


class StudyError(EmcasError):
    """A study that cannot be used; the message names the file, the entry and the remedy."""


@dataclass(frozen=True)
class Tunable:
    """A tunable parameter, searched on a logarithmic scale between two positive bounds [SI]."""

    name: str
    lower: float
    upper: float

    def bound(self, value: float) -> str:
        """Return the bound, ``lower`` or ``upper``, near a value [SI] (1 % of the logarithmic range), or empty."""
        share = log(value / self.lower) / log(self.upper / self.lower)
        return "lower" if share <= _AT_BOUND else "upper" if share >= 1.0 - _AT_BOUND else ""


@dataclass(frozen=True)
class Study:
    """A study of the parameter set `base`: tunable parameters, and the cases and requirements that judge gains."""

    base: ParameterSet
    tunables: tuple[Tunable, ...]
    cases: tuple[Case, ...]
    requirements: tuple[Requirement, ...]

    @property
    def specification(self) -> Specification:
        """The requirements and cases by which gains are judged."""
        return Specification(self.requirements, self.cases)

    def judged_by(self, file: Path) -> Study:
        """Return the study with a file's requirements, judged in the file's cases (default: all cases of the study).

        Raises EmcasError if the file cannot be used.
        """
        required = load_requirements(file, self.base)
        requirements = _measurable(required.requirements, self.base)
        if required.cases != (NOMINAL,):
            return replace(self, cases=required.cases, requirements=requirements)
        names = [case.name for case in self.cases]
        return replace(self, requirements=tuple(r.model_copy(update={"cases": names}) for r in requirements))

    @property
    def digest(self) -> str:
        """Hash of the bounds of the gains, and of everything except the gains that determines the judgements."""
        tuned = {t.name for t in self.tunables}
        actuator = self.base.actuator
        parts = [{n: v for n, v in self.base.values.items() if n not in tuned}, *map(asdict, self.tunables),
                 *map(asdict, self.cases), *map(repr, self.requirements), actuator.name,
                 actuator.source.read_text(encoding="utf-8") if actuator.source else ""]
        return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()[:16]


def _measurable(requirements: Iterable[Requirement], base: ParameterSet) -> tuple[Requirement, ...]:
    """Return the requirements that can be measured for a parameter set (:meth:`.Requirement.obstacle`)."""
    subject = ParameterSubject(base)
    return tuple(r for r in requirements if not r.obstacle(subject))


class _Bounds(Table):
    lower: WrittenNumber
    upper: WrittenNumber


def _tunables(entries: Any, info: ValidationInfo) -> Any:
    base: Any = info.context

    def bounded(name: str, entry: Any) -> Tunable:
        variable = variable_of(name, base)
        unit = In(variable.unit, variable.minimum, variable.maximum)
        bounds = _Bounds.model_validate(entry, context=unit)
        if bounds.lower == 0.0 < bounds.upper:
            least = max(1e-3 * bounds.upper, unit.minimum)
            raise ValueError("lower = 0: the logarithmic scale of the search has no 0; write a small value such as "
                             f"{least:.3g} {unit.unit}, or set 0 in a parameter file and do not tune it")
        if not max(unit.minimum, 0.0) <= bounds.lower < bounds.upper <= unit.maximum or bounds.lower <= 0.0:
            raise ValueError(f"expected 0 < lower < upper, {unit.limits}")
        return Tunable(name, bounds.lower, bounds.upper)

    return each(entries, bounded)


class _CasesOfFile(Table):
    tunables: Any
    cases: Cases
    requirements: Any


_Read = TypeVar("_Read", bound=_CasesOfFile)


class _File(_CasesOfFile):
    tunables: Annotated[dict[str, Tunable], PlainValidator(_tunables), Field(min_length=1)]
    requirements: Requirements


@cache
def shipped_cases(base: ParameterSet) -> tuple[Case, ...]:
    """Return the cases of the shipped study, without checking its requirements. Raises StudyError."""
    return tuple(_read(_CasesOfFile, shipped_file("tuning", base.model), base).cases.values())


def _read(schema: type[_Read], path: Path, base: ParameterSet) -> _Read:
    """Return a study's file; for a file without cases, with the cases shipped for the actuator without extensions."""
    contents = _over_another(document(path, StudyError)[1], path)
    if "cases" not in contents and is_shipped(base.model):
        contents["cases"] = document(shipped_file("tuning", parts(base.model)[0]), StudyError)[1]["cases"]
    return read(schema, contents, path, StudyError, base)


def _over_another(contents: dict[str, Any], path: Path) -> dict[str, Any]:
    """Return the contents of a study, completed by those of the study that `over` names, a file in the same folder.

    The tables tunables and cases replace those of the other file as a whole; a requirement replaces the requirement
    with the same name. Requirements named in `without` are left out. Raises StudyError.
    """
    other, without = contents.pop(_OVER, None), contents.pop(_WITHOUT, [])
    if other is None and not without:
        return contents
    if not isinstance(other, str) or not isinstance(without, list):
        raise StudyError(f'{path}: {_OVER} = {other!r} with {_WITHOUT} = {without!r}: expected the file of a study, '
                         'such as "nonlinear+trajectory.toml", and a list of requirement names')
    file = path.with_name(other)
    inherited = document(file, StudyError)[1]
    named = {**_by_name(inherited, file), **_by_name(contents, path)}
    if unknown := [each for each in without if each not in named]:
        raise StudyError(f"{path}: {_WITHOUT}: {other} has no requirement {unknown[0]}{hint(str(unknown[0]), named)}")
    return {**inherited, **contents, "requirements": [each for name, each in named.items() if name not in without]}


def _by_name(contents: dict[str, Any], path: Path) -> dict[str, Any]:
    entries = contents.get("requirements", [])
    if not isinstance(entries, list) or not all(isinstance(each, dict) and "name" in each for each in entries):
        raise StudyError(f"{path}: requirements: expected tables [[requirements]], each with a name")
    return {str(each["name"]): each for each in entries}


def has_shipped_study(base: ParameterSet) -> bool:
    """Return whether a shipped study fits an actuator, or is for its kind and might need an extra that is missing."""
    kind = parts(base.model)[0]
    if kind == NONLINEAR or shipped_file("tuning", base.model).stem == kind:
        return True
    try:
        load_study(shipped_file("tuning", base.model), base)
    except StudyError:
        return False
    return True


def shipped_study(base: ParameterSet) -> Study:
    """Return the shipped study for a parameter set. Raises StudyError if none fits, EmcasError for a missing extra."""
    try:
        return load_study(shipped_file("tuning", base.model), base)
    except StudyError as error:
        if has_shipped_study(base):
            extras.require("analysis", "the margins of the shipped study need", "control", "casadi")
            raise
        if not is_shipped(base.model):
            tunable = ", ".join(v.name for v in base.actuator.parameters if v.variability == "tunable")
            raise StudyError(f"model {base.model}: the shipped studies are for shipped actuators; write a study for "
                             f"this actuator's parameters (docs/tools/tuning.md){f': {tunable}' * bool(tunable)}"
                             ) from error
        first, *_ = str(error).splitlines()
        studied = [name for name in NAMES if has_shipped_study(load_parameters(model=name))]
        raise StudyError(f"model {base.model}: the shipped studies are for {', '.join(studied)}, and do not fit "
                         f"(first problem: {first}); write a study for this actuator's parameters") from error


def load_study(path: Path, base: ParameterSet) -> Study:
    """Return the study in a TOML file (see models/tuning.toml) for a parameter set. Raises StudyError.

    Requirements that cannot be measured are left out.
    """
    file = _read(_File, path, base)
    return Study(base, tuple(file.tunables.values()), tuple(file.cases.values()),
                 _measurable(file.requirements.values(), base))
