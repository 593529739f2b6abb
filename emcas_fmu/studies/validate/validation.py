"""The validation by reference cases, by requirements and, for the nonlinear actuator, by the thesis's linear model."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from math import degrees
from pathlib import Path
from typing import Any

from ...actuators import NONLINEAR, is_shipped, parts
from ...bench import metrics, verdict
from ...bench.excitation import Excitation, of_case, with_encoder
from ...bench.requirements import Specification, load_requirements
from ...bench.runs import Columns, Run
from ...bench.subject import Identity, Subject
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

TRAJECTORY_LIMIT = round(degrees(TOLERANCE), 9)  # deg, largest error of the fin angle
COMPARED = {"fin_angle": "rad", "fin_rate": "rad/s", "motor_current": "A", "motor_voltage": "V", "drive_reference": "V"}
RECORDED = (*COMPARED, "saturated")
_REMEDY = "make its own with `emcas reference --parameters FILE --directory DIR` and validate with this directory"


@dataclass(frozen=True)
class CaseResult:
    """The responses to a reference case [SI].

    `run` is the response of the subject as it is. `exact` is the response that is compared with the reference: true
    angle and speed are fed back; None without a comparison.
    """

    case: stored.Stored
    run: Run
    exact: Run | None

    @property
    def judged(self) -> Run:
        """The run that is compared with the reference; without a comparison, the run of the subject as it is."""
        return self.exact or self.run

    @property
    def reference(self) -> Columns:
        """The columns of the reference; empty if the case is not compared with it."""
        return self.case.reference if self.exact else {}

    def compared(self, name: str) -> tuple[Any, Any]:
        """Return an output and its reference [SI], up to the end of the shorter one."""
        response, reference = self.judged.columns[name], self.reference[name]
        rows = min(len(response), len(reference))
        return response[:rows], reference[:rows]

    @cached_property
    def errors(self) -> Mapping[str, metrics.Errors]:
        """The errors of the outputs that the reference has, in display units; empty without a comparison."""
        return {name: metrics.errors(response * scale, reference * scale, unit)
                for name, si in COMPARED.items() if name in self.judged.columns and name in self.reference
                for (response, reference), (unit, scale) in [(self.compared(name), metrics.shown(si))]}

    @property
    def trajectory(self) -> Judged:
        """The verdict on the largest error of the fin angle [deg]."""
        reason = self.exact.reason if self.exact else ""
        return Judged("1 % of the accuracy of Table 2 of Yerlikaya (2016)", self.case.name, self.case.title,
                      None if reason else self.errors["fin_angle"].maximum, "<=", TRAJECTORY_LIMIT, "deg", reason)


@checked
@dataclass(frozen=True)
class Validation:
    """The result of a validation.

    `folder` is the folder of the references, or the FMU if they are `inside` it. `cases` are by name. `linear_series`
    has, by amplitude [deg], the run of a step and the linear model's angles [rad]. `origin` is the source of the
    actuator's equations, empty if the actuator does not state it.
    """

    about: Identity
    parameters: Mapping[str, Any]
    differences: tuple[Mapping[str, Any], ...]
    folder: str
    inside: bool
    cases: Mapping[str, CaseResult]
    requirements: tuple[Judged, ...]
    linear_series: Mapping[float, tuple[Run, Any]] = field(repr=False)
    origin: str = ""
    notes: tuple[str, ...] = ()

    @property
    def compared(self) -> list[stored.Stored]:
        """The cases that are compared with their references."""
        return [result.case for result in self.cases.values() if result.exact]

    @property
    def independent(self) -> bool:
        """Whether all compared references are independent of the package's own stepping."""
        return all(case.independent for case in self.compared)

    @property
    def foreign(self) -> bool:
        """Whether there are references of the actuator, but none was compared, as they are of other parameters."""
        return not self.compared and any(result.case.model == self.about.model and result.case.reference
                                         for result in self.cases.values())

    @property
    def trajectory(self) -> tuple[Judged, ...]:
        """The verdicts on the trajectories that were compared."""
        return tuple(case.trajectory for case in self.cases.values() if case.errors)

    @cached_property
    def comparisons(self) -> list[dict[str, float]]:
        """The comparisons with the linear model, by amplitude; see `claims.compare`."""
        return [claims.compare(amplitude, run, linear) for amplitude, (run, linear) in self.linear_series.items()
                if run.stopped is None]

    @property
    def findings(self) -> list[dict[str, Any]]:
        """The findings from the comparison with the linear model; see `claims.claims`."""
        return claims.claims(self.comparisons)

    @property
    def of_thesis(self) -> bool:
        """Whether the actuator is the thesis's, for which the shipped estimates were chosen."""
        return is_shipped(self.about.model) and parts(self.about.model)[0] == NONLINEAR

    @property
    def criteria(self) -> tuple[Judged, ...]:
        """The verdicts on trajectories and on requirements."""
        return (*self.trajectory, *self.requirements)

    @property
    def judged(self) -> list[Judged]:
        """The criteria that were judged."""
        return verdict.counted(self.criteria)

    @property
    def failed(self) -> list[Judged]:
        """The judged criteria that are not met."""
        return verdict.missed(self.criteria)

    @property
    def passed(self) -> bool:
        """Whether at least one criterion was judged and all judged ones are met."""
        return verdict.all_passed(self.criteria)

    @property
    def short(self) -> list[str]:
        """The names of the cases that did not run to their end."""
        return [name for name, case in self.cases.items() if case.judged.stopped is not None]

    @property
    def outcome(self) -> bool | None:
        """Whether the subject passed; None if all cases ran to their end and no criterion applies to the subject."""
        criteria = self.judged or self.foreign or self.requirements
        return None if self.cases and not criteria and not self.short else self.passed

    @property
    def compared_with(self) -> str:
        """The references of the trajectories, in words."""
        if not self.inside:
            return "the reference"
        return "the reference inside the FMU" if self.independent else "the response recorded inside the FMU"

    @property
    def verdict(self) -> str:
        """The verdict in words."""
        if self.judged:
            return verdict.in_words(self.criteria, "criterion", "criteria")
        if self.outcome is None:
            return f"all runs reached their end; there is no reference of {self.about.model} to judge them by"
        ended = f" and {', '.join(self.short)} did not run to the end" if self.short else ""
        why = (f"no requirement can be measured of {self.about.model}" if self.requirements else
               f"the runs have no reference of {'these parameters' if self.foreign else self.about.model}")
        return f"nothing was judged{ended}: {why}"


def validate(subject: Subject, names: Sequence[str] | None = None, directory: Path | None = None,
             progress: Progress = silent, inside: bool = False,
             specification: Specification | None = None) -> Validation:
    """Judge a subject by the reference cases in `directory` (default: the shipped ones) and by requirements.

    References in a `directory` are used if of the subject's actuator, shipped ones if also of its parameters. With
    `inside`, or if the shipped references do not match, trajectories are judged by the references embedded in an FMU.
    Requirements are those of the `specification`, by default the shipped ones. With `names`, only these cases are run
    and no requirement is judged. `progress` is called with the name of the run, the number of finished runs and their
    total. Raises EmcasError if the validation cannot be carried out, but not if the subject fails.
    """
    folder = directory or models_directory() / "reference"
    available, inside = _chosen(subject, names, folder, () if directory and not inside else subject.references, inside)
    supply, cases, notes = files.supply_start(subject.model, subject.values), [], []
    for each in available:
        case = each.with_supply(supply)
        if why := subject.obstacle(with_encoder(_excitation(case))):
            notes.append(f"{case.name} is left out: {why}")
            continue
        cases.append(case)
        if each.reference and not case.reference:
            notes.append(f"{case.name} is run at the subject's own supply of {supply:.4g} V and not compared: its "
                         f"reference has {each.supply:.4g} V")
    steps: Mapping[float, Excitation] = {}
    if not names and parts(subject.model)[0] == NONLINEAR:
        if why := obstacle(subject.values):
            notes.append(f"The comparison with the linear model is left out: {why}")
        else:
            steps = claims.steps(subject.values)
    total, results, linear = len(cases) + len(steps), dict[str, CaseResult](), dict[float, tuple[Run, Any]]()
    outputs = [name for name in RECORDED if name in subject.outputs]
    for case in cases:
        progress(case.name, len(results), total)
        results[case.name] = _run(subject, case, inside or directory is not None, outputs)
    for amplitude, step in steps.items():
        progress(_step_name(amplitude), len(results) + len(linear), total)
        linear[amplitude] = subject.run(step, outputs=outputs), LinearModel(subject.values).simulate(step.command)
    required = () if names else verdict.judge(
        subject, specification or load_requirements(None, subject.parameters), progress)
    progress("done", total, total)
    differences = tuple({"name": name, "value": subject.values[name], "default": e.value, "unit": e.variable.unit}
                        for e in load_parameters(model=subject.model).entries
                        if (name := e.variable.name) in subject.identification.differences)
    result = Validation(subject.identification, dict(subject.values), differences,
                        subject.identification.file if inside else str(folder), inside, results, tuple(required),
                        linear, subject.actuator.origin)
    return replace(result, notes=tuple(_notes(subject, result, notes)))


def _excitation(case: stored.Stored) -> Excitation:
    return of_case(case.title, case.inputs, case.step, case.start_values)


def _step_name(amplitude: float) -> str:
    return f"linear_{amplitude:g}deg"


def _chosen(subject: Subject, names: Sequence[str] | None, folder: Path, embedded: Sequence[stored.Stored],
            inside: bool) -> tuple[list[stored.Stored], bool]:
    """Return the cases to run, and whether their references are those embedded in the subject.

    Raises EmcasError if embedded references are requested and there are none, and as `stored.load` does.
    """
    if inside and not embedded:
        raise EmcasError(f"{subject.identification.file}: there are no references inside; build the FMU with `emcas "
                         "build`, without --no-references")
    chosen = {case.name: case for case in embedded if not names or case.name in names}
    usual = {case.name for case in CASES}
    from_folder = [name for name in names or () if name in usual or name not in chosen]
    shipped = load_parameters(model=subject.model)
    needed = () if names else [case.name for case in files.cases(shipped.model, shipped.values)]
    cases = stored.load(folder, from_folder, needed) if from_folder or not names else []
    of_subject = all(_made_of(subject, case) for case in cases)
    if inside or (chosen and (len(from_folder) < len(names or ()) or not of_subject)):
        # The other cases are also run, without references.
        return [chosen.pop(case.name, replace(case, reference={})) for case in cases] + list(chosen.values()), True
    return cases, False


def _run(subject: Subject, case: stored.Stored, any_parameters: bool, outputs: Sequence[str]) -> CaseResult:
    """Run a case with the subject as it is and, for a reference of the subject, with true angle and speed fed back.

    With `any_parameters`, it is enough that the reference is of the subject's actuator.
    """
    # The encoder's chatter would hide small errors: references have no encoder.
    exact = _excitation(case)
    as_it_is = with_encoder(exact)
    comparable = case.reference and (
        _made_of(subject, case) or (any_parameters and case.model == subject.actuator.name))
    compared = subject.run(exact, outputs=outputs) if comparable else None
    same = compared if exact.start_values == as_it_is.start_values else None
    return CaseResult(case, same or subject.run(as_it_is, outputs=outputs), compared)


def _made_of(subject: Subject, case: stored.Stored) -> bool:
    """Return whether a reference is of the subject's actuator and parameters."""
    own_hash = files.response_hash({**subject.values, **case.start_values})
    return case.model == subject.actuator.name and case.parameters_hash in ("", own_hash)


def _notes(subject: Subject, result: Validation, further: Sequence[str]) -> Iterator[str]:
    """Yield notes on the references, the notes `further`, then notes on parameters and runs."""
    compared, runs = result.compared, {name: case.run for name, case in result.cases.items()}
    if result.foreign:
        yield (f"Trajectories are not compared: the references in {result.folder} are of other parameters than the "
               f"subject's; {_REMEDY}")
    elif not compared:
        none = (f"None of these cases has a reference inside {result.folder}" if result.inside else
                f"There is no independent reference of {result.about.model} in {result.folder}")
        remedy = "; `emcas reference` with this --model writes references for --directory"
        yield (f"{none}: trajectories are not judged{'; requirements are' * bool(result.requirements)}"
               f"{remedy * (subject.actuator.reference is not None and not result.inside)}")
    elif result.inside:
        made = ("integrated independently with its own parameters" if result.independent else "recorded from the "
                "package's own stepping: agreement shows that it runs here as it did when it was built")
        yield f"{', '.join(case.name for case in compared)}: compared with the references in {result.folder}, {made}"
    yield from further
    if result.differences:
        yield f"The parameters differ from the defaults: {', '.join(each['name'] for each in result.differences)}"
    if foreign := [case.name for case in compared if not _made_of(subject, case)]:
        which = "all cases" if len(foreign) == len(compared) else ", ".join(foreign)
        yield f"The references of {which} were made with other parameters than the subject's; {_REMEDY}"
    runs |= {_step_name(amplitude): run for amplitude, (run, _) in result.linear_series.items()}
    for name, run in runs.items():
        yield from (f"{name}: {each}" for each in (run.reason, *(f"log: {each}" for each in run.messages)) if each)
