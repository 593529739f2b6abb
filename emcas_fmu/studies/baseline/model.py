"""A baseline: limits, cases with approved figures and trajectories, and the identification of the recorded subject."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from math import isfinite, nan
from pathlib import Path
from typing import Annotated, Any

from pydantic import AliasChoices, Field, PlainValidator, ValidationInfo, field_validator, model_validator

from ...actuators import get
from ...bench import metrics
from ...bench.excitation import Excitation, csv_file, motion, reference_case
from ...bench.frequency_response import sweep_response
from ...bench.measure import sweep_figures
from ...bench.metrics import figures_of, shown
from ...bench.runs import Run
from ...bench.subject import Subject
from ...errors import EmcasError, hint
from ...motions import FIELDS, MOTIONS, STEP
from ...parameters.schema import In, Table, each, kind_of
from ...reference.files import supply_start
from ...simulation import Array
from ...variables import Variable

FILE = "baseline.toml"
DIGITS = 6  # significant digits in files: rounding changes a value by at most 0.0005 %, far less than a limit of 1 %
NEVER = "never"
"""The value, in files, of a figure whose level is never reached."""
LONGEST_CASE = 60.0  # s, longest duration in a case: the time that fmpy needs grows with the square of the length

ALL = figures_of("jump", "sweep", "usage")
"""Figures of the bench that a baseline may have; the kind of a case determines its figures."""


def file_unit(figure: str) -> str:
    """Return the unit of a figure in files."""
    return shown(ALL[figure].unit)[0]


def output_units(model: str) -> dict[str, tuple[str, float]]:
    """Return the unit in files, and the factor from SI to it, for each output that may have a trajectory."""
    return {v.name: shown(v.unit) for v in get(model).outputs if v.kind == "Real"}


def start_entries(model: str) -> dict[str, Variable]:
    """Return the variables that an actuator's parameter file may have as entries, by name."""
    return {v.name: v for v in get(model).file_entries}


def rounded(value: float) -> float:
    """Return a value rounded as in a file; nan for a value that is not finite."""
    return float(f"{value + 0.0:.{DIGITS}g}") if isfinite(value) else nan


class DriftLimit(Table):
    """Largest permitted change of a figure: `absolute` in its unit or `relative` in %, whichever is larger."""

    absolute: Annotated[Any, PlainValidator(lambda written, info: info.context.limited(written))]
    relative: Annotated[float, In("%", 0.0)]

    def of(self, approved: float) -> float:
        """Return the largest permitted change [unit of the figure] from an approved value; 0 if that is not finite."""
        return max(self.absolute, self.relative / 100.0 * abs(approved)) if isfinite(approved) else 0.0


def _entries(readers: Callable[[str], Mapping[str, Callable[[Any], Any]]]) -> PlainValidator:
    """Return the validator of a table; `readers(model)` returns the conversion of each entry by name."""
    def read(written: Any, info: ValidationInfo) -> dict[str, Any]:
        known = readers(str(info.context))

        def entry(name: str, value: Any) -> Any:
            if name not in known:
                raise ValueError("there is no such entry" + (hint(name, known) or f"; there is {', '.join(known)}"))
            return known[name](value)

        return each(written, entry)

    return PlainValidator(read)


def _figure(unit: str, written: Any) -> float:
    return nan if written == NEVER else float(In(unit).number(written))


FigureLimits = Annotated[Mapping[str, DriftLimit], _entries(
    lambda _: {name: partial(DriftLimit.model_validate, context=In(file_unit(name), 0.0)) for name in ALL})]
TrajectoryLimits = Annotated[Mapping[str, float], _entries(
    lambda model: {"sample_time": replace(FIELDS["duration"], minimum=STEP).limited,
                   **{name: In(unit, 0.0).limited for name, (unit, _) in output_units(model).items()}})]
Figures = Annotated[Mapping[str, float], _entries(
    lambda _: {name: partial(_figure, file_unit(name)) for name in ALL})]
StartValues = Annotated[Mapping[str, Any], _entries(
    lambda model: {name: In.of(v).limited for name, v in start_entries(model).items()})]
# The limits of recorded parameters are not checked.
BaselineParameters = Annotated[Mapping[str, Any], _entries(
    lambda model: {name: In.of(v).number for name, v in start_entries(model).items()})]


class Limits(Table):
    """Largest permitted changes: of figures, and of trajectories [units of output_units] every `sample_time` [s]."""

    figures: FigureLimits
    trajectories: TrajectoryLimits

    @model_validator(mode="after")
    def _sampled(self) -> Limits:
        if "sample_time" not in self.trajectories:
            raise ValueError("trajectories.sample_time is missing")
        return self

    @property
    def sample_time(self) -> float:
        """Time between points of a trajectory [s]."""
        return self.trajectories["sample_time"]

    @property
    def traces(self) -> dict[str, float]:
        """Largest permitted changes of the outputs with trajectories [units of output_units], by name."""
        return {name: limit for name, limit in self.trajectories.items() if name != "sample_time"}


class BaselineCase(Table):
    """One excitation, with its approved figures [unit_of] and limits that override the common limits.

    `start` has the values of the parameters that the case changes.
    """

    kind: str
    start: StartValues = Field(default_factory=dict)
    limits: FigureLimits = Field(default_factory=dict)
    figures: Figures = Field(default_factory=dict)

    @property
    def sweeps(self) -> bool:
        """Whether the case is a sweep, which has bandwidths and no trajectory."""
        return self.kind in MOTIONS and MOTIONS[self.kind].sweeps

    def inputs(self, folder: Path, subject: Subject) -> Excitation:
        """Return the inputs for a subject, without the values of `start`."""
        raise NotImplementedError

    def excitation(self, folder: Path, subject: Subject) -> Excitation:
        """Return the inputs and start values for a subject; CSV files are in the baseline's `folder`.

        Figures are measured from the first row on, including the time before the command. Raises EmcasError.
        """
        excitation = self.inputs(folder, subject).with_start_values(self.start)
        changes = "".join(f", {name} {value:g}" for name, value in self.start.items())
        return replace(excitation, title=excitation.title + changes, begin=0.0)

    def measure(self, run: Run, subject: Subject) -> dict[str, float]:
        """Return the figures [unit_of] of a finished run for which the actuator has the required outputs."""
        return _in_file(metrics.usage_figures(run))


def _in_file(figures: Mapping[str, float]) -> dict[str, float]:
    """Return figures [SI] as in a file."""
    return {name: rounded(figures[name] * shown(figure.unit)[1]) for name, figure in ALL.items() if name in figures}


class BaselineMotion(BaselineCase):
    """A motion, also with the optional fields of its kind; older files call the `amplitude` [rad] `command`.

    The bandwidths of a sweep are measured with steady sines of its amplitude.
    """

    amplitude: Annotated[float, replace(FIELDS["amplitude"], nonzero=True),
                         Field(validation_alias=AliasChoices("amplitude", "command"))]
    duration: Annotated[float, FIELDS["duration"].within(LONGEST_CASE)]

    def inputs(self, folder: Path, subject: Subject) -> Excitation:
        return motion(**self.model_dump(include={"kind", *MOTIONS[self.kind].fields}), first=None)

    def measure(self, run: Run, subject: Subject) -> dict[str, float]:
        if self.sweeps:
            swept = sweep_figures(sweep_response(run), subject, abs(self.amplitude), self.start)
            return _in_file({**metrics.usage_figures(run), **swept})
        return _in_file({**metrics.usage_figures(run), **metrics.motion_figures(run, -1)})


class BaselineReference(BaselineCase):
    """A reference case by name, with the encoder of the parameter set."""

    case: str

    @field_validator("case")
    @classmethod
    def _there_is(cls, case: str) -> str:
        reference_case(case)
        return case

    def inputs(self, folder: Path, subject: Subject) -> Excitation:
        supply = supply_start(subject.model, {**subject.values, **self.start})
        return replace(reference_case(self.case, exact=False, supply=supply), title=f"reference case {self.case}")


class BaselineFile(BaselineCase):
    """The inputs in a CSV file."""

    file: str

    def inputs(self, folder: Path, subject: Subject) -> Excitation:
        path = folder / self.file  # an absolute path stays as it is
        inputs = csv_file(path, model=subject.model)
        if inputs.stop > LONGEST_CASE:
            raise EmcasError(f"{path}: lasts {inputs.stop:g} s; a baseline's case may last {LONGEST_CASE:g} s")
        return replace(inputs, title=f"inputs of {self.file}")


CASE_KINDS: Mapping[str, type[BaselineCase]] = {
    **{name: BaselineMotion.of_kind(name, {each: FIELDS[each].within(LONGEST_CASE).definition for each in kind.options})
       for name, kind in MOTIONS.items() if kind.jumps or kind.sweeps},
    "reference": BaselineReference, "file": BaselineFile}


def _cases(written: Any, info: ValidationInfo) -> dict[str, BaselineCase]:
    def read(name: str, entry: Any) -> BaselineCase:
        if not re.fullmatch(r"[\w-]+", name, re.ASCII):
            raise ValueError("the name of a case has letters a to z, A to Z, digits, - and _, since it names a file")
        return CASE_KINDS[kind_of(entry, CASE_KINDS)].model_validate(entry, context=info.context)

    cases = each(written, read)
    if not cases:
        raise ValueError("there is no case; add [case.NAME], such as those of a new baseline")
    for name in cases:
        if any(isinstance(c, BaselineFile) and Path(c.file) == Path(f"{name}.csv") for c in cases.values()):
            raise ValueError(f"the trajectory of {name} would overwrite the inputs {name}.csv; rename the case")
    return cases


class BaselineTables(Table):
    """The tables of a baseline's file; the validation context is the actuator's model."""

    limits: Limits
    case: Annotated[Mapping[str, BaselineCase], PlainValidator(_cases)]
    recorded: dict[str, str] = Field(default_factory=dict)
    parameters: BaselineParameters = Field(default_factory=dict)


class Baseline(BaselineTables):
    """An actuator's baseline: the limits and cases of a file, also as `written` in it, and trajectories in other files.

    `traces` are the trajectories by case and output [units of output_units], from 0 s on. `recorded` identifies the
    recorded subject, `parameters` are that subject's values. A plan for recording has only limits and cases.
    """

    model: str
    written: Mapping[str, Any]
    traces: Mapping[str, Mapping[str, Array]]
