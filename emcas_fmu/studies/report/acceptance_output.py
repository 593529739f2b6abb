"""An acceptance test on the terminal, as JSON, as JUnit XML and as the page to sign."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any

from rich.console import RenderableType
from rich.markup import escape
from rich.table import Column

from ... import __version__
from ...bench import writers
from ...bench.verdict import in_words, remarks, summary_table
from ...pages import numbers
from ...pages.page import stated, write_page
from .acceptance import Result
from .outcome import Outcome
from .pictures import pictures

SCHEMA = "emcas-acceptance/2"
"""Name and version of the JSON layout; the number changes when a field changes its meaning or goes."""


def summary(result: Result) -> Iterator[RenderableType]:
    """Yield the requirements as a table, then the most important figures, notes and the verdict."""
    about = result.about
    yield escape(f"{about.kind} {about.name}  {about.file}  {about.guid}".rstrip())
    yield summary_table("requirement", result.judged)
    figures = writers.terminal_table("test", "figure", Column("measured", justify="right"), "unit")
    for outcome in result.outcomes.values():
        first = outcome.title
        for label, q, sign, value in outcome.headlines():
            label += " (estimate)" * bool(outcome.estimate)
            figures.add_row(first, escape(label), sign + numbers.number(value), "" if q.unit == "1" else q.unit)
            first = ""
    yield figures
    for remark in remarks(result.judged):
        yield f"[yellow]note:[/] {escape(remark)}"
    for outcome in result.outcomes.values():
        for note in outcome.notes:
            yield f"[yellow]note:[/] {escape(note)}"
        for why, labels in outcome.left_out():
            yield f"[yellow]note:[/] {outcome.title}: {', '.join(labels)} not applicable: {why}"
        if outcome.stopped:
            yield f"[bold red]{outcome.title} was not finished:[/] {escape(outcome.stopped)}"
    yield f"[{'green' if result.passed else 'bold red'}]{in_words(result.judged)}[/]"


def as_dict(result: Result, date: str = "") -> dict[str, Any]:
    """Return figures, curves, methods and requirements; not the time series."""
    outcomes = result.outcomes
    return {
        "schema": SCHEMA, "passed": result.passed, "tool": f"emcas {__version__}", "date": date or None,
        "identification": asdict(result.about), "rated_load_n_m": result.load,
        "requirements": [j.as_dict() for j in result.judged],
        "figures": {name: o.figures for name, o in outcomes.items()},
        "curves": {name: o.curves for name, o in outcomes.items() if o.curves},
        "methods": {name: {"method": o.method, "estimate": o.estimate or None, "stopped": o.stopped or None,
                           "notes": o.notes, "not_applicable": o.not_applicable,
                           "figures": {q.key: q.how for q in o.columns(o.figures)}} for name, o in outcomes.items()},
    }


def write_junit(result: Result, path: Path) -> None:
    """Write a test case for each requirement and each test."""
    suites = {"requirements": [j.junit_case("emcas.requirement") for j in result.judged]}
    suites["tests finished"] = [writers.junit_case(name, "emcas.test", outcome.stopped, kind="not finished")
                                for name, outcome in result.outcomes.items()]
    writers.write_junit("emcas report", suites, path)


def write_report(result: Result, path: Path, date: str = "", document: str = "", revision: str = "") -> None:
    """Write the page, with number and revision of the document; the same result and date give the same bytes."""
    headlines: list[tuple[Outcome, bool, str, str, str]] = []
    for each in result.outcomes.values():
        headlines += [(each, True, "not finished", "", "")] if each.stopped else []
        headlines += [(each, not k, label, sign + numbers.with_unit(value, q.unit), "estimate" * bool(each.estimate))
                      for k, (label, q, sign, value) in enumerate(each.headlines())]
    write_page(path, "studies/report/page.html.j2", [result.about.source], date, r=result, about=result.about,
                       document=document, revision=revision, pictures=pictures(result), headlines=headlines,
                       conditions=[(label, stated(value, unit, name))
                                   for label, name, value, unit in result.conditions])
