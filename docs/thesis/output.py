"""Output of the program: page, JSON and terminal."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from rich.console import RenderableType
from rich.markup import escape

from emcas_fmu import __version__
from emcas_fmu.bench import writers
from emcas_fmu.pages import numbers, page
from emcas_fmu.pages.terminal import table

from .entry import REASONS, Table
from .study import Outcome, Result

SCHEMA = "emcas-thesis/2"
"""Name and version of the JSON layout; the number changes if a field changes its meaning or is removed."""
_CHAPTERS = {"1": "Introduction", "2": "Dynamic modelling", "3": "Identification of the parameters",
             "4": "Linear model and controllers", "5": "Simulation and tests"}


def as_dict(result: Result) -> dict[str, Any]:
    """Return every entry with its status and numbers."""
    about = result.about
    return {"schema": SCHEMA, "emcas": __version__, "parameters": about.file,
            "parameters_sha256": about.parameters_sha256, "differences": about.differences, "counts": result.counts,
            "entries": [_entry(outcome) for outcome in result.outcomes]}


def _entry(outcome: Outcome) -> dict[str, Any]:
    entry, shown = outcome.entry, outcome.shown
    document: dict[str, Any] = {"entry": entry.name, "title": entry.title, "status": outcome.status,
                                "met": entry.met, "note": entry.note}
    if outcome.stopped:
        document["stopped"] = outcome.stopped
    if shown:
        document |= {"conditions": shown.conditions, "unknown": shown.unknown, "picture": outcome.picture is not None,
                     "caption": shown.caption, "rows": shown.table.as_dicts() if shown.table else []}
    return document


def write_json(result: Result, path: Path) -> None:
    """Write every entry with its status and numbers as JSON."""
    writers.write_json(as_dict(result), path)


def numeric(table: Table) -> list[bool]:
    """Return a list with, for each column, true if it has numbers."""
    return [any(isinstance(row[i], float) for row in table.rows) for i in range(len(table.columns))]


def cell(value: Any) -> str:
    """Return a cell as text."""
    return value if isinstance(value, str) else numbers.number(value)


def write_page(result: Result, path: Path) -> None:
    """Write the page; the same result gives the same bytes."""
    figures = [o for o in result.outcomes if o.entry.kind == "Figure"]
    groups = [(f"Chapter {number}: {title}", [o for o in figures if o.entry.chapter == number])
              for number, title in _CHAPTERS.items()]
    groups.append(("Tables", [o for o in result.outcomes if o.entry.kind == "Table"]))
    page.write_page(path, Path(__file__).with_name("page.html.j2"), [result.about.source], r=result, about=result.about,
                       numeric=numeric, cell=cell, groups=[(title, group) for title, group in groups if group])


def summary(result: Result, whole: bool) -> Iterator[RenderableType]:
    """Yield the counts of a `whole` run, or each entry with its numbers; then the entries that failed."""
    if whole:
        yield table(["entries of the thesis's lists", ">"], (
            [f"not shown: {status}" if status in REASONS else status, str(count)]
            for status, count in result.counts.items()))
    else:
        for outcome in result.outcomes:
            yield from _printed(outcome)
    for outcome in result.stopped:
        yield f"[bold red]not finished:[/] {outcome.entry.name}: {escape(outcome.stopped)}"


def _printed(outcome: Outcome) -> Iterator[RenderableType]:
    entry, shown = outcome.entry, outcome.shown
    yield escape(f"{entry.name}  {entry.title}: {outcome.status}. {entry.note}".strip())
    if shown:
        yield escape(f"  {shown.conditions}")
    if shown and shown.table:
        yield table((">" * right + name for name, right in zip(shown.table.columns, numeric(shown.table), strict=True)),
                    (map(cell, row) for row in shown.table.rows))
