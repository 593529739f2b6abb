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
from rich.table import Table

from ...bench import verdict, writers
from ...pages.page import write_page
from ...pages.terminal import table
from .validation import TRAJECTORY_LIMIT, Validation

SCHEMA = "emcas-validation/2"
"""Name and version of the JSON layout; the number changes when a field is removed or changes its meaning."""


def _cases(result: Validation) -> Table:
    """Return a table of the largest errors in the compared cases."""
    units = {"fin_angle": "angle [deg]", "fin_rate": "rate [deg/s]", "motor_current": "current [A]",
             "motor_voltage": "voltage [V]"}
    compared = {name: case for name, case in result.cases.items() if case.errors}
    shown = {name: title for name, title in units.items() if any(name in case.errors for case in compared.values())}
    rows = ([key, *(case.errors[name].maximum if name in case.errors else None for name in shown)]
            for key, case in compared.items())
    return table(["case", *(f">{each}" for each in shown.values())], rows,
                 f"largest error against {result.compared_with}", range(1 + len(shown)), plain=True)


def summary(result: Validation) -> Iterator[RenderableType]:
    """Yield the subject, the criteria and errors as tables, then findings, notes and the verdict."""
    findings = [escape(f"{f['text']}. {'Confirmed' if f['holds'] else 'Not confirmed'}.") for f in result.findings]
    return verdict.summary(result.about, "criterion", result.criteria,
                           [*([_cases(result)] if result.trajectory else ()), *findings], result.notes, result.outcome,
                           result.verdict)


def as_dict(result: Validation) -> dict[str, Any]:
    """Return the result for JSON, without time series."""
    about, compared = result.about, bool(result.trajectory)
    name, _, version = about.name.partition(" ")
    fields = ("guid", "generation_tool", "sha256", "estimates", "kind", "model", "fin")
    return {
        "schema": SCHEMA, "passed": result.outcome,
        "fmu": {"path": about.file, "name": name, "version": version, "platform": fmpy.platform,
                "fmpy": fmpy.__version__, "parameters": result.parameters, "differences": result.differences,
                **{field: getattr(about, field) for field in fields}},
        "reference": result.folder if compared else "", "reference_inside": result.inside,
        "reference_independent": result.independent if compared else None, "notes": result.notes,
        "cases": [{"name": key, "title": each.case.title, "kind": each.case.kind,
                   "stop_time": each.case.stop_time, "stopped": each.judged.stopped,
                   "wall_time": each.judged.wall_time, "messages": each.judged.messages,
                   "errors": {name: asdict(errors) for name, errors in each.errors.items()}}
                  for key, each in result.cases.items()],
        "comparisons": result.comparisons, "findings": result.findings,
        "criteria": [{"group": group, **j.as_dict()} for group in ("trajectory", "requirements")
                     for j in getattr(result, group)]}


def write_junit(result: Validation, path: Path) -> None:
    """Write a test case for each criterion."""
    wall = {name: case.judged.wall_time for name, case in result.cases.items()}
    writers.write_junit("emcas validate", {
        f"trajectory against {result.compared_with}": [
            j.junit_case("emcas.trajectory", wall[j.name]) for j in result.trajectory],
        "requirements": [j.junit_case("emcas.requirements") for j in result.requirements]}, path)


def write_report(result: Validation, path: Path) -> None:
    """Write the page; the same result, command and date give the same bytes."""
    from ...plotting.plots import pictures  # imports Matplotlib, which takes a third of a command's start
    from .pictures import drawings

    write_page(path, "studies/validate/page.html.j2", [result.about.source], result=result, about=result.about,
               trajectory_limit=TRAJECTORY_LIMIT, pictures=pictures(drawings(result)))
