"""A comparison on the terminal, as JSON, as JUnit XML, as Markdown and as a page."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict
from itertools import groupby
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from junitparser import TestCase
from rich.console import RenderableType
from rich.markup import escape
from rich.text import Text

from ... import __version__
from ...bench import writers
from ...pages.numbers import with_unit
from ...pages.page import write_page
from ...pages.terminal import table
from ...support.writing import append
from . import files
from .comparison import Comparison, Row
from .model import output_units

if TYPE_CHECKING:
    from ...plotting import plots

SCHEMA = "emcas-baseline-check/1"
"""Name and version of the JSON layout; the number changes when a field is removed or changes its meaning."""
HEADER = ("case", "figure", ">approved", ">now", ">change", ">limit", "verdict")  # > aligns a column to the right
_STYLES = {"ok": "green", "not judged": "dim", "DRIFT": "bold red"}


def _number(value: float, form: str = ".5g", missing: str = "not reached") -> str:
    return format(value + 0.0, form) if isfinite(value) else missing


def cells(row: Row) -> tuple[str, ...]:
    """Return the cells of a row, in the order of HEADER."""
    name = row.name if row.at is None else f"{row.name}({with_unit(row.at, 's')})"
    judged = "not judged" if row.limit is None else "ok" if row.passed else "DRIFT"
    return (row.case, f"{name} [{row.unit}]", _number(row.approved), _number(row.now),
            _number(row.change, "+.3g", "-"), "-" if row.limit is None else f"{row.limit:.3g}", judged)


def selected(comparison: Comparison, everything: bool = False) -> Iterator[Row]:
    """Yield the rows that drifted and, for a case without drift, the row nearest to its limit; or `everything`."""
    for _, group in groupby(comparison.rows, lambda row: row.case):
        rows = list(group)
        drifted, judged = [row for row in rows if not row.passed], [row for row in rows if row.limit is not None]
        yield from rows if everything else drifted or sorted(judged, key=lambda row: -row.share)[:1]


def remedy(comparison: Comparison, command: str, folder: str) -> str:
    """Return the remedy for a drift from the baseline in `folder`; `command` records the baseline again."""
    was, now = comparison.baseline.recorded.get("file", ""), comparison.about.file
    original = "" if was in ("", now) else f" (or with {was}, from which the baseline was recorded)"
    return f"If this is intended: {command}{original}, and commit {folder}. If not, undo the change."


def tables(comparison: Comparison, everything: bool) -> Iterator[tuple[Sequence[str], Sequence[Sequence[str]]]]:
    """Yield tables, each a header and rows of cells: the selected rows, and the changed parameters if there are any."""
    yield HEADER, [cells(row) for row in selected(comparison, everything)]
    if comparison.parameters:
        yield ("changed parameter", ">approved", ">now"), [[*each.values()] for each in comparison.parameters]


def summary(comparison: Comparison, everything: bool = False) -> Iterator[RenderableType]:
    """Yield for the terminal both subjects, the tables, the reasons why cases stopped, the notes and the verdict."""
    about, was = comparison.about, comparison.baseline.recorded
    fin = f", fin {about.fin}" if about.fin else ""
    yield escape(f"{about.kind} {about.file}{fin}  {about.guid}".rstrip())
    yield escape(f"approved: {' '.join(was[key] for key in ('article', 'file', 'guid') if key in was)}")
    for header, rows in tables(comparison, everything):
        yield table(header, ([Text(cell, _STYLES[cell]) if cell in _STYLES else cell for cell in row] for row in rows),
                    whole=range(2, len(header)), plain=True)
    for case, why in comparison.stopped.items():
        yield f"[bold red]{escape(case)}:[/] {escape(why)}"
    for note in comparison.notes:
        yield f"[yellow]note:[/] {escape(note)}"
    yield f"[{'green' if comparison.passed else 'bold red'}]{comparison.verdict}[/]"


def as_dict(comparison: Comparison) -> dict[str, Any]:
    """Return the comparison for JSON, without trajectories."""
    rows = [{**asdict(row), "change": row.change, "share_of_limit": row.share, "passed": row.passed}
            for row in comparison.rows]
    return {"schema": SCHEMA, "baseline_schema": files.SCHEMA, "tool": f"emcas {__version__}",
            "passed": comparison.passed, "article": asdict(comparison.about), "fin": comparison.about.fin,
            "recorded": dict(comparison.baseline.recorded), "comparisons": rows, "stopped": comparison.stopped,
            "changed_parameters": comparison.parameters, "changed_marks": comparison.marks, "notes": comparison.notes}


def write_junit(comparison: Comparison, path: Path) -> None:
    """Write JUnit XML: a suite for each case, with a test case for each comparison that has a limit."""
    writers.write_junit("emcas baseline check", {
        f"{name}: {title}": _tests(comparison, name) for name, title in comparison.titles.items()}, path)


def _tests(comparison: Comparison, case: str) -> Iterator[TestCase]:
    classname = f"emcas.baseline.{case}"
    if case in comparison.stopped:
        yield writers.junit_case("run", classname, comparison.stopped[case], kind="not finished")
    for row in comparison.rows:
        if row.case == case and row.limit is not None:
            drift = "" if row.passed else ", ".join(
                f"{name.lstrip('>')} {cell}" for name, cell in list(zip(HEADER, cells(row), strict=True))[1:-1])
            yield writers.junit_case(row.name if row.at is None else f"{row.name}_trajectory", classname, drift,
                                     kind="drift")


def append_markdown(comparison: Comparison, remedy: str, path: Path, everything: bool = False) -> None:
    """Append a section in Markdown to a file, since several steps of a CI job write to one summary."""
    file = _cell(comparison.about.file)
    lines = [f"### {'✅' if comparison.passed else '❌'} {file}: {comparison.verdict}\n"]
    for header, rows in tables(comparison, everything):
        lines += markdown(header, rows), ""
    lines += [f"**{case}** {_cell(why)}\n" for case, why in comparison.stopped.items()]
    lines += [] if comparison.passed else [f"{_cell(remedy)}\n"]
    lines += [f"Note: {_cell(note)}\n" for note in comparison.notes]
    append(path, "\n".join(lines) + "\n\n")


def markdown(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a table in Markdown, with the verdict DRIFT in bold."""
    bold = (["**DRIFT**" if cell == "DRIFT" else _cell(cell) for cell in row] for row in rows)
    lines = [[name.lstrip(">") for name in header], ["---:" if name[0] == ">" else "---" for name in header], *bold]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def _cell(text: str) -> str:
    return " ".join(text.replace("|", "\\|").replace("<", "&lt;").split())


def write_report(comparison: Comparison, remedy: str, path: Path) -> None:
    """Write the page; the same comparison, command and date give the same bytes."""
    from ...plotting import plots  # here: at the top, Matplotlib would take a third of the start of every command

    about = comparison.about
    write_page(path, "studies/baseline/page.html.j2", [about.source], about=about, comparison=comparison,
               remedy=remedy, header=(HEADER[-1], *HEADER[:-1]),
               cells=lambda row: (cells(row)[-1], *cells(row)[:-1]),
               pictures=plots.pictures(_drawings(comparison)))


def _drawings(comparison: Comparison) -> Iterator[plots.Drawing]:
    """Yield a picture of each trajectory: the approved one, the present one, and their difference."""
    from ...plotting import plots

    limits, units = comparison.baseline.limits, output_units(comparison.baseline.model)
    for case, traces in comparison.now.traces.items():
        for name, new in traces.items():
            old, unit, limit = comparison.baseline.traces[case][name], units[name][0], limits.traces[name]
            x, unit_of_time = plots.time_axis((len(new) - 1) * limits.sample_time)
            time = np.arange(len(new)) * limits.sample_time * unit_of_time
            figure, (above, below) = plots.column(f"{name.replace('_', ' ')} [{unit}]", f"change [{unit}]",
                                                  x=x, height=1.5, height_ratios=(2, 1))
            above.plot(time, old, color=plots.GRAY, linewidth=3.0, label="approved")
            above.plot(time, new, color=plots.BLUE, label="now")
            above.legend(loc="best")
            below.plot(time, new - old, color=plots.VERMILLION)
            below.axhspan(-limit, limit, color=plots.GREEN, alpha=0.15, linewidth=0.0)
            yield plots.Drawing(f"{name} of {case}, approved and now", figure,
                                f"{case}: {comparison.titles[case]}. Largest change of {name} "
                                f"{np.max(np.abs(new - old)):.3g} {unit}, limit {limit:g} {unit} (shaded).")
