"""Judge parameter sets and actuators by the same requirements, and show them side by side: terminal, JSON and page."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from math import radians
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import RenderableType
from rich.markup import escape
from rich.text import Text

from ... import __version__
from ...actuators import NAMES, capabilities, is_named
from ...bench import verdict
from ...bench.measure import Test, excitation
from ...bench.requirements import load_requirements
from ...bench.runs import Run
from ...bench.subject import ParameterSubject
from ...bench.verdict import Judged
from ...errors import EmcasError, hint
from ...pages import numbers
from ...pages.page import write_page
from ...pages.terminal import table
from ...parameters import ParameterError, ParameterSet, load_parameters, parameter_file, shipped_file
from ...plotting.plots import COMMAND_STYLE, Drawing, figure, pictures
from ...support.progress import Progress, silent

SCHEMA = "emcas-compare/1"
"""Name and version of the JSON layout; the number changes when a field is removed or changes its meaning."""
_WIDEST = 3.5  # points, line width of the first set
_WINDOW = -0.02, 0.35  # s, first and last plotted time from the command
DEFAULTS = "default"
"""Name of the default set."""
DRIVES = (DEFAULTS, "drive-si", "drive-scaled", "drive-pi")
"""The sets that are compared by default if the actuator has a current loop."""
_OUTPUTS = ("fin_angle", "fin_rate")
PLOTTED: Mapping[str, Test] = {"Step to 20 deg": Test("step", radians(20.0), 0.45),
                             "Slew from -20 to 20 deg against 100 N.m": Test("slew", radians(20.0), 0.5, -100.0)}
"""The tests whose responses are plotted, by title."""


@dataclass(frozen=True)
class Column:
    """One set or actuator: name, parameters, judged requirements, and the responses to the PLOTTED tests by title."""

    name: str
    parameters: ParameterSet
    judged: tuple[Judged, ...]
    runs: Mapping[str, Run] = field(repr=False)

    @property
    def passed(self) -> bool:
        """Whether at least one requirement was judged, and all judged requirements are met."""
        return verdict.all_passed(self.judged)


@dataclass(frozen=True)
class SetComparison:
    """Parameter sets, or actuators, side by side."""

    columns: tuple[Column, ...]

    @property
    def rows(self) -> list[tuple[Judged, ...]]:
        """A row for each requirement: the judged requirement of each column."""
        return list(zip(*(column.judged for column in self.columns), strict=True))

    @property
    def estimates(self) -> list[str]:
        """Names of the parameters that are engineering estimates in at least one column."""
        estimates = {name for column in self.columns for name in column.parameters.estimates}
        return [name for name in self.units if name in estimates]

    @property
    def units(self) -> dict[str, str]:
        """Units of all parameters by name."""
        return {e.variable.name: e.variable.unit for column in self.columns for e in column.parameters.entries}

    @property
    def models(self) -> list[str]:
        """Names of the actuators, each once."""
        return list(dict.fromkeys(column.parameters.actuator.name for column in self.columns))

    @property
    def differing(self) -> dict[str, tuple[Any, ...]]:
        """Values, by name, of the parameters that all columns have and that differ between them."""
        sets = [column.parameters.values for column in self.columns]
        shared = {name: tuple(values[name] for values in sets) for name in sets[0]
                  if all(name in values for values in sets)}
        return {name: values for name, values in shared.items() if len(set(values)) > 1}


def load_sets(names: Sequence[str], model: str, below: Sequence[Path] = ()) -> dict[str, ParameterSet]:
    """Return parameter sets by the names of shipped sets, parameter files or actuators (also Python files).

    The files `below` override the default set of every actuator; a shipped set or a file overrides both for `model`.
    Without names, the sets are DRIVES, or DEFAULTS alone for an actuator without a current loop. Raises EmcasError.
    """
    if twice := [name for name in names if names.count(name) > 1]:
        raise EmcasError(f"{twice[0]}: appears twice; name each set once")
    base = load_parameters(below, model=model)
    names = names or (DRIVES if capabilities.CURRENT_LOOP in base.actuator.provides else (DEFAULTS,))

    def loaded(name: str) -> ParameterSet:
        if name == DEFAULTS:
            return base
        if is_named(name):
            return load_parameters(below, model=name)
        try:
            parameter_file(name)
        except ParameterError as error:
            raise EmcasError(f"{error}; the actuators are {', '.join(NAMES)}{hint(name, NAMES)}, or your Python file "
                             "(.py)") from error
        return load_parameters(name, base)

    return {name: loaded(name) for name in names}


def compare(sets: Mapping[str, ParameterSet], progress: Progress = silent,
            requirements: Path | None = None) -> SetComparison:
    """Judge each set by the requirements of a file, by default the shipped requirements of the first set's actuator.

    `progress` is called with the set and the test, the number of finished tests, and their total. Raises EmcasError.
    """
    columns = list[Column]()
    requirements = requirements or next((shipped_file("requirements", each.model) for each in sets.values()), None)
    for done, (name, parameters) in enumerate(sets.items()):
        subject = ParameterSubject(parameters)
        judged = verdict.judge(subject, load_requirements(requirements, parameters),
                               lambda test, at, of, name=name, done=done: progress(  # type: ignore[misc]
                                   f"{name}: {test}", done * of + at, len(sets) * of))
        runs = {title: subject.run(excitation(test, 1.0, subject), outputs=_OUTPUTS)
                for title, test in PLOTTED.items()}
        columns.append(Column(name, parameters, tuple(judged), runs))
    return SetComparison(tuple(columns))


def summary(result: SetComparison) -> Iterator[RenderableType]:
    """Yield a table of all figures, the parameters that differ (if there is one actuator), and each set's verdict."""
    yield table(["requirement", ">required", *(f">{column.name}" for column in result.columns)], (
        [first.name, f"{first.sense} {first.limit:g} {first.unit}", *map(_cell, (first, *others))]
        for first, *others in result.rows), "Requirements", range(2), plain=True)
    for name, values in result.differing.items() if len(result.models) == 1 else ():
        yield escape(f"{name}: {', '.join(numbers.number(value) for value in values)}")
    for column in result.columns:
        missed, judged = (", ".join(j.name for j in verdict.missed(column.judged)), len(verdict.counted(column.judged)))
        skipped = f"; {len(column.judged) - judged} not judged" if judged < len(column.judged) else ""
        yield (f"{escape(column.name)}: [green]meets all {judged}[/]{skipped}" if column.passed else
               f"{escape(column.name)}: [bold red]misses {missed or 'everything: nothing was judged'}[/]{skipped}")


def _cell(j: Judged) -> Text:
    return verdict.marked(j) if j.skipped else Text(f"{j.more}{numbers.number(j.measured)} ") + verdict.marked(j)


def as_dict(result: SetComparison) -> dict[str, Any]:
    """Return the result for JSON: figures and verdicts of all sets, and the parameters that differ."""
    return {"schema": SCHEMA, "tool": f"emcas {__version__}", "model": ", ".join(result.models),
            "differing": {name: dict(zip((c.name for c in result.columns), values, strict=True))
                          for name, values in result.differing.items()},
            "sets": [{"name": column.name, "model": column.parameters.actuator.name, "passed": column.passed,
                      "requirements": [j.as_dict() for j in column.judged]}
                     for column in result.columns]}


def write_report(result: SetComparison, path: Path) -> None:
    """Write the page; the same result, command and date give the same bytes."""
    write_page(path, "studies/compare/page.html.j2", [c.parameters for c in result.columns], result=result,
               pictures=pictures(_drawings(result)))


def _drawings(result: SetComparison) -> Iterator[Drawing]:
    """Yield one plot: the responses of all sets to the PLOTTED tests."""
    large, grid = figure(2, 2, width=10.0, height=2.6, sharex=True, x="time [ms]",
                         y=("fin angle [deg]", "fin rate [deg/s]"))
    widths = np.linspace(_WIDEST, 1.0, len(result.columns))  # curves that coincide are all visible
    for (angle, rate), title in zip(grid.T, PLOTTED, strict=True):
        for k, column in enumerate(result.columns):
            run = column.runs[title]
            if run.stopped is not None:
                continue
            time = run.columns["time"] - run.excitation.moves[-1].start
            shown = (time > _WINDOW[0]) & (time < _WINDOW[1])
            if not k:
                angle.step(time[shown] * 1e3, np.degrees(run.excitation.command)[shown], where="post", **COMMAND_STYLE)
            look = {"color": f"C{k}", "linewidth": widths[k], "label": column.name}
            angle.plot(time[shown] * 1e3, np.degrees(run.columns["fin_angle"])[shown], **look)
            rate.plot(time[shown] * 1e3, np.degrees(run.columns["fin_rate"])[shown], **look)
        angle.set_title(title)
    grid[0, 0].legend(loc="lower right")
    yield Drawing("Large moves", large, "Responses of all sets to the command (dashed), wide lines below narrow ones.")
