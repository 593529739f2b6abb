"""The whole acceptance test: every test on the bench, judged."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..excitation import Excitation
from ..reference.cases import LOAD
from . import frequency, mission, slewing, static_accuracy, steps, stiffness, threshold
from .article import Article, Identification
from .bench import Bench, StoppedError
from .outcome import Outcome
from .requirements import Judged, Wanted, judge, judge_table2

TESTS: Mapping[str, tuple[str, Callable[[Bench], Outcome]]] = {
    steps.NAME: ("Step response", steps.measure),
    frequency.NAME: ("Frequency response", frequency.measure),
    slewing.NAME: ("Slew rate", slewing.measure),
    static_accuracy.NAME: ("Static accuracy", static_accuracy.measure),
    threshold.NAME: ("Threshold and resolution", threshold.measure),
    stiffness.NAME: ("Dynamic stiffness", stiffness.measure),
    mission.NAME: ("Mission profile", mission.measure),
}

Progress = Callable[[str, int, int], None]


@dataclass(frozen=True)
class Campaign:
    """What an acceptance test found."""

    identification: Identification
    load: float
    """Rated hinge moment [N.m]."""
    outcomes: Mapping[str, Outcome]
    judged: tuple[Judged, ...]
    parameters: Mapping[str, Any] = field(repr=False)

    @property
    def stopped(self) -> Mapping[str, str]:
        """Tests that could not be finished, and why."""
        return {name: outcome.stopped for name, outcome in self.outcomes.items() if outcome.stopped}

    @property
    def passed(self) -> bool:
        """Whether every test was finished and every requirement is met."""
        return not self.stopped and bool(self.judged) and all(j.passed for j in self.judged)


def carry_out(article: Article, *, load: float = LOAD, profile: Excitation | None = None,
              wanted: Sequence[Wanted] = (), progress: Progress | None = None) -> Campaign:
    """Carry out every test. `progress` is called with the test's name, how many are done and how many there are.

    Raises EmcasError where a requirement names a figure there is not; an article that fails is a result.
    """
    bench = Bench(article, load, profile)
    outcomes: dict[str, Outcome] = {}
    total = len(TESTS) + 1

    def tell(name: str, done: int) -> None:
        if progress:
            progress(name, done, total)

    # A fin that does not move has no gain and no coherence: such figures are nan, and no requirement passes on one.
    with np.errstate(divide="ignore", invalid="ignore"):
        tell("Table 2", 0)
        judged = judge_table2(bench)
        for done, (name, (title, measure)) in enumerate(TESTS.items(), start=1):
            tell(title, done)
            try:
                outcomes[name] = measure(bench)
            except StoppedError as error:
                outcomes[name] = Outcome(name, title, "Not finished.", stopped=str(error))
    tell("done", total)
    judged += judge(wanted, outcomes)
    return Campaign(article.identification, load, outcomes, tuple(judged), article.values)
