"""An acceptance test on the terminal, as JSON, as JUnit XML and as the page to sign."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any

from rich.console import RenderableType

from ... import __version__
from ...bench import verdict, writers
from ...pages.page import stated, write_page
from ...pages.terminal import table
from .acceptance import Result
from .outcome import Outcome
from .pictures import pictures

SCHEMA = "emcas-acceptance/2"
"""Name and version of the JSON layout; the number changes when a field changes its meaning or goes."""


def _headlines(result: Result) -> Iterator[tuple[Outcome, bool, str, str, str]]:
    """Yield test, whether it is the first row of the test, figure, value and a note."""
    for outcome in result.outcomes.values():
        rows = [("not finished", "")] if outcome.stopped else outcome.headlines()
        for k, (label, value) in enumerate(rows):
            yield outcome, not k, label, value, "estimate" * bool(outcome.estimate)


def summary(result: Result) -> Iterator[RenderableType]:
    """Yield the requirements as a table, then the most important figures, notes and the verdict."""
    notes = [result.load_note] if result.load_note else []
    notes += [f"{outcome.title}: {note}" for outcome in result.outcomes.values()
             for note in ([f"not finished: {outcome.stopped}"] if outcome.stopped else outcome.remarks)]
    figures = table(["test", "figure", ">measured", "note"], (
        [outcome.title * first, *texts] for outcome, first, *texts in _headlines(result)), plain=True)
    return verdict.summary(result.about, "requirement", result.judged, [figures], notes, result.passed,
                           "; ".join(result.verdict))


def as_dict(result: Result, date: str = "") -> dict[str, Any]:
    """Return figures, curves, methods and requirements; not the time series."""
    outcomes = result.outcomes
    return {
        "schema": SCHEMA, "passed": result.passed, "tool": f"emcas {__version__}", "date": date or None,
        "identification": asdict(result.about), "rated_load_n_m": result.load,
        "credibility": result.card.as_dict(),
        "requirements": [j.as_dict() for j in result.judged],
        "figures": {name: o.figures for name, o in outcomes.items()},
        "curves": {name: o.curves for name, o in outcomes.items() if o.curves},
        "methods": {name: {"method": o.method, "estimate": o.estimate or None, "stopped": o.stopped or None,
                           "notes": o.notes, "not_applicable": o.not_applicable,
                           "figures": {q.key: q.how for rows, _ in o.tables() for q in rows}}
                    for name, o in outcomes.items()},
    }


def write_junit(result: Result, path: Path) -> None:
    """Write a test case for each requirement and each test."""
    writers.write_junit("emcas report", {
        "requirements": [j.junit_case("emcas.requirement") for j in result.judged],
        "tests finished": [writers.junit_case(name, "emcas.test", outcome.stopped, kind="not finished")
                           for name, outcome in result.outcomes.items()]}, path)


def write_report(result: Result, path: Path, date: str = "", document: str = "", revision: str = "") -> None:
    """Write the page, with number and revision of the document; the same result and date give the same bytes."""
    write_page(path, "studies/report/page.html.j2", [result.about.source], date, r=result, about=result.about,
               document=document, revision=revision, pictures=pictures(result), headlines=list(_headlines(result)),
               conditions=[(label, stated(value, unit, name)) for label, name, value, unit in result.conditions])
