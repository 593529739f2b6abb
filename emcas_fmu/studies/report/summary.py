"""An acceptance test on the terminal."""

from __future__ import annotations

from collections.abc import Iterator

from rich.box import SIMPLE_HEAD
from rich.console import RenderableType
from rich.markup import escape
from rich.table import Table

from ...bench.verdict import summary_table
from ...bench.writers import number
from .study import Result


def summary(result: Result) -> Iterator[RenderableType]:
    """Give the requirements as a table, then the most important figures, notes and the verdict."""
    about = result.about
    yield escape(f"{about.kind} {about.name}  {about.file}  {about.guid}".rstrip())
    yield summary_table("requirement", result.judged)
    figures = Table("test", "figure", "measured", "unit", box=SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False)
    figures.columns[2].justify = "right"
    for outcome in result.outcomes.values():
        first = outcome.title
        for group, q, value in outcome.headlines():
            label = f"{outcome.label(group)}: {q.label}" + (" (estimate)" if outcome.estimate else "")
            figures.add_row(first, escape(label), number(value), "" if q.unit == "1" else q.unit)
            first = ""
    yield figures
    for outcome in result.outcomes.values():
        for note in outcome.notes:
            yield f"[yellow]note:[/] {escape(note)}"
        for why, labels in outcome.left_out():
            yield f"[yellow]note:[/] {outcome.title}: {', '.join(labels)} not applicable: {why}"
        if outcome.stopped:
            yield f"[bold red]{outcome.title} was not finished:[/] {escape(outcome.stopped)}"
    if result.passed:
        yield f"[green]all {len(result.judged)} requirements are met[/]"
    elif result.failed:
        yield f"[bold red]{len(result.failed)} of {len(result.judged)} requirements are not met[/]"
