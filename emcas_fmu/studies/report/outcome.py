"""The rig on which every test runs, and the outcome of a test: groups of figures with names that end in the unit."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from math import degrees
from typing import Any, NamedTuple

from ...actuators import NONLINEAR, parts
from ...bench import measure
from ...bench.excitation import Excitation
from ...bench.metrics import FIGURES, figures_of, in_words, result_name, unit_of
from ...bench.requirements import Case, Specification, load_requirements
from ...bench.runs import Run
from ...bench.subject import Subject
from ...pages.numbers import with_unit
from ...parameters import Scalar, load_parameters, shipped_file
from ...simulation import Array
from ..tuning.study import shipped_cases

RECORDED = measure.recorded(figures_of("jump", "usage"))
_LABELS = {"bandwidth_3db": "-3 dB", "bandwidth_90deg": "-90 deg"}


class Tolerances(NamedTuple):
    """The cases that change only deviations of the actuator as built, and their file."""

    cases: list[Case]
    file: str

    @property
    def estimated(self) -> bool:
        """Whether the tolerances are those of a shipped file, which are estimates."""
        return self.file.startswith("models/")


@dataclass(frozen=True)
class Rig:
    """A subject with the requirements, load and mission of its tests.

    `other_load` [N.m], above 0, replaces the rated hinge moment of the requirements, `mission` the synthetic mission
    profile, `specification` the shipped requirements.
    """

    subject: Subject
    other_load: float | None = None
    mission: Excitation | None = None
    specification: Specification | None = None

    @cached_property
    def requirements(self) -> Specification:
        """The requirements by which the subject is judged."""
        return self.specification or load_requirements(None, self.subject.parameters)

    @cached_property
    def tolerances(self) -> Tolerances:
        """The tolerances in the requirements' file.

        If it has none, they are those of the tuning study of the actuator or, without a study, of the default actuator.
        """
        if found := _of_deviations(self.requirements.cases):
            return Tolerances(found, self.requirements.file)
        kind = parts(self.subject.model)[0]
        has_study = shipped_file("tuning", kind).stem == kind
        return Tolerances(_of_deviations(shipped_cases(load_parameters(model=kind if has_study else NONLINEAR))),
                          f"models/tuning{f'/{kind}' * has_study}.toml")

    @property
    def load(self) -> float:
        """The rated hinge moment [N.m] of the tests."""
        return self.other_load or self.requirements.rated_load

    @property
    def limit(self) -> float:
        """Largest command [deg]."""
        return degrees(self.subject.command_limit)

    def run(self, excitation: Excitation) -> Run:
        """Return the response with the outputs RECORDED. Raises StoppedError if it ends early."""
        run = self.subject.run(excitation, outputs=[name for name in RECORDED if name in self.subject.outputs])
        run.finished()
        return run


def _of_deviations(cases: Iterable[Case]) -> list[Case]:
    return [case for case in cases if case.values and all(name.startswith("deviation.") for name in case.values)]


class Quantity(NamedTuple):
    """A figure's name in a result, how it is measured, its label in a table, and the outputs it needs."""

    key: str
    how: str
    label: str
    needs: tuple[str, ...] = ()


def quantity(name: str) -> Quantity:
    """Return the quantity of a figure of the bench."""
    key, figure = result_name(name)[0], FIGURES[name]
    return Quantity(key, figure.title, _LABELS.get(name, in_words(key)), figure.needs)


def quantities(*runs: str) -> tuple[Quantity, ...]:
    """Return the quantities of the bench's figures of these kinds of run."""
    return tuple(map(quantity, figures_of(*runs)))


@dataclass(frozen=True)
class FigureGroup:
    """The figures under the motion, load or condition that `label` names; a figure without a value is nan.

    `headline` are the figures for the summary. `curve` is for the JSON file, `data` (a run or arrays) only for the
    picture. `bounds` has the sign of each figure that is only a bound.
    """

    label: str
    figures: Mapping[str, Scalar]
    headline: tuple[Quantity, ...] = ()
    curve: Mapping[str, Array] = field(default_factory=dict)
    data: Any = field(default=None, repr=False)
    bounds: Mapping[str, str] = field(default_factory=dict)

    def shown(self, q: Quantity) -> str:
        """Return a figure with its unit as text; empty if the group does not have it."""
        if (value := self.figures.get(q.key)) is None:
            return ""
        return self.bounds.get(q.key, "") + with_unit(value, unit_of(q.key))


@dataclass(frozen=True)
class Outcome:
    """The groups of figures of a test, and the `method` by which they were measured.

    `stopped` is the reason why the test was not finished; there are no groups then. `estimate` is the reason why
    figures are estimates. `not_applicable` has the reason why the subject lacks a figure, by the figure's name. If
    `tall`, the groups are the rows of the table, otherwise its columns.
    """

    method: str
    groups: Mapping[str, FigureGroup] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    estimate: str = ""
    stopped: str = ""
    name: str = ""
    title: str = ""
    quantities: tuple[Quantity, ...] = ()
    not_applicable: Mapping[str, str] = field(default_factory=dict)
    tall: bool = False

    @property
    def figures(self) -> dict[str, Mapping[str, Scalar]]:
        """The figures by group: {"plus_20deg": {"rise_time_s": ...}}."""
        return {name: group.figures for name, group in self.groups.items()}

    @property
    def curves(self) -> dict[str, Mapping[str, Array]]:
        """The curves of groups that have one."""
        return {name: group.curve for name, group in self.groups.items() if group.curve}

    def headlines(self) -> list[tuple[str, str, str, str]]:
        """Return a row for each measured headline figure: title (in the first row only), label, value and note."""
        rows = [("not finished", "")] if self.stopped else [
            (f"{group.label}: {q.label}", group.shown(q)) for group in self.groups.values() for q in group.headline
            if q.key in group.figures]
        return [("" if k else self.title, *row, "estimate" * bool(self.estimate)) for k, row in enumerate(rows)]

    @property
    def remarks(self) -> list[str]:
        """The notes, and the figures that are not applicable with their reasons; or why the test was not finished."""
        if self.stopped:
            return [f"not finished: {self.stopped}"]
        labels = {q.key: q.label for q in self.quantities}
        left_out = {why: [labels[key] for key, each in self.not_applicable.items() if each == why]
                    for why in self.not_applicable.values()}
        return [*self.notes, *(f"Not applicable: {', '.join(each)} ({why})." for why, each in left_out.items())]

    def tables(self) -> list[tuple[list[Quantity], list[FigureGroup]]]:
        """Return the quantities and groups of each table; groups with the same first figure share a table."""
        tables: dict[str, list[FigureGroup]] = {}
        for group in self.groups.values():
            tables.setdefault(next(iter(group.figures)), []).append(group)
        return [([q for q in self.quantities if any(q.key in group.figures for group in table)], table)
                for table in tables.values()]
