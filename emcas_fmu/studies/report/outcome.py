"""The rig, on which every test runs, and the outcome of a test: figures whose names end in their unit for display."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import degrees
from typing import Any

from numpy.typing import NDArray

from ...bench import metrics
from ...bench.excitation import Excitation
from ...bench.measure import BANDWIDTHS
from ...bench.metrics import FIGURES, result_name, unit_of
from ...bench.runs import Run
from ...bench.subject import Subject
from ...motions import RATED
from ...pages import numbers
from ...pages.numbers import typeset

Array = NDArray[Any]
Value = float | bool
Figures = Mapping[str, Mapping[str, Value]]
"""Group, then figure: {"plus_20deg": {"rise_time_s": ...}}; nan where a figure has no value."""
RECORDED = ("fin_angle", "fin_rate", "motor_current", "supply_power", "saturated", "at_stop")


@dataclass(frozen=True)
class Rig:
    """`load` is the rated hinge torque [N.m]; `mission` replaces the synthetic mission profile."""

    subject: Subject
    load: float = RATED
    mission: Excitation | None = None

    @property
    def limit(self) -> float:
        """Largest command [deg]."""
        return degrees(self.subject.command_limit)

    def run(self, excitation: Excitation) -> Run:
        """Return the response. Raises StoppedError where it ends early."""
        run = self.subject.run(excitation, outputs=[name for name in RECORDED if name in self.subject.outputs])
        run.finished()
        return run


@dataclass(frozen=True)
class Quantity:
    """A figure's name, its label in a table, how it was measured, and the outputs it needs."""

    key: str
    label: str
    how: str
    needs: tuple[str, ...] = ()

    @property
    def unit(self) -> str:
        """The figure's unit."""
        return unit_of(self.key)

    @property
    def shown(self) -> tuple[str, float]:
        """The unit of the figure's column, and the factor to it: times are in ms."""
        return ("ms", 1e3) if self.unit == "s" else (self.unit, 1.0)

    @property
    def heading(self) -> str:
        """The label with the unit of the column."""
        return f"{self.label} [{typeset(self.shown[0])}]" if self.unit != "1" else self.label


def quantity(name: str, label: str) -> Quantity:
    """Return the quantity of a figure of the bench."""
    return Quantity(result_name(name)[0], label, FIGURES[name].title, FIGURES[name].needs)


def displayed(figures: Mapping[str, float], quantities: tuple[Quantity, ...]) -> dict[str, Value]:
    """Return those of the bench's figures that are among the `quantities`, by their names in a result."""
    keys = {q.key for q in quantities}
    return {key: value for key, value in metrics.displayed(figures).items() if key in keys}


@dataclass(frozen=True)
class Outcome:
    """The figures of a test and how they were measured.

    `headline` names the most important figures, as group.figure. `curves` go into the JSON file, `data` (runs or
    arrays) into the picture only. `stopped` is the reason why a test was not finished; it has no figures then.
    `estimate` is the reason why its figures are an estimate; `not_applicable` names by quantity the outputs that the
    subject lacks. `beyond` has the highest frequency [Hz] of figures, as group.figure, that lie beyond it.
    """

    method: str
    quantities: tuple[Quantity, ...] = ()
    figures: Figures = field(default_factory=dict)
    headline: tuple[str, ...] = ()
    labels: Mapping[str, str] = field(default_factory=dict)
    curves: Mapping[str, Mapping[str, Array]] = field(default_factory=dict)
    data: Mapping[str, Any] = field(default_factory=dict, repr=False)
    notes: tuple[str, ...] = ()
    estimate: str = ""
    stopped: str = ""
    name: str = ""
    title: str = ""
    not_applicable: Mapping[str, str] = field(default_factory=dict)

    def label(self, group: str) -> str:
        """Return a group's name for people."""
        return self.labels.get(group, group.replace("_", " "))

    def quantity(self, key: str) -> Quantity:
        """Return the quantity of a name."""
        return next(q for q in self.quantities if q.key == key)

    def sign(self, group: str, key: str) -> str:
        """Return the sign before a figure: that of a bandwidth beyond the range of the search, otherwise none."""
        return "> " if key.startswith("bandwidth") and self.figures[group][key] >= BANDWIDTHS[1] else ""

    def shown(self, group: str, q: Quantity) -> str:
        """Return a figure as it is shown in a column."""
        value = self.figures[group][q.key]
        text = numbers.number(value if isinstance(value, bool) else value * q.shown[1]).replace("-", "−")
        return self.sign(group, q.key) + text

    def headlines(self) -> list[tuple[str, Quantity, str, Value]]:
        """Return label, quantity, sign and value of the headline figures that were measured."""
        paths = [path.split(".") for path in self.headline]
        return [(f"{self.label(group)}: {self.quantity(key).label}", self.quantity(key), self.sign(group, key),
                 self.figures[group][key]) for group, key in paths if key in self.figures.get(group, {})]

    def left_out(self) -> list[tuple[str, list[str]]]:
        """Return each reason why figures are not applicable, with the labels of those figures."""
        reasons = dict.fromkeys(self.not_applicable.values())
        return [(reason, [self.quantity(key).label for key, each in self.not_applicable.items() if each == reason])
                for reason in reasons]

    def columns(self, groups: Figures) -> list[Quantity]:
        """Return the quantities that at least one group has."""
        return [q for q in self.quantities if any(q.key in group for group in groups.values())]

    def tables(self) -> list[tuple[list[Quantity], Figures]]:
        """Return the figures as tables; groups without a quantity in common are in separate tables."""
        tables: list[dict[str, Mapping[str, Value]]] = []
        for name, figures in self.figures.items():
            home = next((t for t in tables if any(set(figures) & set(group) for group in t.values())), None)
            if home is None:
                tables.append({name: figures})
            else:
                home[name] = figures
        return [(self.columns(table), table) for table in tables]
