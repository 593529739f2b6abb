"""A comparison in words: the same rows on a terminal, in Markdown and on a page."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from math import isfinite

from .model import NEVER
from .study import Comparison, Row

HEADER = ("case", "figure", "approved", "now", "change", "limit", "verdict")
NUMERIC = range(2, 6)  # of the header


@dataclass(frozen=True)
class Line:
    """A row as it is shown, a cell for each name of HEADER."""

    cells: tuple[str, ...]
    row: Row


def number(value: float) -> str:
    """Five significant digits; `never` where a level is not reached."""
    return f"{value + 0.0:.5g}" if isfinite(value) else NEVER


def line(row: Row) -> Line:
    """A row in words."""
    change = row.change
    moved = f"{change + 0.0:+.3g}" if isfinite(change) else "-"
    limit = "-" if row.limit is None else f"{row.limit:.3g}"
    name = f"{row.name} [{row.unit}]" if row.at is None else f"{row.name}({row.at:g} s) [{row.unit}]"
    told = "told" if row.limit is None else "ok" if row.passed else "DRIFT"
    return Line((row.case, name, number(row.approved), number(row.now), moved, limit, told), row)


def lines(comparison: Comparison, everything: bool = False) -> Iterator[Line]:
    """What drifted, and of a case without drift what comes nearest to its limit; or everything."""
    for case in dict.fromkeys(row.case for row in comparison.rows):
        rows = [row for row in comparison.rows if row.case == case]
        drifted = [row for row in rows if not row.passed]
        judged = [row for row in rows if row.limit is not None]
        nearest = [max(judged, key=lambda row: row.share)] if judged else []
        yield from map(line, rows if everything else drifted or nearest)


def verdict(comparison: Comparison) -> str:
    """The result in a sentence."""
    if not comparison.judged and not comparison.stopped:
        return "nothing was judged: the baseline has no limits"
    if comparison.passed:
        return f"no drift: {comparison.judged} comparisons are within their limits"
    parts = [f"{len(comparison.drifted)} of {comparison.judged} comparisons drifted"] if comparison.drifted else []
    if comparison.stopped:
        parts.append(f"{len(comparison.stopped)} of {len(comparison.baseline.cases)} cases did not run to the end")
    return " and ".join(parts)


def remedy(comparison: Comparison, file: str, folder: str) -> str:
    """What to do about a drift of the article in `file` from the baseline in `folder`."""
    which = f" --fin {comparison.fin}" if (comparison.fin or 1) > 1 else ""
    was, now = comparison.baseline.recorded.get("file", ""), comparison.identification.file
    before = "" if was in ("", now) else f" (or of {was}, which the baseline was recorded of)"
    return (f"If this is intended: emcas baseline record {file} --output {folder}{which}{before}, and commit {folder}. "
            "If not, undo the change.")
