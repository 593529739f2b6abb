"""A comparison on the terminal."""

from __future__ import annotations

from collections.abc import Iterator

from rich.box import SIMPLE_HEAD
from rich.console import RenderableType
from rich.markup import escape
from rich.table import Table

from .study import Changed, Comparison
from .table import HEADER, NUMERIC, lines, verdict

_STYLES = {"ok": "green", "told": "dim", "DRIFT": "bold red"}


def summary(comparison: Comparison, everything: bool = False) -> Iterator[RenderableType]:
    """What drifted, or what came nearest to its limit; what changed; the verdict."""
    about = comparison.identification
    which = f", fin {comparison.fin}" if comparison.fin else ""
    yield escape(f"{about.kind} {about.file}{which}  {about.guid}".rstrip())
    was = comparison.baseline.recorded
    yield escape(f"approved: {' '.join(was[key] for key in ('article', 'file', 'guid') if key in was)}")
    table = Table(*HEADER, box=SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False)
    for k, column in enumerate(table.columns):
        column.justify = "right" if k in NUMERIC else "left"
        column.no_wrap = k not in (0, 1)
        column.overflow = "fold"
    for shown in lines(comparison, everything):
        *cells, told = map(escape, shown.cells)
        table.add_row(*cells, f"[{_STYLES[told]}]{told}[/]")
    yield table
    for case, why in comparison.stopped.items():
        yield f"[bold red]{escape(case)}:[/] {escape(why)}"
    yield from _changes("parameter", comparison.parameters)
    for note in comparison.notes:
        yield f"[yellow]note:[/] {escape(note)}"
    yield f"[{'green' if comparison.passed else 'bold red'}]{verdict(comparison)}[/]"


def _changes(title: str, changes: tuple[Changed, ...]) -> Iterator[Table]:
    if changes:
        table = Table(title, "approved", "now", box=SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False)
        for changed in changes:
            table.add_row(*map(escape, (changed.name, changed.approved, changed.now)))
        yield table
