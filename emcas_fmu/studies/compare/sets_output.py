"""Sets or actuators side by side on the terminal, as JSON and as a page."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import RenderableType
from rich.markup import escape
from rich.table import Column as Heading

from ... import __version__
from ...bench import writers
from ...bench.verdict import Judged
from ...figures.plots import COMMAND, Drawing, figure, pictures
from .sets import PLOTTED, Result

SCHEMA = "emcas-compare/1"
"""Name and version of the JSON layout; the number changes when a field changes its meaning or goes."""
_WIDEST = 3.5  # points, of the first set's curves
_WINDOW = -0.02, 0.35  # s from the command


def summary(result: Result) -> Iterator[RenderableType]:
    """Yield the figures as a table with a column per set, the parameters that differ, and each set's verdict."""
    table = writers.terminal_table(
        Heading("requirement", no_wrap=True), Heading("required", justify="right", no_wrap=True),
        *(Heading(escape(column.name), justify="right", overflow="fold") for column in result.columns),
        title="Requirements")
    for row in result.rows:
        first = row[0]
        table.add_row(first.name, f"{first.sense} {first.limit:g} {first.unit}", *map(_cell, row))
    yield table
    for name, values in result.differing.items() if len(result.models) == 1 else ():
        yield escape(f"{name}: {', '.join(writers.number(value) for value in values)}")
    for column in result.columns:
        missed = [j.name for j in column.judged if not j.passed and not j.skipped]
        yield (f"{escape(column.name)}: [green]meets all[/]" if column.passed else
               f"{escape(column.name)}: [bold red]misses {', '.join(missed) or 'everything: nothing was judged'}[/]")


def _cell(j: Judged) -> str:
    if j.skipped:
        return "[dim]not judged[/]"
    return f"{j.more}{writers.number(j.measured)} {'[green]ok[/]' if j.passed else '[bold red]FAIL[/]'}"


def as_dict(result: Result) -> dict[str, Any]:
    """Return the figures and verdicts of all sets, and the parameters that differ."""
    return {"schema": SCHEMA, "tool": f"emcas {__version__}", "model": ", ".join(result.models),
            "differing": {name: dict(zip((c.name for c in result.columns), values, strict=True))
                          for name, values in result.differing.items()},
            "sets": [{"name": column.name, "model": column.parameters.actuator.name, "passed": column.passed,
                      "requirements": [j.as_dict() for j in column.judged]}
                     for column in result.columns]}


def write_report(result: Result, path: Path) -> None:
    """Write the page; the same result gives the same bytes."""
    writers.write_page(path, "studies/compare/page.html.j2", [c.parameters for c in result.columns], result=result,
                       pictures=pictures(_drawings(result)))


def _drawings(result: Result) -> Iterator[Drawing]:
    """Yield the picture of the responses of all sets to the large moves."""
    large, grid = figure(2, 2, width=10.0, height=2.6, sharex=True, x="time [ms]",
                         y=("fin angle [deg]", "fin rate [deg/s]"))
    widths = np.linspace(_WIDEST, 1.0, len(result.columns))  # so that curves that coincide are all visible
    for (angle, rate), title in zip(grid.T, PLOTTED, strict=True):
        for k, column in enumerate(result.columns):
            run = column.runs[title]
            if run.stopped is not None:
                continue
            time = run.columns["time"] - run.excitation.moves[-1].start
            shown = (time > _WINDOW[0]) & (time < _WINDOW[1])
            if not k:
                angle.step(time[shown] * 1e3, np.degrees(run.excitation.command)[shown], where="post", **COMMAND)
            look = {"color": f"C{k}", "linewidth": widths[k], "label": column.name}
            angle.plot(time[shown] * 1e3, np.degrees(run.columns["fin_angle"])[shown], **look)
            rate.plot(time[shown] * 1e3, np.degrees(run.columns["fin_rate"])[shown], **look)
        angle.set_title(title)
    grid[0, 0].legend(loc="lower right")
    yield Drawing("Large moves", large, "Every set's response to the command (dashed); the wider lines lie below.")
