"""A comparison in words: the same rows on a terminal, in Markdown and on a page, and the summary on a terminal."""

from __future__ import annotations

from collections.abc import Iterator
from math import isfinite

from rich.box import SIMPLE_HEAD
from rich.console import RenderableType
from rich.markup import escape
from rich.table import Table

from .model import NEVER
from .study import Comparison, Row

HEADER = ("case", "figure", "approved", "now", "change", "limit", "verdict")
NUMERIC = range(2, 6)  # of the header
_STYLES = {"ok": "green", "not judged": "dim", "DRIFT": "bold red"}


def number(value: float) -> str:
    """Return five significant digits; `never` where a level is not reached."""
    return f"{value + 0.0:.5g}" if isfinite(value) else NEVER


def cells(row: Row) -> tuple[str, ...]:
    """Return a row as it is shown, a cell for each name of HEADER."""
    change = row.change
    moved = f"{change + 0.0:+.3g}" if isfinite(change) else "-"
    limit = "-" if row.limit is None else f"{row.limit:.3g}"
    name = f"{row.name} [{row.unit}]" if row.at is None else f"{row.name}({row.at:g} s) [{row.unit}]"
    judged = "not judged" if row.limit is None else "ok" if row.passed else "DRIFT"
    return row.case, name, number(row.approved), number(row.now), moved, limit, judged


def selected(comparison: Comparison, everything: bool = False) -> Iterator[Row]:
    """Yield what drifted, and of a case without drift what comes nearest to its limit; or everything."""
    for case in dict.fromkeys(row.case for row in comparison.rows):
        rows = [row for row in comparison.rows if row.case == case]
        drifted = [row for row in rows if not row.passed]
        judged = [row for row in rows if row.limit is not None]
        nearest = [max(judged, key=lambda row: row.share)] if judged else []
        yield from rows if everything else drifted or nearest


def verdict(comparison: Comparison) -> str:
    """Return the result in a sentence."""
    if not comparison.judged and not comparison.stopped:
        return "nothing was judged: the baseline has no limits"
    if comparison.passed:
        return f"no drift: {comparison.judged} comparisons are within their limits"
    parts = [f"{len(comparison.drifted)} of {comparison.judged} comparisons drifted"] if comparison.drifted else []
    if comparison.stopped:
        parts.append(f"{len(comparison.stopped)} of {len(comparison.baseline.cases)} cases did not run to the end")
    return " and ".join(parts)


def remedy(comparison: Comparison, file: str, folder: str) -> str:
    """Return what to do about a drift from the baseline in `folder`; `file` is the article's, empty for the shipped."""
    fin = comparison.identification.fin or 1
    which = f" --fin {fin}" if fin > 1 else ""
    was, now = comparison.baseline.recorded.get("file", ""), comparison.identification.file
    before = "" if was in ("", now) else f" (or of {was}, which the baseline was recorded of)"
    record = " ".join(filter(None, ("emcas baseline record", file, "--output", folder)))
    return (f"If this is intended: {record}{which}{before}, and commit {folder}. "
            "If not, undo the change.")


def summary(comparison: Comparison, everything: bool = False) -> Iterator[RenderableType]:
    """Yield what drifted, or what came nearest to its limit; what changed; the verdict."""
    about = comparison.identification
    which = f", fin {about.fin}" if about.fin else ""
    yield escape(f"{about.kind} {about.file}{which}  {about.guid}".rstrip())
    was = comparison.baseline.recorded
    yield escape(f"approved: {' '.join(was[key] for key in ('article', 'file', 'guid') if key in was)}")
    table = _table(*HEADER)
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
        changes = _table("parameter", "approved", "now")
        for changed in comparison.parameters:
            changes.add_row(*map(escape, changed))
        yield changes
    for note in comparison.notes:
        yield f"[yellow]note:[/] {escape(note)}"
    yield f"[{'green' if comparison.passed else 'bold red'}]{verdict(comparison)}[/]"


def _table(*header: str) -> Table:
    return Table(*header, box=SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False)
