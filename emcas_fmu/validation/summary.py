"""A result on the terminal."""

from __future__ import annotations

from collections.abc import Iterator
from math import isfinite

from rich.console import RenderableType
from rich.markup import escape
from rich.table import Table

from .results import Criterion, Result


def _number(value: float | None) -> str:
    return "-" if value is None or not isfinite(value) else f"{value:.4g}"


def _verdict(criterion: Criterion) -> str:
    if criterion.skipped:
        return "[dim]not run[/]"
    return "[green]ok[/]" if criterion.passed else "[bold red]FAIL[/]"


def summary(result: Result) -> Iterator[RenderableType]:
    """Criteria as a table, then findings, notes and the verdict."""
    yield escape(f"{result.fmu.name} {result.fmu.version}  GUID {result.fmu.guid}")
    table = Table("criterion", "measured", "required", "margin", "unit", "")
    table.columns[0].no_wrap = True
    for column in table.columns[1:4]:
        column.justify = "right"
    for c in result.criteria:
        table.add_row(c.name, _number(c.measured), f"{c.sense} {c.limit:g}", _number(c.margin), c.unit, _verdict(c),
                      end_section=c is result.criteria[len(result.cases) - 1])
    yield table
    for finding in result.findings:
        held = {True: " So it is.", False: " It is not so.", None: ""}[finding.holds]
        yield escape(f"{finding.text}.{held}")
    unmeasured = [f"{c.name}: {c.note}" for c in result.criteria if c.measured is None and not c.skipped]
    for note in (*unmeasured, *result.notes):
        yield f"[yellow]note:[/] {escape(note)}"
    judged = [c for c in result.criteria if not c.skipped]
    failed = sum(not c.passed for c in judged)
    yield (f"[green]all {len(judged)} criteria are met[/]" if result.passed
           else f"[bold red]{failed} of {len(judged)} criteria are not met[/]")
