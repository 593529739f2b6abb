"""The acceptance test: every test on the rig, the verdict on requirements, and the result as text, JSON and page."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass, field, replace
from itertools import groupby
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import RenderableType

from ... import __version__
from ...bench import verdict, writers
from ...bench.conditions import conditions
from ...bench.excitation import Excitation
from ...bench.measure import Test, obstacle
from ...bench.requirements import Requirement, Specification
from ...bench.runs import StoppedError
from ...bench.subject import ANGLE_KNOWN, Identity, Subject
from ...bench.verdict import Judged
from ...errors import EmcasError, hint
from ...motions import STEP
from ...pages.credibility import CONVERGENCE, INPUTS, ROBUSTNESS, TEST_INPUTS, VERIFICATION, Card, Fact
from ...pages.page import stated, write_page
from ...pages.terminal import table
from ...parameters import Scalar, load_parameters
from ...parameters.schema import unknown
from ...support.progress import Progress, silent
from . import accuracy, budget, mission, responses, stiffness
from .outcome import Outcome, Quantity, Rig
from .pictures import pictures

SCHEMA = "emcas-acceptance/3"
"""Name and version of the JSON layout; the number changes when a field is removed or changes its meaning."""
TESTS: Mapping[str, tuple[str, Callable[[Rig], Outcome], tuple[Quantity, ...]]] = {
    "step_response": ("Step response", responses.steps, responses.MOTION),
    "frequency_response": ("Frequency response", responses.frequency, responses.FREQUENCY),
    "slew_rate": ("Slew rate", responses.slews, responses.MOTION),
    "static_accuracy": ("Static accuracy", accuracy.static, accuracy.STATIC),
    "accuracy_budget": ("Accuracy budget", budget.measure, budget.QUANTITIES),
    "threshold": ("Threshold and resolution", accuracy.threshold, accuracy.THRESHOLD),
    "dynamic_stiffness": ("Dynamic stiffness", stiffness.measure, stiffness.QUANTITIES),
    "mission": ("Mission profile", mission.measure, mission.QUANTITIES),
    "stepping": ("Accuracy of the stepping", accuracy.stepping, accuracy.STEPPING),
}
"""The tests by name: title, function that carries it out, and quantities that it may measure."""


@dataclass(frozen=True)
class Acceptance:
    """The result of an acceptance test.

    `load` is the hinge moment [N.m] of the tests, `rated_load` that of the requirements. `loads` are the moments [N.m]
    of requirements, by the names of the requirements. `low_supply` has the names of those at another supply than
    the actuator's, whose limits are not plotted. `unloaded` is the reason why no load moves the fin; empty if loads do.
    """

    about: Identity
    load: float
    rated_load: float
    card: Card
    outcomes: Mapping[str, Outcome]
    judged: tuple[Judged, ...]
    parameters: Mapping[str, Any] = field(repr=False)
    model: str
    loads: Mapping[str, float]
    low_supply: frozenset[str]
    unloaded: str

    @property
    def load_note(self) -> str:
        """The reason why no load moves the fin, or the loads of requirements if the tests have another; or empty."""
        others = sorted((load, name) for name, load in self.loads.items() if self.load not in (self.rated_load, load))
        words = [f"{load:g} N.m: {', '.join(name for _, name in group)}"
                 for load, group in groupby(others, lambda other: other[0])]
        return self.unloaded or (
            f"tests and mission have a load of {self.load:g} N.m, but requirements are judged under their own: "
            f"{'; '.join(words)}" if words else "")

    @property
    def stopped(self) -> Mapping[str, str]:
        """The reasons why tests were not finished, by the tests' names."""
        return {name: outcome.stopped for name, outcome in self.outcomes.items() if outcome.stopped}

    @property
    def verdict(self) -> list[str]:
        """The verdict in sentences, on the requirements and on tests that were not finished."""
        tests = f"{len(self.stopped)} of {len(self.outcomes)} tests were not finished: {', '.join(self.stopped)}"
        return [verdict.in_words(self.judged), *([tests] if self.stopped else ())]

    @property
    def passed(self) -> bool:
        """Whether every test was finished and every requirement is met."""
        return not self.stopped and verdict.all_passed(self.judged)


def carry_out(subject: Subject, *, load: float | None = None, profile: Excitation | None = None,
              specification: Specification | None = None, progress: Progress = silent) -> Acceptance:
    """Carry out every test, and judge the subject by a specification, the shipped one by default.

    `load` replaces the rated hinge moment [N.m] of the requirements, `profile` the synthetic mission profile.
    `progress` is called with the test's name, the number of finished tests and their total. Raises EmcasError for a
    requirement on a figure that no test has, but not if the subject fails.
    """
    rig, outcomes, total = Rig(subject, load, profile, specification), dict[str, Outcome](), len(TESTS) + 1
    card = subject.card  # raises for an FMU with a damaged card, before the tests
    chosen = rig.requirements
    of_report = {r.name: r for r in chosen.requirements if r.test is None}
    for r in of_report.values():
        _check_figure(r, chosen.file)
    # A fin that does not move has neither gain nor coherence. Such figures are nan, and no requirement passes with nan.
    with np.errstate(divide="ignore", invalid="ignore"):
        progress("requirements", 0, total)
        judged = verdict.judge(subject, chosen)
        for done, (name, (title, measure, quantities)) in enumerate(TESTS.items(), start=1):
            progress(title, done, total)
            try:
                outcome = measure(rig)
            except StoppedError as error:
                outcome = Outcome("Not finished.", stopped=str(error))
            lacking = {q.key: why for q in quantities if (why := subject.lacking(q.needs))}
            outcomes[name] = replace(outcome, name=name, title=title, quantities=quantities,
                                     not_applicable={**outcome.not_applicable, **lacking})
    progress("done", total, total)
    return Acceptance(subject.identification, rig.load, chosen.rated_load, _card(card, outcomes), outcomes, tuple(
        _of_report(j, outcomes, chosen.file, of_report[j.name].optional) if j.name in of_report else j for j in judged),
        subject.values, subject.model, {r.name: abs(r.test.torque) for r in chosen.requirements
                                        if r.test and r.test.torque},
        frozenset(r.name for r in chosen.requirements if r.test and r.test.supply != 1.0),
        obstacle(Test("load", torque=rig.load), "peak_angle", subject))


def flat_figures(outcomes: Mapping[str, Outcome]) -> Iterator[tuple[str, Scalar]]:
    """Yield every figure as ``test.group.figure``."""
    for test, outcome in outcomes.items():
        for name, group in outcome.groups.items():
            for key, value in group.figures.items():
                yield f"{test}.{name}.{key}", value


def _card(card: Card, outcomes: Mapping[str, Outcome]) -> Card:
    """Return the credibility card with facts from the tests."""
    def figures(test: str, key: str) -> dict[str, float]:
        return {group.label: float(group.figures[key]) for group in outcomes[test].groups.values()
                if isfinite(group.figures[key])}

    if errors := figures("stepping", "fin_angle_deg"):
        note = f"The largest of {len(errors)} motions. {outcomes['stepping'].method}"
        card = card.having(VERIFICATION, Fact(CONVERGENCE, max(errors.values()), "deg", note=note))
    card = card.having(INPUTS, Fact(TEST_INPUTS, "those of the tests, as described",
                                    note=outcomes["mission"].estimate))
    return card.having(ROBUSTNESS, *(Fact(f"largest static error, {label}", error, "deg") for label, error in figures(
        "static_accuracy", "largest_error_deg").items()))


def _check_figure(r: Requirement, file: str) -> None:
    """Raise EmcasError for a requirement on a figure that no test of the report has."""
    test, _, key = r.figure.split(".")
    keys = [q.key for q in TESTS[test][2]] if test in TESTS else []
    if key not in keys:
        fault = f"the test {test} has no figure {key}" if keys else f"there is no test {test}"
        raise EmcasError(f"{file}: requirements.{r.name}.figure = {r.figure}: {fault}; "
                         f"{unknown(key, keys) if keys else unknown(test, TESTS)}")


def _of_report(judged: Judged, outcomes: Mapping[str, Outcome], file: str, optional: bool) -> Judged:
    """Return the verdict on a figure of the report. Raises EmcasError if it is missing or a Boolean."""
    figures, (test, group, key) = dict(flat_figures(outcomes)), judged.figure.split(".")
    outcome, value = outcomes[test], figures.get(judged.figure)
    if outcome.stopped or key in outcome.not_applicable:
        return replace(judged, note=outcome.stopped or f"not applicable: {outcome.not_applicable[key]}",
                       skipped=optional and not outcome.stopped)
    if value is None or isinstance(value, bool):
        numbers = [name for name, each in figures.items() if not isinstance(each, bool)]
        raise EmcasError(f"{file}: requirements.{judged.name}.figure = {judged.figure}: there is no such figure that is"
                         f" a number{hint(judged.figure, numbers)} (`emcas report --json FILE` writes all)")
    (how,) = (q.how for q in outcome.quantities if q.key == key)
    finite = isfinite(value)
    return replace(judged, measured=value if finite else None, note="" if finite else "it is not reached",
                   skipped=False, how=f"{outcome.title}, {outcome.groups[group].label}: {how}",
                   beyond=key.startswith("bandwidth") and bool(outcome.groups[group].bounds[key]))


def summary(result: Acceptance) -> Iterator[RenderableType]:
    """Yield the subject, the requirements and headline figures as tables, then notes and the verdict."""
    notes = [result.load_note] if result.load_note else []
    notes += [f"{outcome.title}: {note}" for outcome in result.outcomes.values() for note in outcome.remarks]
    figures = table(["test", "figure", ">measured", "note"], (
        row for outcome in result.outcomes.values() for row in outcome.headlines()), plain=True)
    return verdict.summary(result.about, "requirement", result.judged, [figures], notes, result.passed,
                           "; ".join(result.verdict))


def as_dict(result: Acceptance, date: str = "") -> dict[str, Any]:
    """Return the result for JSON: figures, curves, methods and requirements, without time series."""
    outcomes = result.outcomes
    return {
        "schema": SCHEMA, "passed": result.passed, "tool": f"emcas {__version__}", "date": date or None,
        "identification": asdict(result.about), "rated_load_n_m": result.load,
        "credibility": result.card.as_dict(),
        "requirements": [j.as_dict() for j in result.judged],
        "figures": {name: o.figures for name, o in outcomes.items()},
        "curves": {name: o.curves for name, o in outcomes.items() if o.curves},
        "methods": {name: {"method": o.method, "estimate": o.estimate or None, "stopped": o.stopped or None,
                           "notes": o.notes, "not_applicable": o.not_applicable,
                           "figures": {q.key: q.how for rows, _ in o.tables() for q in rows}}
                    for name, o in outcomes.items()},
    }


def write_junit(result: Acceptance, path: Path) -> None:
    """Write a test case for each requirement and each test."""
    writers.write_junit("emcas report", {
        "requirements": [j.junit_case("emcas.requirement") for j in result.judged],
        "tests finished": [writers.junit_case(name, "emcas.test", outcome.stopped, kind="not finished")
                           for name, outcome in result.outcomes.items()]}, path)


def write_report(result: Acceptance, path: Path, date: str = "", document: str = "", revision: str = "") -> None:
    """Write the page, with number and revision of the document; same result, command and date give the same bytes."""
    homed = [("homing required, in runs without the input home", name, value, "") for name, value in ANGLE_KNOWN.items()
             if name in result.parameters]
    rows = [*conditions(result.model, result.parameters), *homed,
            ("communication step", "", STEP, "s"), ("rated hinge moment", "", result.load, "N.m")]
    entries = ((e.variable, result.parameters[e.variable.name], *(
        ("the article's", "") if e.variable.name in result.about.differences else (e.source, e.note)))
        for e in load_parameters(model=result.model).entries if e.variable.name in result.parameters)
    write_page(path, "studies/report/page.html.j2", [result.about.source], date, r=result, about=result.about,
               document=document, revision=revision, pictures=pictures(result.outcomes, [
                   j for j in result.judged if j.name not in result.low_supply]),
               headlines=[(outcome, *row) for outcome in result.outcomes.values() for row in outcome.headlines()],
               conditions=[(label, stated(value, unit, name)) for label, name, value, unit in rows], entries=entries)
