"""What a baseline is: limits, cases with their approved figures and trajectories, and what they were recorded of."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import copysign, isfinite, nan, radians
from pathlib import Path
from typing import Annotated, Any, ClassVar, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, PlainValidator, ValidationInfo, field_validator

from ... import motions
from ...actuators import get
from ...bench import metrics
from ...bench.excitation import Excitation, csv_file, motion, reference_case
from ...bench.frequency_response import sweep_response
from ...bench.measure import Test, sweep_figures
from ...bench.measure import excitation as measured
from ...bench.metrics import FIGURES, shown
from ...bench.runs import Run
from ...bench.subject import Subject
from ...errors import EmcasError
from ...parameters.schema import In, Table, each, parameter_of, unknown
from ...reference.files import supply_start
from ...variables import Variable

SCHEMA = "emcas-baseline/1"
"""Name and version of the files' layout; the number changes when an entry changes its meaning or goes."""
FILE = "baseline.toml"
DIGITS = 6  # significant, of what is written: a ten-thousandth of the tightest relative limit shipped
NEVER = "never"
"""Written for a figure whose level is not reached."""
LONGEST = 60.0  # s: fmpy's time for a run grows with the square of its length

Array = NDArray[np.floating[Any]]
_MOTION = ("rise_time", "settling_time", "time_to_accuracy", "overshoot", "steady_error", "held_error", "ripple",
           "sustained_rate", "peak_rate")
_SWEPT = ("bandwidth_3db", "bandwidth_90deg", "peak_gain")
_PEAKS = ("peak_rate", "peak_angle")
_ELECTRICAL = ("peak_current", "rms_current", "peak_power", "energy_drawn", "energy_returned")
ALL = (*_MOTION, *_SWEPT, "peak_angle", *_ELECTRICAL)
"""Figures of the bench that a baseline may have, in their order; which of them a case has depends on its kind."""


def unit_of(figure: str) -> str:
    """Return the unit in which a figure is kept."""
    return shown(FIGURES[figure].unit)[0]


def output_units(model: str) -> dict[str, str]:
    """Return the outputs of an actuator that may be kept as trajectories, with the units in which they are kept."""
    return {v.name: shown(v.unit)[0] for v in get(model).outputs if v.kind == "Real"}


def start_entries(model: str) -> dict[str, Variable]:
    """Return what a parameter file of an actuator may give, by name."""
    return {v.name: v for v in get(model).file_entries}


def rounded(value: float) -> float:
    """Return a value as a file holds it; nan for one that is never reached."""
    return float(f"{value + 0.0:.{DIGITS}g}") if isfinite(value) else nan


class Reading(NamedTuple):
    """What a file is read for: a model, and whether what was approved is needed, or limits and cases alone."""

    model: str
    approved: bool = True


def reading(info: ValidationInfo) -> Reading:
    """Return what the file that is validated is read for."""
    return cast(Reading, info.context)


class Limit(Table):
    """Largest change of a figure: `absolute` in its unit or `relative` in %, whichever is larger."""

    absolute: Annotated[Any, PlainValidator(lambda written, info: info.context.limited(written))]
    relative: Annotated[float, In("%", 0.0)]

    def of(self, approved: float) -> float:
        """Return the largest change from the approved value, in its unit."""
        return max(self.absolute, self.relative / 100.0 * abs(approved)) if isfinite(approved) else 0.0


def _known(name: str, names: Any) -> None:
    if name not in names:
        raise ValueError(f"there is no such entry; {unknown(name, names)}")


def _figure_limits(written: Any) -> dict[str, Limit]:
    def read(name: str, entry: Any) -> Limit:
        _known(name, ALL)
        return Limit.model_validate(entry, context=In(unit_of(name), 0.0))

    return each(written, read)


FigureLimits = Annotated[Mapping[str, Limit], PlainValidator(_figure_limits)]


def _trajectory_limits(written: Any, info: ValidationInfo) -> dict[str, float]:
    units = output_units(reading(info).model)

    def read(name: str, entry: Any) -> float:
        if name == "sample_time":
            time = float(In("s", 1e-3).limited(entry))
            if abs(time * 1e3 - round(time * 1e3)) > 1e-9:
                raise ValueError("must be a whole number of ms")
            return round(time, 9)
        _known(name, ["sample_time", *units])
        return float(In(units[name], 0.0).limited(entry))

    limits = each(written, read)
    if "sample_time" not in limits:
        raise ValueError("sample_time is missing")
    return limits


class Limits(Table):
    """Largest changes of figures, and of trajectories [display units] with the `sample_time` [s] of these."""

    figures: FigureLimits
    trajectories: Annotated[Mapping[str, float], PlainValidator(_trajectory_limits)]

    @property
    def sample_time(self) -> float:
        """Time between points of a trajectory [s]."""
        return self.trajectories["sample_time"]

    @property
    def traces(self) -> dict[str, float]:
        """Largest changes of the outputs kept, by name."""
        return {name: limit for name, limit in self.trajectories.items() if name != "sample_time"}


def _start(written: Any, info: ValidationInfo) -> dict[str, Any]:
    variables = start_entries(reading(info).model)
    return each(written, lambda name, entry: In.of(parameter_of(name, variables)).limited(entry))


class Case(Table):
    """One excitation, with the figures [display units] approved for it and limits that go before the common ones.

    `start` are values of parameters that differ in it.
    """

    measured: ClassVar[tuple[str, ...]] = (*_PEAKS, *_ELECTRICAL)

    kind: str
    start: Annotated[Mapping[str, Any], PlainValidator(_start)] = Field(default_factory=dict)
    limits: FigureLimits = Field(default_factory=dict)
    figures: Any = None

    @field_validator("figures")
    @classmethod
    def _approved(cls, written: Any, info: ValidationInfo) -> dict[str, float]:
        def read(name: str, entry: Any) -> float:
            if name not in cls.measured:
                raise ValueError(f"such a case has no such figure, remove it; {unknown(name, cls.measured)}")
            return nan if entry == NEVER else float(In(unit_of(name)).number(entry))

        return each(written, read) if reading(info).approved else {}

    def made(self, folder: Path, subject: Subject) -> Excitation:
        """Return the inputs for a subject, without what `start` changes."""
        raise NotImplementedError

    def excitation(self, folder: Path, subject: Subject) -> Excitation:
        """Return the inputs for a subject; a CSV file is looked for beside the baseline in `folder`. Raises EmcasError.

        All of a response is approved, and not what follows the command only.
        """
        made = self.made(folder, subject).with_start_values(self.start)
        changes = "".join(f", {name} {value:g}" for name, value in self.start.items())
        return replace(made, title=made.title + changes, begin=0.0)

    def measure(self, run: Run, subject: Subject) -> dict[str, float]:
        """Return the figures of a subject's finished run, SI, as far as the actuator has the outputs they need."""
        return metrics.usage(run)


class Motion(Case):
    """A kind of motion of the bench; of a slew a `torque` [N.m] comes on with the command, as in requirements."""

    command: Annotated[float, In("deg")]
    duration: Annotated[float, In("s", 0.1, LONGEST)]

    @field_validator("command")
    @classmethod
    def _moves(cls, command: float) -> float:
        if not command:
            raise ValueError("nothing would move")
        return command

    def made(self, folder: Path, subject: Subject) -> Excitation:
        torque = getattr(self, "torque", 0.0)
        if self.kind == "slew":  # from the first row on at its starting end
            sign = copysign(1.0, self.command)
            slew = Test("slew", abs(radians(self.command)), self.duration, sign * torque)
            return measured(slew, sign, subject)
        return motion(self.kind, radians(self.command), self.duration, torque)


class Jump(Motion):
    """A motion whose command jumps."""

    measured: ClassVar[tuple[str, ...]] = (*_MOTION, *_ELECTRICAL)

    def measure(self, run: Run, subject: Subject) -> dict[str, float]:
        return {**metrics.usage(run), **metrics.motion(run, -1)}


class Sweep(Motion):
    """A sine sweep; the bandwidths are those under steady sines of its amplitude."""

    measured: ClassVar[tuple[str, ...]] = (*_SWEPT, *_ELECTRICAL)

    def measure(self, run: Run, subject: Subject) -> dict[str, float]:
        response = sweep_response(run)
        return {**metrics.usage(run), **sweep_figures(response, subject, abs(radians(self.command)), self.start)}


class Reference(Case):
    """A reference case by name, with the encoder."""

    case: str

    @field_validator("case")
    @classmethod
    def _there_is(cls, case: str) -> str:
        try:
            reference_case(case)
        except EmcasError as error:
            raise ValueError(str(error)) from error
        return case

    def made(self, folder: Path, subject: Subject) -> Excitation:
        supply = supply_start(subject.model, {**subject.values, **self.start})
        return replace(reference_case(self.case, exact=False, supply=supply), title=f"reference case {self.case}")


class Replay(Case):
    """Inputs of a CSV file."""

    file: str

    def made(self, folder: Path, subject: Subject) -> Excitation:
        path = folder / self.file  # an absolute path stays one
        inputs = csv_file(path, model=subject.model)
        if inputs.stop > LONGEST:
            raise EmcasError(f"{path}: lasts {inputs.stop:g} s; a baseline's case may last {LONGEST:g} s")
        return replace(inputs, title=f"inputs of {self.file}")


_FIELDS: Mapping[str, Any] = {"torque": (Annotated[float, In("N.m")], 0.0)}
KINDS: Mapping[str, type[Case]] = {
    **{name: motions.schema(name, _FIELDS, Jump if kind.jumps else Sweep)
       for name, kind in motions.KINDS.items() if kind.jumps or kind.sweeps}, "reference": Reference, "file": Replay}


@dataclass(frozen=True)
class Baseline:
    """Of the actuator `model`: `cases` by name, and their trajectories by case and output [display units], from 0 on.

    `recorded` says what it was recorded of; `parameters` are its values. Without them it is a plan to record by.
    """

    model: str
    limits: Limits
    cases: Mapping[str, Case]
    traces: Mapping[str, Mapping[str, Array]]
    recorded: Mapping[str, str]
    parameters: Mapping[str, Any]
