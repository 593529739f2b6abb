"""What a test finds, as plain data; the names of figures end in the unit people read them in."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from numpy.typing import NDArray

from ...bench import metrics, writers
from ...bench.metrics import FIGURES, result_name, unit_of
from ...bench.writers import typeset

Array = NDArray[Any]
Value = float | bool
Figures = Mapping[str, Mapping[str, Value]]
"""Group, then figure: {"plus_20deg": {"rise_time_s": ...}}; nan where there is no such figure."""


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
        """The unit of a column of the figure, and the factor to it: times are in ms."""
        return ("ms", 1e3) if self.unit == "s" else (self.unit, 1.0)

    @property
    def heading(self) -> str:
        """The label with the unit of a column."""
        return f"{self.label} [{typeset(self.shown[0])}]" if self.unit != "1" else self.label


def quantity(name: str, label: str) -> Quantity:
    """Return the quantity of a figure of the bench."""
    return Quantity(result_name(name)[0], label, FIGURES[name].title, FIGURES[name].needs)


def displayed(figures: Mapping[str, float], quantities: tuple[Quantity, ...]) -> dict[str, Value]:
    """Return those of the bench's figures that are `quantities`, by their names in a result."""
    keys = {q.key for q in quantities}
    return {key: value for key, value in metrics.displayed(figures).items() if key in keys}


@dataclass(frozen=True)
class Outcome:
    """One test: its figures and how they were measured.

    ``curves`` go into the JSON file, ``series`` are for the pictures only. ``stopped`` says why the test
    could not be finished; it has no figures then. ``estimate`` says what makes its figures an estimate;
    ``not_applicable``, by quantity, which outputs it needs the subject has not. ``beyond`` has the highest frequency
    [Hz] of figures, as group.figure, that lie beyond it.
    """

    method: str
    quantities: tuple[Quantity, ...] = ()
    figures: Figures = field(default_factory=dict)
    headline: tuple[str, ...] = ()
    """The most important figures, as group.figure."""
    labels: Mapping[str, str] = field(default_factory=dict)
    curves: Mapping[str, Mapping[str, Array]] = field(default_factory=dict)
    series: Mapping[str, Mapping[str, Array]] = field(default_factory=dict, repr=False)
    notes: tuple[str, ...] = ()
    estimate: str = ""
    stopped: str = ""
    name: str = ""
    title: str = ""
    not_applicable: Mapping[str, str] = field(default_factory=dict)
    beyond: Mapping[str, float] = field(default_factory=dict)

    def label(self, group: str) -> str:
        """Return a group's name for people."""
        return self.labels.get(group, group.replace("_", " "))

    def quantity(self, key: str) -> Quantity:
        """Return the quantity of a name."""
        return next(q for q in self.quantities if q.key == key)

    def described(self, group: str, key: str) -> tuple[str, Value]:
        """Return the sign before a figure, and the figure or what it lies beyond."""
        bound = self.beyond.get(f"{group}.{key}")
        return ("", self.figures[group][key]) if bound is None else ("> ", bound)

    def shown(self, group: str, q: Quantity) -> str:
        """Return a figure as it is shown in a column."""
        sign, value = self.described(group, q.key)
        return sign + writers.number(value if isinstance(value, bool) else value * q.shown[1]).replace("-", "−")

    def headlines(self) -> list[tuple[str, Quantity, str, Value]]:
        """Return group, quantity, sign and value of the headline figures there are."""
        paths = [path.split(".") for path in self.headline]
        return [(group, self.quantity(key), *self.described(group, key)) for group, key in paths
                if key in self.figures.get(group, {})]

    def left_out(self) -> list[tuple[str, list[str]]]:
        """Return why figures are not applicable, and the labels of those figures."""
        whys = dict.fromkeys(self.not_applicable.values())
        return [(why, [self.quantity(key).label for key, each in self.not_applicable.items() if each == why])
                for why in whys]

    def columns(self, groups: Figures) -> list[Quantity]:
        """Return the quantities some group has a figure for."""
        return [q for q in self.quantities if any(q.key in group for group in groups.values())]

    def tables(self) -> list[tuple[list[Quantity], Figures]]:
        """Return the figures as tables: groups that share no quantity with a table go into one of their own."""
        tables: list[dict[str, Mapping[str, Value]]] = []
        for name, figures in self.figures.items():
            home = next((t for t in tables if any(set(figures) & set(group) for group in t.values())), None)
            if home is None:
                tables.append({name: figures})
            else:
                home[name] = figures
        return [(self.columns(table), table) for table in tables]
