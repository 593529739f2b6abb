"""The whole acceptance test: every test on the rig, judged."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from difflib import get_close_matches
from math import isfinite
from typing import Any

import numpy as np

from ...actuators import NONLINEAR
from ...bench.excitation import STEP, Excitation
from ...bench.provenance import conditions
from ...bench.subject import Identification, StoppedError, Subject
from ...bench.verdict import FileRequirement, Judged, all_passed, judge_table2
from ...errors import EmcasError
from ...parameters import load_parameters
from ...progress import Progress, silent
from ...reference.cases import LOAD
from ...variables import Variable
from . import mission, responses, static_accuracy, stepping, stiffness, threshold
from .outcome import Outcome, Value
from .rig import Rig

TESTS: Mapping[str, tuple[str, Callable[[Rig], Outcome]]] = {
    "step_response": ("Step response", responses.steps),
    "frequency_response": ("Frequency response", responses.frequency),
    "slew_rate": ("Slew rate", responses.slews),
    "static_accuracy": ("Static accuracy", static_accuracy.measure),
    "threshold": ("Threshold and resolution", threshold.measure),
    "dynamic_stiffness": ("Dynamic stiffness", stiffness.measure),
    "mission": ("Mission profile", mission.measure),
    "stepping": ("Accuracy of the stepping", stepping.measure),
}
_OF_TABLE_2 = {"accuracy": "static_accuracy", "unloaded_rate": "slew_rate", "loaded_rate": "slew_rate",
               "bandwidth_1deg": "frequency_response", "bandwidth_3p5deg": "frequency_response"}


@dataclass(frozen=True)
class Result:
    """What an acceptance test gave; `load` is the rated hinge moment [N.m]."""

    about: Identification
    load: float
    outcomes: Mapping[str, Outcome]
    judged: tuple[Judged, ...]
    parameters: Mapping[str, Any] = field(repr=False)
    model: str = NONLINEAR
    figures: Mapping[tuple[str, str], str] = field(default_factory=dict, repr=False)
    """Of a requirement, by its source and name: the figure it limits, as test.group.figure."""

    @property
    def sources(self) -> list[str]:
        """Where the requirements are from, each once."""
        return list(dict.fromkeys(j.source for j in self.judged))

    def limits(self, test: str) -> list[Judged]:
        """Return the requirements that limit figures of a test."""
        return [j for j in self.judged if not j.skipped
                and self.figures.get((j.source, j.name), _OF_TABLE_2.get(j.name, "")).partition(".")[0] == test]

    @property
    def entries(self) -> list[tuple[Variable, Any, str, str]]:
        """Every parameter: variable, value, where the value is from, and a note on that."""
        return [(e.variable, self.parameters[e.variable.name], *(
            ("the article's", "") if e.variable.name in self.about.differences else (e.source, e.note)))
            for e in load_parameters(model=self.model).entries if e.variable.name in self.parameters]

    @property
    def conditions(self) -> list[tuple[str, str, Any, str]]:
        """What the tests are carried out under: words, the parameter or input, its value, and unit."""
        return [*conditions(self.model, self.parameters), ("communication step", "", STEP, "s"),
                ("rated hinge moment", "", self.load, "N.m")]

    @property
    def stopped(self) -> Mapping[str, str]:
        """Tests that could not be finished, and why."""
        return {name: outcome.stopped for name, outcome in self.outcomes.items() if outcome.stopped}

    @property
    def failed(self) -> list[Judged]:
        """Requirements that are not met."""
        return [j for j in self.judged if not j.passed and not j.skipped]

    @property
    def passed(self) -> bool:
        """Whether every test was finished and every requirement is met."""
        return not self.stopped and all_passed(self.judged)


def carry_out(subject: Subject, *, load: float = LOAD, profile: Excitation | None = None,
              requirements: Sequence[FileRequirement] = (), progress: Progress = silent) -> Result:
    """Carry out every test. `progress` is called with the test's name, how many are done and how many there are.

    Raises EmcasError where a requirement names a figure there is not; a subject that fails is a result.
    """
    rig, outcomes, total = Rig(subject, load, profile), dict[str, Outcome](), len(TESTS) + 1
    # A fin that does not move has no gain and no coherence: such figures are nan, and no requirement passes on one.
    with np.errstate(divide="ignore", invalid="ignore"):
        progress("Table 2", 0, total)
        judged = judge_table2(rig.table2)
        for done, (name, (title, measure)) in enumerate(TESTS.items(), start=1):
            progress(title, done, total)
            try:
                outcome = measure(rig)
                lacking = {q.key: why for q in outcome.quantities if (why := subject.lacking(q.needs))}
            except StoppedError as error:
                outcome, lacking = Outcome("Not finished.", stopped=str(error)), {}
            outcomes[name] = replace(outcome, name=name, title=title, not_applicable=lacking)
    progress("done", total, total)
    judged += judge(requirements, outcomes)
    return Result(subject.identification, load, outcomes, tuple(judged), subject.values, subject.model,
                  {(r.source, r.name): r.figure for r in requirements})


def flat(outcomes: Mapping[str, Outcome]) -> Iterator[tuple[str, Value]]:
    """Give every figure as ``test.group.figure``."""
    for test, outcome in outcomes.items():
        for group, figures in outcome.figures.items():
            for key, value in figures.items():
                yield f"{test}.{group}.{key}", value


def judge(requirements: Sequence[FileRequirement], outcomes: Mapping[str, Outcome]) -> list[Judged]:
    """Judge the user's requirements by the figures of the tests. Raises EmcasError where there is no such figure."""
    figures = dict(flat(outcomes))
    judged = []
    for r in requirements:
        test, _, rest = r.figure.partition(".")
        outcome, (group, _, key) = outcomes.get(test), rest.partition(".")
        label = f"{r.source}: requirement {r.name}: "
        if isinstance(figures.get(r.figure), bool):
            raise EmcasError(f"{label}{r.figure} is true or false, and has no limit; choose a figure that is a number")
        if outcome and r.figure in figures:
            bound = outcome.beyond.get(rest) if r.sense == ">=" else None
            measured = float(figures[r.figure]) if bound is None else bound
            how = f"{outcome.title}, {outcome.label(group)}: {outcome.quantity(key).how}"
            judged.append(r.judged(measured, how if isfinite(measured) else
                                   f"the response never reaches what is measured: {how}", bound is not None))
        elif outcome and outcome.stopped:
            judged.append(r.judged(None, outcome.stopped))
        elif outcome and key in outcome.not_applicable:
            judged.append(r.judged(None, f"not applicable: {outcome.not_applicable[key]}"))
        else:
            numbers = [name for name, value in figures.items() if not isinstance(value, bool)]
            close = get_close_matches(r.figure, numbers, 3, 0.4) or numbers[:3]
            raise EmcasError(f"{label}there is no figure {r.figure}; close to it are {', '.join(close)} "
                             "(`emcas report --json FILE` writes all)")
    return judged
