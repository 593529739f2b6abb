"""A whole validation: every reference case, the requirements, and the linear model where that is of the actuator."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import degrees, radians
from pathlib import Path
from typing import Any

from ...actuators import NAMES, NONLINEAR, parts
from ...bench import metrics, verdict
from ...bench.excitation import Excitation, of_case, step_to, with_encoder
from ...bench.requirements import Specification, load_requirements
from ...bench.runs import Columns, Run
from ...bench.subject import Identification, Subject
from ...bench.verdict import Judged
from ...errors import EmcasError
from ...parameters import load_parameters
from ...reference import files, stored
from ...reference.cases import CASES, TOLERANCE
from ...reference.linear import LinearModel, obstacle
from ...support.arguments import checked
from ...support.files import models_directory
from ...support.progress import Progress, silent
from . import claims

TRAJECTORY_LIMIT = round(degrees(TOLERANCE), 9)  # deg
# Errors of these are written in degrees.
DISPLAY: Mapping[str, tuple[float, str]] = {
    "fin_angle": (degrees(1.0), "deg"), "fin_rate": (degrees(1.0), "deg/s"), "motor_current": (1.0, "A"),
    "motor_voltage": (1.0, "V"), "drive_reference": (1.0, "V")}
RECORDED = (*DISPLAY, "saturated")
# Of references inside an FMU: how they came to be.
_INTEGRATED = "integrated independently of its own parameters"
_RECORDED = "recorded of the package's own stepping: this shows that it runs here as it did when it was built"
_LINEAR_DURATION = 0.3  # s


@dataclass(frozen=True)
class CaseResult:
    """One reference case: how far the run went, and its errors; none without a reference."""

    name: str
    title: str
    kind: str
    stop_time: float
    stopped: float | None
    wall_time: float
    messages: tuple[str, ...]
    errors: Mapping[str, metrics.Errors]


@dataclass(frozen=True)
class Series:
    """A run and its reference (empty where it has none), SI, for the page.

    `run` is of the subject as it is, from which performance is judged; `exact` is the one to
    compare with the reference, with the start values of the case, true angle and speed fed back.
    """

    run: Run
    reference: Columns = field(default_factory=dict)
    exact: Run | None = None

    def compared(self, name: str) -> tuple[Any, Any]:
        """Return an output of the exact run and of the reference, as far as both go."""
        response, reference = (self.exact or self.run).columns[name], self.reference[name]
        rows = min(len(response), len(reference))
        return response[:rows], reference[:rows]


@checked
@dataclass(frozen=True)
class Result:
    """A whole validation; `reference` is the folder of the references, empty where there is none of this actuator.

    Where they are `inside` the subject, it is the file; not `independent` are those recorded of the package's own
    stepping. `series` (by case) and `linear_series` (by amplitude [deg], with the linear model's angles [rad]) are for
    the page.
    """

    about: Identification
    parameters: Mapping[str, Any]
    differences: tuple[Mapping[str, Any], ...]
    reference: str
    inside: bool
    independent: bool
    cases: tuple[CaseResult, ...]
    trajectory: tuple[Judged, ...]
    requirements: tuple[Judged, ...]
    comparisons: tuple[claims.Comparison, ...]
    findings: tuple[claims.Finding, ...]
    notes: tuple[str, ...]
    series: Mapping[str, Series] = field(repr=False)
    linear_series: Mapping[float, tuple[Run, Any]] = field(repr=False)
    origin: str = ""
    """Where the actuator's equations come from; empty where it does not say."""
    foreign: bool = False
    """Whether the references of its actuator are of other parameters, and nothing was compared with them."""

    @property
    def of_thesis(self) -> bool:
        """Whether the actuator is one of those shipped that come from the thesis."""
        return bool(self.origin) and parts(self.about.model)[0] in NAMES

    @property
    def criteria(self) -> tuple[Judged, ...]:
        """Everything to pass."""
        return (*self.trajectory, *self.requirements)

    @property
    def judged(self) -> list[Judged]:
        """The criteria that were run."""
        return [j for j in self.criteria if not j.skipped]

    @property
    def failed(self) -> list[Judged]:
        """The criteria that were run and are not met."""
        return [j for j in self.judged if not j.passed]

    @property
    def passed(self) -> bool:
        """Whether something was judged and all of it passed."""
        return verdict.all_passed(self.criteria)

    @property
    def unjudged(self) -> bool:
        """Whether the cases that were asked for ran to their end and there is no criterion for them."""
        criteria = self.judged or self.foreign or self.requirements
        return not criteria and bool(self.cases) and all(case.stopped is None for case in self.cases)

    @property
    def compared_with(self) -> str:
        """What trajectories are compared with, in words."""
        if not self.inside:
            return "the reference"
        return "the reference inside the FMU" if self.independent else "the response recorded inside the FMU"

    @property
    def verdict(self) -> str:
        """What came of it, in words."""
        if not self.judged:
            short = [case.name for case in self.cases if case.stopped is not None]
            ended = f" and {', '.join(short)} did not run to the end" if short else ""
            why = (f"no requirement can be measured of {self.about.model}" if self.requirements else
                   f"what was run has no reference of {'these parameters' if self.foreign else self.about.model}")
            return f"nothing was judged{ended}: {why}"
        return verdict.in_words(self.criteria, "criterion", "criteria")


def validate(subject: Subject, names: Sequence[str] | None = None, directory: Path | None = None,
             progress: Progress = silent, inside: bool = False, specification: Specification | None = None) -> Result:
    """Judge a subject by the reference cases in `directory` (default: the stored ones) and by requirements.

    Trajectories are judged by the stored references where these are of the subject's actuator and parameters, by those
    of a `directory` where they are of its actuator; the requirements of a `specification` (the shipped ones unless
    given) always. With `inside`, or where the stored ones are of another actuator or other
    parameters, trajectories are judged by the references embedded in an FMU. With `names`, only these cases are run
    and no requirement is judged. `progress` is called with the name of the run, how many are done and how many there
    are. Raises EmcasError where the validation cannot be carried out; a failing subject is a result.
    """
    folder = directory or models_directory() / "reference"
    cases, from_inside = _chosen(subject, names, folder, () if directory and not inside else subject.references, inside)
    supply = files.supply_start(subject.model, subject.values)
    others = [case for case in cases if case.with_supply(supply) is not case]
    cases = [case.with_supply(supply) for case in cases]
    where = subject.identification.file if from_inside else str(folder)
    excitations = {case.name: of_case(case.title, case.inputs, case.step, case.start_values) for case in cases}
    obstacles = {name: why for name, excitation in excitations.items()
                 if (why := subject.obstacle(with_encoder(excitation)))}
    notes = [f"{name} is left out: {why}" for name, why in obstacles.items()]
    notes += [f"{case.name} is run at the subject's own supply of {supply:.4g} V and not compared: its reference is of "
              f"{case.supply:.4g} V" for case in others if case.name not in obstacles and case.reference]
    cases = [case for case in cases if case.name not in obstacles]
    extra = {} if names else _linear_steps(subject)
    if not names and parts(subject.model)[0] == NONLINEAR and (why := obstacle(subject.values)):
        notes.append(f"The comparison with the linear model is left out: {why}")
    given = from_inside or directory is not None  # compared with whatever parameters they were made with
    total, series = len(cases) + len(extra), dict[str, Series]()
    outputs = [name for name in RECORDED if name in subject.outputs]
    for case in cases:
        progress(case.name, len(series), total)
        # The encoder's chatter hides small errors, so references do without; performance does not.
        exact, shipped = excitations[case.name], with_encoder(excitations[case.name])
        judged = case.reference and (_made_of(subject, case) or (given and case.model == subject.actuator.name))
        compared = subject.run(exact, outputs=outputs) if judged else None
        same = compared if exact.start_values == shipped.start_values else None
        run = same or subject.run(shipped, outputs=outputs)
        series[case.name] = Series(run, case.reference if compared else {}, compared)
    for name, excitation in extra.items():
        progress(name, len(series), total)
        series[name] = Series(subject.run(excitation, outputs=outputs))
    required: list[Judged] = []
    if not names:
        chosen = specification or load_requirements(None, subject.parameters)
        required = verdict.judge(subject, chosen, progress)
    progress("done", total, total)
    return _result(subject, where, from_inside, cases, series, required, notes)


def _chosen(subject: Subject, names: Sequence[str] | None, folder: Path, embedded: Sequence[stored.Stored],
            inside: bool) -> tuple[list[stored.Stored], bool]:
    """Return the cases to run, and whether their references are those embedded in the subject.

    Raises EmcasError where these are asked for and there are none, and as `stored.load` does.
    """
    if inside and not embedded:
        raise EmcasError(f"{subject.identification.file}: there are no references inside; an FMU that `emcas build` "
                         "makes without --no-references has some")
    chosen = {case.name: case for case in embedded if not names or case.name in names}
    usual = {case.name for case in CASES}
    others = [name for name in names or () if name in usual or name not in chosen]
    needed = () if names else [case.name for case in files.cases(load_parameters(model=subject.model))]
    cases = stored.load(folder, others, needed) if others or not names else []
    if inside or (chosen and (len(others) < len(names or ()) or not all(_made_of(subject, case) for case in cases))):
        # By what the others excite, performance is judged.
        return [chosen.pop(case.name, replace(case, reference={})) for case in cases] + list(chosen.values()), True
    return cases, False


def _made_of(subject: Subject, case: stored.Stored) -> bool:
    """Return whether a reference is of the subject's actuator and parameters."""
    made = files.response_hash({**subject.values, **case.start_values})
    return case.model == subject.actuator.name and case.parameters_hash in ("", made)


def _result(subject: Subject, where: str, inside: bool, cases: Sequence[stored.Stored], series: Mapping[str, Series],
            required: Sequence[Judged], notes: list[str]) -> Result:
    runs = {name: each.run for name, each in series.items()}
    linear = {}
    for amplitude in claims.AMPLITUDES:
        if (name := _linear_name(amplitude)) in runs:
            linear[amplitude] = runs[name], LinearModel(subject.values).simulate(runs[name].excitation.command)
    comparisons = tuple(claims.compare(a, *pair) for a, pair in linear.items() if pair[0].stopped is None)
    results = [_case_result(case, series[case.name]) for case in cases]
    trajectory = tuple(_trajectory(result, series[result.name]) for result in results if result.errors)
    compared = [case for case in cases if series[case.name].exact]
    independent = all(case.independent for case in compared)
    foreign = not compared and any(case.model == subject.actuator.name for case in cases if case.reference)
    notes[:0] = _origin(subject, where, inside, foreign, compared)
    findings = tuple(claims.claims(comparisons))
    notes += _notes(subject, compared, series)
    return Result(subject.identification, dict(subject.values), tuple(_differences(subject)),
                  where if trajectory else "", inside, independent, tuple(results), trajectory,
                  tuple(required), comparisons, findings, tuple(notes), series, linear,
                  subject.actuator.origin, foreign)


def _origin(subject: Subject, where: str, inside: bool, foreign: bool, compared: Sequence[stored.Stored]) -> list[str]:
    """Return a note on where the references come from: nothing where they are those of a folder."""
    if foreign:
        return [f"Trajectories are not compared: the references in {where} are of other parameters than the subject's; "
                "make its own with `emcas reference --parameters FILE --directory DIR` and validate with "
                "`--directory DIR`"]
    if not compared:
        none = (f"None of these cases has a reference inside {where}" if inside else
                f"There is no independent reference of {subject.actuator.name} in {where}")
        return [f"{none}: trajectories are not judged, performance is"]
    made = _RECORDED if any(not case.independent for case in compared) else _INTEGRATED
    return [f"{', '.join(case.name for case in compared)}: compared with what is inside {where}, {made}"] * inside


def _linear_name(amplitude: float) -> str:
    return f"linear_{amplitude:g}deg"


def _linear_steps(subject: Subject) -> dict[str, Excitation]:
    """Return steps to compare with the linear model, at its sample times; none of a subject it is no model of."""
    if parts(subject.model)[0] != NONLINEAR or obstacle(subject.values):
        return {}
    period = LinearModel(subject.values).sample_time
    return {_linear_name(amplitude): step_to(radians(amplitude), _LINEAR_DURATION, step=period)
            for amplitude in claims.AMPLITUDES}


def _case_result(case: stored.Stored, series: Series) -> CaseResult:
    run, errors = series.exact or series.run, {}
    for name, (scale, unit) in DISPLAY.items():
        if name in run.columns and name in series.reference:
            response, reference = series.compared(name)
            errors[name] = metrics.errors(response * scale, reference * scale, unit)
    return CaseResult(case.name, case.title, case.kind, case.stop_time, run.stopped, run.wall_time, run.messages,
                      errors)


def _trajectory(case: CaseResult, series: Series) -> Judged:
    """Judge the fin angle's largest error [deg] to the reference."""
    reason = series.exact.reason if series.exact else ""
    return Judged("1 % of the accuracy of Yerlikaya (2016), Table 2", case.name, case.title,
                  None if reason else case.errors["fin_angle"].maximum, "<=", TRAJECTORY_LIMIT, "deg", reason)


def _differences(subject: Subject) -> Iterator[Mapping[str, Any]]:
    """Give the parameters that are not the defaults."""
    defaults = {e.variable.name: e for e in load_parameters(model=subject.model).entries}
    for name in subject.identification.differences:
        yield {"name": name, "value": subject.values[name], "default": defaults[name].value,
               "unit": defaults[name].variable.unit}


def _notes(subject: Subject, compared: Sequence[stored.Stored], series: Mapping[str, Series]) -> Iterator[str]:
    if differences := subject.identification.differences:
        yield f"The parameters differ from the defaults: {', '.join(differences)}"
    foreign = [case.name for case in compared if not _made_of(subject, case)]
    if foreign:
        which = "all cases" if len(foreign) == len(compared) else ", ".join(foreign)
        yield (f"The references of {which} were made with other parameters than the subject's; make its own with "
               "`emcas reference --parameters FILE --directory DIR` and validate with `--directory DIR`")
    for name, each in series.items():
        if each.run.reason:
            yield f"{name}: {each.run.reason}"
        yield from (f"{name}: log: {message}" for message in each.run.messages)
