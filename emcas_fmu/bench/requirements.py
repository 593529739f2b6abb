"""Requirements, read from TOML: figures of tests, each with a limit and the cases in which it must hold.

The shipped requirements are in `models/requirements.toml`, or in `models/requirements/NAME.toml` for an actuator with
its own file. A user's file replaces them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from math import degrees
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import Field, PlainValidator, ValidationInfo, field_validator, model_validator

from ..errors import EmcasError
from ..motions import FIELDS, MOTIONS, RATED
from ..parameters import ParameterSet, shipped_file
from ..parameters.schema import In, Table, document, each, kind_of, misplaced, named, parameter_of, read, unknown
from ..variables import Variable
from .measure import BANDWIDTHS, TESTS, Test, obstacle
from .metrics import FIGURES, shown, unit_of
from .subject import COMMAND_RANGE, ParameterSubject, Subject


def _amplitude(entry: Any, info: ValidationInfo) -> float:
    base: Any = info.context
    limit = ParameterSubject(base).command_limit
    amplitude = float(In("rad", base=limit).number(entry))
    if amplitude <= 0.0:
        raise ValueError("must be an amplitude above 0")
    largest = max(limit, COMMAND_RANGE)  # an actuator with a smaller range clips the command; the verdict notes it
    if amplitude > largest * (1.0 + 1e-9):
        raise ValueError(f"is beyond command.limit = {degrees(limit):.6g} deg; use {degrees(largest):.6g} deg at most")
    return amplitude


_MOTION: Mapping[str, Any] = {
    "amplitude": (Annotated[float, PlainValidator(_amplitude)], ...),
    "duration": replace(FIELDS["duration"], default=0.6).definition,
    "torque": FIELDS["torque"].definition, "settle": FIELDS["settle"].definition,
    "supply": (Annotated[float, In("1", 0.1, 2.0)], 1.0)}
_LOAD: Mapping[str, Any] = {**_MOTION, "torque": replace(FIELDS["torque"], nonzero=True).definition}
_TABLES: Mapping[str, type[Table]] = {
    name: Table.of_kind(name, {each: (_MOTION if name in MOTIONS else _LOAD)[each] for each in kind.fields})
    for name, kind in TESTS.items()}


def _unit(figure: str) -> str:
    """Return a figure's unit: for a figure of the acceptance report, the unit that its name ends with."""
    return FIGURES[figure].unit if figure in FIGURES else unit_of(figure)


def _test(entry: Any, info: ValidationInfo) -> Test:
    table = _TABLES[kind_of(entry, _TABLES)].model_validate(entry, context=info.context)
    return Test(**table.model_dump())


def _limit(entry: Any, info: ValidationInfo) -> float:
    """Return a limit in its figure's unit; 1 for an unknown figure, for which another validator raises the error."""
    limit = float(In(_unit(info.data["figure"])).number(entry)) if "figure" in info.data else 1.0
    if limit <= 0.0:
        raise ValueError("must be above 0")
    if info.data.get("figure") in TESTS["sine"].figures and not BANDWIDTHS[0] < limit < BANDWIDTHS[1]:
        raise ValueError("must be between {:g} and {:g} Hz, the range of measured bandwidths".format(*BANDWIDTHS))
    return limit


class Requirement(Table):
    """A figure of a test with its limit, a maximum or a minimum in the figure's unit, in the listed cases.

    Without a test, the figure is one of the acceptance report, named ``test.group.figure`` as in its JSON file, and
    only the report judges it. An `optional` requirement is skipped for an actuator that has an `obstacle` to it, such
    as a missing output. The validation context is the parameter set.
    """

    name: str
    title: str = ""
    test: Annotated[Test | None, PlainValidator(_test)] = None
    figure: str
    maximum: Annotated[float | None, PlainValidator(_limit)] = None
    minimum: Annotated[float | None, PlainValidator(_limit)] = None
    cases: list[str] = Field(default_factory=list, min_length=1)  # by default all
    source: str = ""
    reason: str = ""
    optional: bool = False

    @field_validator("figure")
    @classmethod
    def _of_the_test(cls, figure: str, info: ValidationInfo) -> str:
        test = info.data.get("test")
        if test is None and figure.count(".") == 2:
            return figure
        kinds = [test.kind] if test else list(TESTS)
        available = list(dict.fromkeys(name for kind in kinds for name in TESTS[kind].figures))
        if figure not in available:
            raise ValueError(f"a {' or '.join(kinds)} test has no such figure; {unknown(figure, available)}")
        if "test" in info.data and test is None:
            raise ValueError("needs a test, such as { kind = \"step\", amplitude = \"5 deg\" }; a figure of the "
                             "acceptance report has the form test.group.figure")
        return figure

    @model_validator(mode="after")
    def _one_limit(self, info: ValidationInfo) -> Requirement:
        if (self.maximum is None) == (self.minimum is None):
            raise ValueError("needs either maximum or minimum")
        base: Any = info.context
        if not self.optional and (why := self.obstacle(ParameterSubject(base))) and self.test:
            raise ValueError(f"{self.figure}: {why} ({base.model}); with optional = true it is then not judged")
        return self

    @property
    def sense(self) -> str:
        """The sense of the limit, `minimum` or `maximum`."""
        return "minimum" if self.maximum is None else "maximum"

    @property
    def sign(self) -> float:
        """1 if larger figures are worse, -1 if smaller ones are."""
        return -1.0 if self.maximum is None else 1.0

    @property
    def limit(self) -> float:
        """The limit, in `unit`."""
        return float(getattr(self, self.sense))

    @property
    def unit(self) -> str:
        """The unit of the limit and of the measured figure."""
        return _unit(self.figure)

    @property
    def shown(self) -> tuple[str, float]:
        """The display unit, and the factor from `unit` to it."""
        return shown(self.unit) if self.test else (self.unit, 1.0)

    def kept(self, measured: Any) -> Any:
        """Return whether figures [unit], an array or a number, keep the limit; values that are not finite do not.

        Values are compared in the display unit with nine decimals, so that rounding in a conversion misses no limit.
        """
        _, factor = self.shown
        shown = np.round(np.multiply(measured, factor), 9)
        return np.isfinite(measured) & (self.sign * (self.shown_limit - shown) >= 0.0)

    @property
    def shown_limit(self) -> float:
        """The limit in the display unit."""
        return round(self.limit * self.shown[1], 9)

    @property
    def how(self) -> str:
        """A description of the measurement: the figure's title and the test."""
        return f"{FIGURES[self.figure].title}; {self.test}" if self.test else self.figure

    def obstacle(self, subject: Subject) -> str:
        """Return the reason why the figure cannot be measured for a subject; empty if it can."""
        if self.test is None:
            return "a figure of the acceptance report: emcas report judges it"
        return obstacle(self.test, self.figure, subject)


@dataclass(frozen=True)
class Case:
    """A set of changed parameters: `values` in their variables' units, and `shares` of the judged variant's values."""

    name: str
    values: Mapping[str, Any]
    shares: Mapping[str, float] = field(default_factory=dict)

    def of(self, variant: Mapping[str, Any]) -> dict[str, Any]:
        """Return the changed parameters of a variant in this case; without the case they are `variant`."""
        shares = {name: share * variant[name] for name, share in self.shares.items() if name in variant}
        return {**variant, **self.values, **shares}


NOMINAL = Case("nominal", {})


@dataclass(frozen=True)
class Specification:
    """The requirements of a file and the cases in which they are judged."""

    requirements: tuple[Requirement, ...]
    cases: tuple[Case, ...] = (NOMINAL,)
    file: str = ""

    @property
    def rated_load(self) -> float:
        """The magnitude [N.m] of the torque in the first requirement of a loaded rate; RATED if there is none."""
        return next((abs(r.test.torque) for r in self.requirements
                     if r.figure == "sustained_rate" and r.test and r.test.torque), RATED)


def variable_of(name: str, base: ParameterSet) -> Variable:
    """Return a parameter's variable by name. Raises ValueError, with the tunable parameters, for an unknown name."""
    variables = {e.variable.name: e.variable for e in base.entries}
    tunable = ", ".join(v.name for v in variables.values() if v.variability == "tunable")
    return parameter_of(name, variables, f"; the tunable parameters are {tunable}" if tunable else "")


def _is_share(entry: Any) -> bool:
    return isinstance(entry, str) and entry.strip().endswith("%")


def _cases(entries: Any, info: ValidationInfo) -> dict[str, Case]:
    base: Any = info.context

    def change(name: str, entry: Any) -> object:
        variable = variable_of(name, base)
        if name in info.data.get("tunables", {}):
            raise ValueError("is one of the tunables, which a case cannot set; remove it from one of the tables")
        return In(variable.unit, base=float(base.values[name])).number(entry) if _is_share(entry) else entry

    def read(name: str, entry: Any) -> Case:
        changes = each(entry, change)
        values = base.with_values(changes).values
        return Case(name, {key: values[key] for key in changes},
                    {key: In("1", base=1.0).number(entry[key]) for key in changes if _is_share(entry[key])})

    return each(entries, read)


def _requirements(entries: Any, info: ValidationInfo) -> dict[str, Requirement]:
    cases = list(info.data.get("cases", ()))

    def read(name: str, entry: Any) -> Requirement:
        requirement = Requirement.model_validate(entry, context=info.context)
        for case in requirement.cases:
            if case not in cases and cases:
                raise ValueError(f"there is no case {case}; {unknown(case, cases)}")
        return requirement.model_copy(update={"cases": requirement.cases or cases})

    return each(named(entries), read)


Cases = Annotated[dict[str, Case], PlainValidator(_cases), Field(min_length=1)]
Requirements = Annotated[dict[str, Requirement], PlainValidator(_requirements), Field(min_length=1)]


class _File(Table):
    cases: Cases = Field(default_factory=lambda: {NOMINAL.name: NOMINAL})
    requirements: Requirements


def load_requirements(path: Path | None, base: ParameterSet) -> Specification:
    """Return the requirements of a TOML file, by default the shipped ones, for a parameter set.

    Raises EmcasError with the file, the entry and the remedy.
    """
    path = path or shipped_file("requirements", base.model)
    contents = document(path, EmcasError)[1]
    if other := misplaced(contents, "requirements"):
        raise EmcasError(f"{path}: is not a file of requirements: it {other}; see models/requirements.toml")
    file = read(_File, contents, path, EmcasError, base)
    return Specification(tuple(file.requirements.values()), tuple(file.cases.values()), path.name)
