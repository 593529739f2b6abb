"""An acceptance test on the terminal."""

from __future__ import annotations

from collections.abc import Iterator

from rich.box import SIMPLE_HEAD
from rich.console import RenderableType
from rich.markup import escape
from rich.table import Table

from .campaign import Campaign
from .report import number


def summary(campaign: Campaign) -> Iterator[RenderableType]:
    """Requirements as a table, then the figures to tell first, notes and the verdict."""
    about = campaign.identification
    yield escape(f"{about.kind} {about.name}  {about.file}  {about.guid}".rstrip())
    table = Table("requirement", "measured", "required", "margin", "unit", "")
    for column in table.columns[1:4]:
        column.justify = "right"
    for j in campaign.judged:
        table.add_row(escape(j.name), number(j.measured), f"{j.sense} {j.limit:g}", number(j.margin), j.unit,
                      "[green]ok[/]" if j.passed else "[bold red]FAIL[/]")
    yield table
    figures = Table("test", "figure", "measured", "unit", box=SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False)
    figures.columns[2].justify = "right"
    for outcome in campaign.outcomes.values():
        first = outcome.title
        for group, q, value in outcome.told_first():
            label = f"{outcome.label(group)}: {q.label}" + (" (estimate)" if outcome.estimate else "")
            figures.add_row(first, escape(label), number(value), "" if q.unit == "1" else q.unit)
            first = ""
    yield figures
    for outcome in campaign.outcomes.values():
        for note in outcome.notes:
            yield f"[yellow]note:[/] {escape(note)}"
        if outcome.stopped:
            yield f"[bold red]{outcome.title} was not finished:[/] {escape(outcome.stopped)}"
    failed = sum(not j.passed for j in campaign.judged)
    if campaign.passed:
        yield f"[green]all {len(campaign.judged)} requirements are met[/]"
    elif failed:
        yield f"[bold red]{failed} of {len(campaign.judged)} requirements are not met[/]"
