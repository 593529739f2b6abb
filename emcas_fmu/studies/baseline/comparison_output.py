"""A comparison on the terminal, as JSON, as JUnit XML, as Markdown and as a page; all show the same rows."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import asdict
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np
from junitparser import TestCase
from rich.console import RenderableType
from rich.markup import escape

from ... import __version__
from ...bench import writers
from ...figures import plots
from ...pages.page import write_page
from ...support.writing import append
from .comparison import Comparison, Row
from .model import NEVER, output_units
from .model import SCHEMA as BASELINE

SCHEMA = "emcas-baseline-check/1"
"""Name and version of the JSON layout; the number changes when a field changes its meaning or goes."""
HEADER = ("case", "figure", "approved", "now", "change", "limit", "verdict")
NUMERIC = range(2, 6)  # of the header
_STYLES = {"ok": "green", "not judged": "dim", "DRIFT": "bold red"}


def number(value: float) -> str:
    """Return a number with five significant digits; `never` where a level is not reached."""
    return f"{value + 0.0:.5g}" if isfinite(value) else NEVER


def cells(row: Row) -> tuple[str, ...]:
    """Return the cells of a row, in the order of HEADER."""
    change = row.change
    moved = f"{change + 0.0:+.3g}" if isfinite(change) else "-"
    limit = "-" if row.limit is None else f"{row.limit:.3g}"
    name = f"{row.name} [{row.unit}]" if row.at is None else f"{row.name}({row.at:g} s) [{row.unit}]"
    judged = "not judged" if row.limit is None else "ok" if row.passed else "DRIFT"
    return row.case, name, number(row.approved), number(row.now), moved, limit, judged


def selected(comparison: Comparison, everything: bool = False) -> Iterator[Row]:
    """Yield the rows that drifted, and of a case without drift the one nearest to its limit; or all rows."""
    for case in dict.fromkeys(row.case for row in comparison.rows):
        rows = [row for row in comparison.rows if row.case == case]
        drifted = [row for row in rows if not row.passed]
        judged = [row for row in rows if row.limit is not None]
        nearest = [max(judged, key=lambda row: row.share)] if judged else []
        yield from rows if everything else drifted or nearest


def verdict(comparison: Comparison) -> str:
    """Return the verdict in a sentence."""
    if not comparison.judged and not comparison.stopped:
        return "nothing was judged: the baseline has no limits"
    if comparison.passed:
        return f"no drift: {comparison.judged} comparisons are within their limits"
    parts = [f"{len(comparison.drifted)} of {comparison.judged} comparisons drifted"] if comparison.drifted else []
    if comparison.stopped:
        parts.append(f"{len(comparison.stopped)} of {len(comparison.baseline.cases)} cases did not run to the end")
    return " and ".join(parts)


def remedy(comparison: Comparison, file: str, folder: str) -> str:
    """Return the remedy for a drift from the baseline in `folder`; `file` is the subject's, empty for the shipped."""
    fin = comparison.identification.fin or 1
    which = f" --fin {fin}" if fin > 1 else ""
    was, now = comparison.baseline.recorded.get("file", ""), comparison.identification.file
    before = "" if was in ("", now) else f" (or of {was}, which the baseline was recorded of)"
    record = " ".join(filter(None, ("emcas baseline record", file, "--output", folder)))
    return (f"If this is intended: {record}{which}{before}, and commit {folder}. "
            "If not, undo the change.")


def summary(comparison: Comparison, everything: bool = False) -> Iterator[RenderableType]:
    """Yield the selected rows as a table, the changed parameters, notes and the verdict."""
    about = comparison.identification
    which = f", fin {about.fin}" if about.fin else ""
    yield escape(f"{about.kind} {about.file}{which}  {about.guid}".rstrip())
    was = comparison.baseline.recorded
    yield escape(f"approved: {' '.join(was[key] for key in ('article', 'file', 'guid') if key in was)}")
    table = writers.terminal_table(*HEADER)
    for k, column in enumerate(table.columns):
        column.justify = "right" if k in NUMERIC else "left"
        column.no_wrap = k not in (0, 1)
        column.overflow = "fold"
    for row in selected(comparison, everything):
        *values, judged = map(escape, cells(row))
        table.add_row(*values, f"[{_STYLES[judged]}]{judged}[/]")
    yield table
    for case, why in comparison.stopped.items():
        yield f"[bold red]{escape(case)}:[/] {escape(why)}"
    if comparison.parameters:
        changes = writers.terminal_table("parameter", "approved", "now")
        for changed in comparison.parameters:
            changes.add_row(*map(escape, changed))
        yield changes
    for note in comparison.notes:
        yield f"[yellow]note:[/] {escape(note)}"
    yield f"[{'green' if comparison.passed else 'bold red'}]{verdict(comparison)}[/]"


def as_dict(comparison: Comparison) -> dict[str, Any]:
    """Return all of the comparison except the trajectories."""
    rows = [{**asdict(row), "change": row.change, "share_of_limit": row.share, "passed": row.passed}
            for row in comparison.rows]
    about = comparison.identification
    return {"schema": SCHEMA, "baseline_schema": BASELINE, "tool": f"emcas {__version__}",
            "passed": comparison.passed, "article": asdict(about), "fin": about.fin,
            "recorded": dict(comparison.baseline.recorded), "comparisons": rows, "stopped": comparison.stopped,
            "changed_parameters": [changed._asdict() for changed in comparison.parameters],
            "changed_marks": [changed._asdict() for changed in comparison.marks], "notes": comparison.notes}


def write_junit(comparison: Comparison, path: Path) -> None:
    """Write a test case for each comparison with a limit, a suite for each case."""
    writers.write_junit("emcas baseline check", {
        f"{name}: {title}": _tests(comparison, name) for name, title in comparison.titles.items()}, path)


def _tests(comparison: Comparison, case: str) -> Iterator[TestCase]:
    classname = f"emcas.baseline.{case}"
    if case in comparison.stopped:
        yield writers.junit_case("run", classname, comparison.stopped[case], kind="not finished")
    for row in comparison.rows:
        if row.case == case and row.limit is not None:
            shown = list(zip(HEADER, cells(row), strict=True))[1:-1]
            drift = "" if row.passed else ", ".join(f"{key} {cell}" for key, cell in shown)
            name = row.name if row.at is None else f"{row.name}_trajectory"
            yield writers.junit_case(name, classname, drift, kind="drift")


def append_markdown(comparison: Comparison, remedy: str, path: Path, everything: bool = False) -> None:
    """Append a section to a file; several steps of a job write to its summary."""
    append(path, "\n".join(_markdown(comparison, remedy, everything)) + "\n\n")


def _markdown(comparison: Comparison, remedy: str, everything: bool) -> Iterator[str]:
    about = comparison.identification
    yield f"### {'✅' if comparison.passed else '❌'} {_cell(about.file)}: {verdict(comparison)}\n"
    yield from _table(HEADER, [cells(row) if row.passed else (*cells(row)[:-1], f"**{cells(row)[-1]}**")
                               for row in selected(comparison, everything)], NUMERIC)
    for case, why in comparison.stopped.items():
        yield f"**{case}** {_cell(why)}\n"
    if comparison.parameters:
        yield "Parameters that are not those approved:\n"
        yield from _table(("parameter", "approved", "now"), comparison.parameters, range(1, 3))
    if not comparison.passed:
        yield f"{_cell(remedy)}\n"
    yield from (f"Note: {_cell(note)}\n" for note in comparison.notes)


def _table(header: tuple[str, ...], rows: Iterable[tuple[str, ...]], numeric: range) -> Iterator[str]:
    yield f"| {' | '.join(header)} |"
    yield f"|{'|'.join('---:' if k in numeric else '---' for k in range(len(header)))}|"
    yield from (f"| {' | '.join(map(_cell, row))} |" for row in rows)
    yield ""


def _cell(text: str) -> str:
    return " ".join(text.replace("|", "\\|").replace("<", "&lt;").split())


def write_report(comparison: Comparison, remedy: str, path: Path) -> None:
    """Write the page; the same comparison gives the same bytes."""
    write_page(path, "studies/baseline/page.html.j2", [comparison.identification.source],
                       about=comparison.identification, comparison=comparison, verdict=verdict(comparison),
                       remedy=remedy, columns=[">" * (k in NUMERIC) + name for k, name in enumerate(HEADER)],
                       numeric=NUMERIC, cells=cells, pictures=plots.pictures(_drawings(comparison)))


def _drawings(comparison: Comparison) -> Iterator[plots.Drawing]:
    """Yield the picture of each trajectory, approved and now, with their difference."""
    units = output_units(comparison.baseline.model)
    for case, curves in comparison.curves.items():
        for name, (time, old, new) in curves.items():
            unit, limit = units[name], comparison.baseline.limits.traces[name]
            label = f"{name.replace('_', ' ')} [{unit}]"
            figure, (above, below) = plots.column(label, f"change [{unit}]", x="time [s]", height=1.5,
                                                  height_ratios=(2, 1))
            above.plot(time, old, color=plots.GRAY, linewidth=3.0, label="approved")
            above.plot(time, new, color=plots.BLUE, label="now")
            above.legend(loc="best")
            below.plot(time, new - old, color=plots.VERMILLION)
            below.axhspan(-limit, limit, color=plots.GREEN, alpha=0.15, linewidth=0.0)
            largest = float(np.max(np.abs(new - old)))
            yield plots.Drawing(f"{name} of {case}, approved and now", figure,
                                f"{case}: {comparison.titles[case]}. Largest change of {name} "
                                f"{largest:.3g} {unit}, limit {limit:g} {unit} (shaded).")
