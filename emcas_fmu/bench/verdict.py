"""Verdicts on requirements: the measured value, the margin, and whether the limit is kept.

All pages and commands use the verdicts of `judge`; `evaluate` measures many variants at once.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from itertools import groupby
from math import degrees, isfinite, isnan
from typing import Any, NamedTuple

import numpy as np
from junitparser import TestCase
from rich.console import RenderableType
from rich.markup import escape
from rich.table import Table
from rich.text import Text

from ..pages.numbers import number
from ..pages.terminal import table
from ..support.progress import Progress, silent
from .measure import TESTS, bound, measure
from .requirements import Case, Requirement, Specification
from .subject import Identity, Subject
from .writers import junit_case

SENSES = {"maximum": "<=", "minimum": ">="}


class Measured(NamedTuple):
    """The measured value of a requirement in a case, in the requirement's `unit`; nan or inf without a value."""

    requirement: Requirement
    case: Case
    measured: float


@dataclass(frozen=True)
class Judged:
    """A requirement with its measured value: `measured` [unit] must be at least or at most `limit` [unit].

    ``measured`` is None if the figure was not measured (skipped) or has no value (missed); ``note`` has the reason. A
    bandwidth ``beyond`` the range of the search is replaced by the nearer end of that range. ``how`` describes the
    measurement; ``case`` is the case of the worst value, empty for a requirement with one case.
    """

    source: str
    name: str
    title: str
    measured: float | None
    sense: str
    limit: float
    unit: str
    note: str = ""
    skipped: bool = False
    beyond: bool = False
    case: str = ""
    figure: str = ""
    how: str = ""
    reason: str = ""

    @property
    def margin(self) -> float | None:
        """Distance to the limit [unit], negative if the limit is missed; None without a value."""
        if self.measured is None or not isfinite(self.measured):
            return None
        return self.measured - self.limit if self.sense == ">=" else self.limit - self.measured

    @property
    def margin_percent(self) -> float | None:
        """The margin in % of the limit; None without a value."""
        return None if self.margin is None or not self.limit else 100.0 * self.margin / abs(self.limit)

    @property
    def passed(self) -> bool:
        """Whether the limit is kept; false without a value, or if the margin has only an upper bound."""
        return self.margin is not None and bool(self.margin >= 0.0) and self.more_margin != "< "

    @property
    def more(self) -> str:
        """The sign ``< `` or ``> `` before a figure that is only a bound; otherwise empty."""
        return bound(self.measured) if self.beyond and self.measured is not None else ""

    @property
    def more_margin(self) -> str:
        """The sign before the margin, which is the reverse of `more` for a maximum."""
        return self.more if self.sense == ">=" else {"> ": "< ", "< ": "> "}.get(self.more, "")

    def as_dict(self) -> dict[str, Any]:
        """Return the requirement with its margin and verdict, for JSON."""
        return {**asdict(self), "margin": self.margin, "margin_percent": self.margin_percent, "passed": self.passed}

    def junit_case(self, classname: str, time: float = 0.0) -> TestCase:
        """Return the requirement as a test case; `time` [s] is the wall time of its run."""
        return junit_case(self.name, classname, "" if self.passed else str(self), self.note if self.skipped else "",
                         time=time)

    def __str__(self) -> str:
        measured = "no value" if self.measured is None else f"{self.more}{number(self.measured)} {self.unit}"
        text = f"{self.title}: {measured}, required {self.sense} {self.limit:g} {self.unit}"
        remarks = "; ".join(filter(None, (self.how, self.note)))
        return f"{text} ({remarks})" if remarks else text


def evaluate(subject: Subject, specification: Specification, changes: Sequence[Mapping[str, Any]],
             progress: Progress = silent) -> list[list[Measured]]:
    """Return, for each variant, the figures of all requirements that can be measured, in their cases.

    Each item of `changes` has the parameters of a variant that differ from the subject's; a case overrides them. A
    variant's figures do not depend on other variants. They are ordered by case, then by test. `progress` is called with
    each test.
    """
    cases = {case.name: case for case in specification.cases}
    measurable = [(r.test, r) for r in specification.requirements if r.test and not r.obstacle(subject)]
    figures: dict[tuple[int, str], list[Measured]] = {(k, name): [] for k in range(len(changes)) for name in cases}
    tests = [(test, [r for _, r in group])
             for test, group in groupby(sorted(measurable, key=lambda each: repr(each[0])), key=lambda each: each[0])]
    for done, (test, requirements) in enumerate(tests):
        progress(str(test), done, len(tests))
        variants = [(k, name) for k in range(len(changes)) for name in cases
                    if any(name in r.cases for r in requirements)]
        with np.errstate(divide="ignore", invalid="ignore"):  # a fin that does not move has no gain: nan, which fails
            measured = measure(test, subject, [cases[name].of(changes[k]) for k, name in variants],
                               tuple(r.figure for r in requirements), tuple(r.sense for r in requirements))
        for (k, name), values in zip(variants, measured.tolist(), strict=True):
            figures[k, name] += [Measured(r, cases[name], value)
                                 for r, value in zip(requirements, values, strict=True) if name in r.cases]
    progress("done", len(tests), len(tests))
    return [[figure for name in cases for figure in figures[k, name]] for k in range(len(changes))]


def judge(subject: Subject, specification: Specification, progress: Progress = silent) -> list[Judged]:
    """Return the verdicts on a subject, each in its requirement's worst case; `progress` is called with each test."""
    (figures,) = evaluate(subject, specification, [{}], progress)
    by_name: dict[str, list[Measured]] = {}
    for figure in figures:
        by_name.setdefault(figure.requirement.name, []).append(figure)
    return [judged(r, by_name.get(r.name, []), subject) for r in specification.requirements]


def worst_of(figures: Iterable[Measured]) -> Measured:
    """Return the worst figure of a requirement; a figure without a finite value is the worst."""
    return max(figures, key=lambda f: f.requirement.sign * f.measured if isfinite(f.measured) else np.inf)


def judged(r: Requirement, figures: Sequence[Measured], subject: Subject) -> Judged:
    """Return the verdict on a requirement from its worst figure; it is skipped if none was measured."""
    unit, factor = r.shown
    fixed: dict[str, Any] = {
        "source": r.source, "name": r.name, "title": r.title or r.name, "sense": SENSES[r.sense],
        "limit": r.shown_limit, "unit": unit, "figure": r.figure, "how": r.how, "reason": r.reason}
    if not figures:
        return Judged(**fixed, measured=None, note=r.obstacle(subject), skipped=True)
    worst = worst_of(figures)
    fixed["case"] = case = worst.case.name if len(r.cases) > 1 else ""
    fixed["how"] += f"; worst in the case {case}" if case else ""
    clipped = r.test and r.test.amplitude > subject.command_limit * (1.0 + 1e-9)
    note = f"commands are clipped to {degrees(subject.command_limit):.6g} deg" if clipped else ""
    if not isfinite(worst.measured):
        return Judged(**fixed, measured=None, note="; ".join(filter(None, (note, _why(r, worst.measured)))))
    return Judged(**fixed, measured=worst.measured * factor, note=note,
                  beyond=r.figure in TESTS["sine"].figures and bool(bound(worst.measured)))


def _why(r: Requirement, measured: float) -> str:
    """Return the reason why a figure has no value."""
    kind = r.test.kind if r.test else ""
    if kind == "linear":
        return ("the closed loop is unstable, or the actuator cannot rest at 0" if isnan(measured) else
                "the loop's gain or phase never reaches the value at which this margin is measured")
    if not isnan(measured):
        return "the condition is not met by the end of the run"
    if kind == "sine":
        return "the response is not a sine of the command's frequency, or the run ended early"
    return "the response never reaches the measured condition, or the run ended early"


def counted(judged: Sequence[Judged]) -> list[Judged]:
    """Return the verdicts that were not skipped."""
    return [j for j in judged if not j.skipped]


def missed(judged: Sequence[Judged]) -> list[Judged]:
    """Return the verdicts of missed requirements."""
    return [j for j in counted(judged) if not j.passed]


def all_passed(judged: Sequence[Judged]) -> bool:
    """Return whether at least one requirement was judged and all judged requirements are met."""
    return bool(counted(judged)) and not missed(judged)


def in_words(judged: Sequence[Judged], one: str = "requirement", many: str = "requirements") -> str:
    """Return how many requirements are met or not judged, and the missed ones, in words; `one` and `many` are nouns."""
    total, failed = len(counted(judged)), len(missed(judged))
    left = len(judged) - total
    met = ("nothing was judged" if not total else
           f"{failed} of {total} {many} {'is' if failed == 1 else 'are'} not met" if failed else
           f"all {total} {many} are met" if total > 1 else f"the one {one} is met")
    names = ", ".join(j.name for j in missed(judged))
    return (met + (f"; {left} more {'was' if left == 1 else 'were'} not judged" if left else "")
            + (f": {names}" if names else ""))


def remarks(judged: Sequence[Judged]) -> list[str]:
    """Return a line for each requirement that is missed, not judged, or has a note."""
    return [f"{j.name}: {j.note}" if j.skipped else f"{j.name}: {j}" for j in judged if j.note or not j.passed]


def summary(about: Identity, heading: str, judged: Sequence[Judged], more: Iterable[RenderableType],
            notes: Iterable[str], passed: bool | None, verdict: str) -> Iterator[RenderableType]:
    """Yield a result for the terminal: subject, requirements as a table, `more`, notes and the verdict in words.

    `passed` is None where nothing was judged.
    """
    yield escape("  ".join(filter(None, (about.name, about.file, about.model, about.guid and f"GUID {about.guid}"))))
    if judged:
        yield summary_table(heading, judged)
    yield from more
    for note in (*remarks(judged), *notes):
        yield f"[yellow]note:[/] {escape(note)}"
    color = "yellow" if passed is None else "green" if passed else "bold red"
    yield f"[{color}]{escape(verdict)}[/]"


def summary_table(heading: str, judged: Sequence[Judged]) -> Table:
    """Return requirements as a table for the terminal, with a line between different sources."""
    rows: list[Sequence[str | Text] | None] = []
    for _, group in groupby(judged, lambda j: j.source):
        rows += ([j.name, j.more + number(j.measured), f"{j.sense} {j.limit:g}", j.more_margin + number(j.margin),
                  j.unit, marked(j)] for j in group)
        rows.append(None)
    return table([heading, ">measured", ">required", ">margin", "unit", ""], rows, whole=[0])


def marked(j: Judged) -> Text:
    """Return the verdict in a word, for the terminal."""
    return (Text("not judged", "dim") if j.skipped else Text("ok", "green") if j.passed else
            Text("FAIL", "bold red"))
