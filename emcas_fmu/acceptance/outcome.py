"""What a test finds, as plain data; the names of figures end in their unit."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]
Value = float | bool
Figures = Mapping[str, Mapping[str, Value]]
"""Group, then figure: {"plus_20deg": {"rise_time_s": ...}}; nan where there is no such figure."""

# Ending of a figure's name and the unit it tells, the longer endings first.
_UNITS = {
    "_n_m_per_rad": "N.m/rad", "_deg_per_s": "deg/s", "_percent": "%", "_n_m": "N.m", "_deg": "deg", "_hz": "Hz",
    "_db": "dB", "_s": "s", "_a": "A", "_w": "W", "_j": "J",
}


def unit_of(key: str) -> str:
    """The unit a figure's name ends in; 1 for a pure number."""
    return next((unit for ending, unit in _UNITS.items() if key.endswith(ending)), "1")


@dataclass(frozen=True)
class Quantity:
    """A figure's name, its label in a table, and how it was measured."""

    key: str
    label: str
    how: str

    @property
    def unit(self) -> str:
        """The figure's unit."""
        return unit_of(self.key)


@dataclass(frozen=True)
class Outcome:
    """One test: its figures and how they were measured.

    ``curves`` go into the JSON file, ``series`` are for the pictures only. ``stopped`` says why the test
    could not be finished; it has no figures then. ``estimate`` says what makes its figures an estimate.
    """

    name: str
    title: str
    method: str
    quantities: tuple[Quantity, ...] = ()
    figures: Figures = field(default_factory=dict)
    headline: tuple[str, ...] = ()
    """The figures to tell first, as group.figure."""
    labels: Mapping[str, str] = field(default_factory=dict)
    curves: Mapping[str, Mapping[str, Array]] = field(default_factory=dict)
    series: Mapping[str, Mapping[str, Array]] = field(default_factory=dict, repr=False)
    notes: tuple[str, ...] = ()
    estimate: str = ""
    stopped: str = ""

    def label(self, group: str) -> str:
        """A group's name for people."""
        return self.labels.get(group, group.replace("_", " "))

    def quantity(self, key: str) -> Quantity:
        """The quantity of that name."""
        return next(q for q in self.quantities if q.key == key)

    def told_first(self) -> list[tuple[str, Quantity, Value]]:
        """Group, quantity and value of the headline figures there are."""
        paths = [path.split(".") for path in self.headline]
        return [(group, self.quantity(key), self.figures[group][key]) for group, key in paths
                if key in self.figures.get(group, {})]

    def columns(self) -> list[Quantity]:
        """The quantities some group has a figure for."""
        return [q for q in self.quantities if any(q.key in group for group in self.figures.values())]

    def tables(self) -> list[tuple[list[Quantity], Figures]]:
        """The figures as tables: groups that share no quantity with a table go into one of their own."""
        tables: list[dict[str, Mapping[str, Value]]] = []
        for name, found in self.figures.items():
            home = next((t for t in tables if any(set(found) & set(group) for group in t.values())), None)
            if home is None:
                tables.append({name: found})
            else:
                home[name] = found
        return [([q for q in self.quantities if any(q.key in group for group in t.values())], t) for t in tables]


def flat(outcomes: Mapping[str, Outcome]) -> Iterator[tuple[str, Value]]:
    """Every figure as ``test.group.figure``."""
    for test, outcome in outcomes.items():
        for group, found in outcome.figures.items():
            for key, value in found.items():
                yield f"{test}.{group}.{key}", value


def mean(values: Array) -> float:
    """Arithmetic mean as a float."""
    return float(np.mean(values))
