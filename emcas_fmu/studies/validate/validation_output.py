"""A validation on the terminal, as JSON, as JUnit XML and as a page.

Angles are in deg, rates in deg/s, times in s, frequencies in Hz.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any

import fmpy
from rich.console import RenderableType
from rich.markup import escape
from rich.table import Column, Table

from ...bench import writers
from ...bench.verdict import remarks, summary_table
from ...figures.plots import pictures
from ...pages import numbers
from ...pages.page import write_page
from .pictures import drawings
from .validation import TRAJECTORY_LIMIT, CaseResult, Result

SCHEMA = "emcas-validation/2"
"""Name and version of the JSON layout; the number changes when a field changes its meaning or goes."""


def _cases(result: Result) -> Table:
    """Return the largest errors of the cases as a table."""
    shown = {"fin_angle": "angle [deg]", "fin_rate": "rate [deg/s]", "motor_current": "current [A]",
             "motor_voltage": "voltage [V]"}
    table = writers.terminal_table(
        Column("case", no_wrap=True), *(Column(escape(each), justify="right", no_wrap=True) for each in shown.values()),
        title=f"largest error to {result.compared_with}")
    for case in result.cases:
        errors = [case.errors.get(name) for name in shown]
        table.add_row(case.name, *(numbers.number(error.maximum) if error else "–" for error in errors))
    return table


def summary(result: Result) -> Iterator[RenderableType]:
    """Yield the criteria as a table, then findings, notes and the verdict."""
    about = result.about
    yield escape(f"{about.name}  {'GUID ' + about.guid if about.guid else about.file}  {about.model}")
    yield summary_table("criterion", result.criteria)
    if any(case.errors for case in result.cases):
        yield _cases(result)
    for finding in result.findings:
        held = {True: " Confirmed.", False: " Not confirmed.", None: ""}[finding.holds]
        yield escape(f"{finding.text}.{held}")
    for note in (*remarks(result.criteria), *result.notes):
        yield f"[yellow]note:[/] {escape(note)}"
    color = "green" if result.passed else "yellow" if result.unjudged else "bold red"
    yield f"[{color}]{escape(result.verdict)}[/]"


def as_dict(result: Result) -> dict[str, Any]:
    """Return everything but the time series."""
    about = result.about
    name, _, version = about.name.partition(" ")
    subject = {"path": about.file, "name": name, "guid": about.guid, "version": version,
               "generation_tool": about.generation_tool, "sha256": about.sha256, "platform": fmpy.platform,
               "fmpy": fmpy.__version__, "parameters": result.parameters,
               "differences": result.differences, "estimates": about.estimates,
               "kind": about.kind, "model": about.model, "fin": about.fin}
    criteria = [{"group": group, **j.as_dict()} for group in ("trajectory", "requirements")
                for j in getattr(result, group)]
    return {"schema": SCHEMA, "passed": None if result.unjudged else result.passed, "fmu": subject,
            "reference": result.reference, "reference_inside": result.inside,
            "reference_independent": result.independent if result.reference else None, "notes": result.notes,
            "cases": [_case(case) for case in result.cases],
            **{key: [asdict(item) for item in getattr(result, key)] for key in ("comparisons", "findings")},
            "criteria": criteria}


def _case(result: CaseResult) -> dict[str, Any]:
    case, run = result.case, result.judged
    return {"name": case.name, "title": case.title, "kind": case.kind, "stop_time": case.stop_time,
            "stopped": run.stopped, "wall_time": run.wall_time, "messages": run.messages,
            "errors": {name: asdict(errors) for name, errors in result.errors.items()}}


def write_junit(result: Result, path: Path) -> None:
    """Write one test case per criterion."""
    wall = {case.name: case.judged.wall_time for case in result.cases}
    writers.write_junit("emcas validate", {
        title: [j.junit_case(f"emcas.{group}", wall.get(j.name, 0.0)) for j in judged]
        for group, title, judged in (("trajectory", f"trajectory against {result.compared_with}", result.trajectory),
                                     ("requirements", "requirements", result.requirements))}, path)


def write_report(result: Result, path: Path) -> None:
    """Write the page; the same result gives the same bytes."""
    write_page(path, "studies/validate/page.html.j2", [result.about.source], result=result, about=result.about,
                       trajectory={j.name: j for j in result.trajectory}, trajectory_limit=TRAJECTORY_LIMIT,
                       pictures=pictures(drawings(result)))
