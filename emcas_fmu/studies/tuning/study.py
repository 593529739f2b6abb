"""A tuning study: what may change, in which cases it is judged, and what is required. Read from TOML."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from math import log
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field, PlainValidator, ValidationInfo, field_validator, model_validator

from ...actuators import NAMES, parts
from ...bench.excitation import SETTLE, STEP
from ...bench.metrics import FIGURES, TAIL
from ...bench.subject import ParameterSubject
from ...errors import EmcasError
from ...files import models_directory
from ...parameters import ParameterSet, load_parameters
from ...schema import In, Quantity, Table, each, kind_of, load, named, parameter_of, unknown
from ...variables import Variable
from .measure import KINDS, Test, lacking

_AT_BOUND = 0.01  # of the range searched, on its logarithmic scale


class StudyError(EmcasError):
    """A study that cannot be used; the message names file, entry and remedy."""


@dataclass(frozen=True)
class Tunable:
    """A parameter to be found between two positive bounds, SI; searched on a logarithmic scale."""

    name: str
    lower: float
    upper: float

    def bound(self, value: float) -> str:
        """Return the bound, lower or upper, that a value is at: within 1 % of the range searched; else nothing."""
        share = log(value / self.lower) / log(self.upper / self.lower)
        return "lower" if share <= _AT_BOUND else "upper" if share >= 1.0 - _AT_BOUND else ""


@dataclass(frozen=True)
class Case:
    """Circumstances: values of parameters that differ from the set being tuned, SI."""

    name: str
    values: Mapping[str, Any]


def _amplitude(entry: Any, info: ValidationInfo) -> float:
    base: Any = info.context
    limit, amplitude = float(base.values["command.limit"]), float(In("rad").number(entry))
    if not 0.0 < amplitude <= limit * (1.0 + 1e-9):
        raise ValueError("must be an amplitude above 0" if amplitude <= 0.0 else
                         f"is beyond command.limit = {limit:g} rad")
    return amplitude


class _Linear(Table):
    kind: str


class _Load(_Linear):
    torque: Annotated[float, In("N.m")]
    duration: Annotated[float, In("s", TAIL, 100.0)] = 0.6


class _Sine(_Linear):
    amplitude: Annotated[float, PlainValidator(_amplitude)]


class _Move(_Sine):
    duration: Annotated[float, In("s", TAIL, 100.0)] = 0.6
    torque: Annotated[float, In("N.m")] = 0.0


class _Slew(_Move):
    settle: Annotated[float, In("s", STEP, 100.0)] = SETTLE


_TESTS: Mapping[str, type[_Linear]] = {"step": _Move, "slew": _Slew, "load": _Load, "sine": _Sine, "linear": _Linear}


def _test(entry: Any, info: ValidationInfo) -> Test:
    table = _TESTS[kind_of(entry, _TESTS)].model_validate(entry, context=info.context)
    return Test(**table.model_dump())


def _limit(entry: Any, info: ValidationInfo) -> float:
    """Return a limit in the unit of its figure; that of an unknown figure is no further error."""
    limit = float(In(FIGURES[info.data["figure"]].unit).number(entry)) if "figure" in info.data else 1.0
    if limit <= 0.0:
        raise ValueError("must be above 0")
    return limit


class Requirement(Table):
    """A figure of a test and its limit, either a maximum or a minimum in the figure's unit, in the cases named."""

    name: str
    test: Annotated[Test, PlainValidator(_test)]
    figure: str
    maximum: Annotated[float | None, PlainValidator(_limit)] = None
    minimum: Annotated[float | None, PlainValidator(_limit)] = None
    cases: list[str] = Field(default_factory=list, min_length=1)  # all
    source: str = ""

    @field_validator("figure")
    @classmethod
    def _of_the_test(cls, figure: str, info: ValidationInfo) -> str:
        kinds = [info.data["test"].kind] if "test" in info.data else list(KINDS)
        available = list(dict.fromkeys(name for kind in kinds for name in KINDS[kind]))
        if figure not in available:
            raise ValueError(f"a {' or '.join(kinds)} test has no such figure; {unknown(figure, available)}")
        base: Any = info.context
        if "test" in info.data and (reason := lacking(info.data["test"], figure, ParameterSubject(base))):
            raise ValueError(f"{reason} ({base.model})")
        return figure

    @model_validator(mode="after")
    def _one_limit(self) -> Requirement:
        if (self.maximum is None) == (self.minimum is None):
            raise ValueError("needs either maximum or minimum")
        return self

    @property
    def sense(self) -> str:
        """Which of the two the limit is."""
        return "minimum" if self.maximum is None else "maximum"

    @property
    def limit(self) -> float:
        """The limit, in `unit`."""
        return float(getattr(self, self.sense))

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

    @property
    def needs_analysis(self) -> bool:
        """Whether a requirement is one of linear analysis."""
        return any(r.test.kind == "linear" for r in self.requirements)

    @property
    def digest(self) -> str:
        """A hash of all that decides what is measured for given gains."""
        tuned = {t.name for t in self.tunables}
        actuator = self.base.actuator
        parts = [{n: v for n, v in self.base.values.items() if n not in tuned}, *map(asdict, self.tunables),
                 *map(asdict, self.cases), *map(repr, self.requirements), actuator.name,
                 actuator.source.read_text(encoding="utf-8") if actuator.source else ""]
        return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()[:16]


class _Bounds(Table):
    lower: Quantity
    upper: Quantity


def _tunables(entries: Any, info: ValidationInfo) -> Any:
    base: Any = info.context

    def read(name: str, entry: Any) -> Tunable:
        variable = _variable(name, base)
        unit = In(variable.unit, variable.minimum, variable.maximum)
        bounds = _Bounds.model_validate(entry, context=unit)
        if bounds.lower == 0.0 < bounds.upper:
            least = max(1e-3 * bounds.upper, unit.minimum)
            raise ValueError("lower = 0: the search is on a logarithmic scale, which has no 0; write a small value "
                             f"such as {least:.3g} {unit.unit}, or give 0 in a parameter file and do not tune it")
        if not max(unit.minimum, 0.0) <= bounds.lower < bounds.upper <= unit.maximum or bounds.lower <= 0.0:
            raise ValueError(f"expected 0 < lower < upper, {unit.limits}")
        return Tunable(name, bounds.lower, bounds.upper)

    return each(entries, read)


def _cases(entries: Any, info: ValidationInfo) -> Any:
    base: Any = info.context

    def change(name: str, entry: Any) -> object:
        variable = _variable(name, base)
        if name in info.data.get("tunables", {}):
            raise ValueError("is to be tuned and cannot be set by a case")
        share = isinstance(entry, str) and entry.strip().endswith("%")
        return In(variable.unit, base=float(base.values[name])).number(entry) if share else entry

    def read(name: str, entry: Any) -> Case:
        changes = each(entry, change)
        values = base.with_values(changes).values
        return Case(name, {key: values[key] for key in changes})

    return each(entries, read)


def _variable(name: str, base: ParameterSet) -> Variable:
    variables = {e.variable.name: e.variable for e in base.entries}
    tunable = ", ".join(v.name for v in variables.values() if v.variability == "tunable")
    return parameter_of(name, variables, f"; made to be tuned are {tunable}" if tunable else "")


def _requirements(entries: Any, info: ValidationInfo) -> Any:
    cases = list(info.data.get("cases", ()))

    def read(name: str, entry: Any) -> Requirement:
        requirement = Requirement.model_validate(entry, context=info.context)
        for case in requirement.cases:
            if case not in cases and cases:
                raise ValueError(f"there is no case {case}; {unknown(case, cases)}")
        return requirement.model_copy(update={"cases": requirement.cases or cases})

    return each(named(entries), read)


class _File(Table):
    tunables: Annotated[dict[str, Tunable], PlainValidator(_tunables), Field(min_length=1)]
    cases: Annotated[dict[str, Case], PlainValidator(_cases), Field(min_length=1)]
    requirements: Annotated[dict[str, Requirement], PlainValidator(_requirements), Field(min_length=1)]


def shipped_study(base: ParameterSet) -> Study:
    """Return the shipped study for a parameter set: models/tuning/NAME.toml of an actuator that has one, else the
    default one, models/tuning.toml.

    Raises StudyError, for an actuator that has not what it tunes too.
    """
    folder = models_directory()
    path = folder / "tuning" / f"{parts(base.model)[0]}.toml"
    if not path.is_file():
        path = folder / "tuning.toml"

    def fits(model: str) -> bool:
        if (folder / "tuning" / f"{model}.toml").is_file():
            return True
        try:
            load_study(path, load_parameters(model=model))
        except StudyError:
            return False
        return True

    try:
        return load_study(path, base)
    except StudyError as error:
        if fits(base.model):
            raise
        first, *_ = str(error).splitlines()
        raise StudyError(f"--model {base.model}: the shipped studies are of {', '.join(filter(fits, NAMES))}, and do "
                         f"not fit (first: {first}); name a study of this actuator's parameters") from error


def load_study(path: Path, base: ParameterSet) -> Study:
    """Return the study of a TOML file (see models/tuning.toml) for a parameter set. Raises StudyError."""
    file = load(_File, path, StudyError, base)
    return Study(base, tuple(file.tunables.values()), tuple(file.cases.values()), tuple(file.requirements.values()))
