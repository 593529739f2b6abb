"""A validation on the terminal, as JSON, JUnit XML and a page.

Angles are in deg, rates in deg/s, times in s, frequencies in Hz.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import asdict
from math import isfinite, isnan, nan
from pathlib import Path
from typing import Any

import fmpy
from rich.box import SIMPLE_HEAD
from rich.console import RenderableType
from rich.markup import escape
from rich.table import Table

from ...bench import writers
from ...bench.verdict import summary_table
from ...plots import pictures
from .pictures import drawings
from .study import TRAJECTORY_LIMIT, Result

SCHEMA = "emcas-validation/1"
"""Name and version of the JSON layout; the number changes when a field changes its meaning or goes."""


def _cases(result: Result) -> Table:
    """Return errors and performance figures of the cases as a table."""
    units = {"max": "mdeg", "rms": "mdeg", "rise": "ms", "settle": "ms", "over": "%", "end": "deg", "rate": "deg/s",
             "-3dB": "Hz", "-90°": "Hz"}
    table = Table("case", *units, box=SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False, title_justify="left",
                  title=f"error to {result.compared_with}; rise, settling, overshoot, error at the end, peak rate; "
                        "bandwidth. > not settled, or not down, by then; – not reached")
    table.add_row("", *units.values(), style="dim")
    for column in table.columns:
        column.no_wrap = True
        column.justify = "left" if column is table.columns[0] else "right"
    keys = (("rise_time_s", 1e3), ("settling_time_s", 1e3), ("overshoot_percent", 1.0), ("end_error_deg", 1.0),
            ("peak_rate_deg_per_s", 1.0), ("bandwidth_hz", 1.0), ("phase_bandwidth_hz", 1.0))
    for case in result.cases:
        error = case.errors.get("fin_angle")
        errors = [f"{1e3 * value:.3f}" for value in (error.maximum, error.rms)] if error else ["", ""]
        figures = [_figure(case.figures, key, scale) if key in case.figures else "" for key, scale in keys]
        table.add_row(case.name, *errors, *figures)
    return table


def _figure(figures: Mapping[str, float], key: str, scale: float) -> str:
    """Return a figure with three digits, a dash for none.

    Of a bandwidth beyond the sweep it is the sweep's end, of a settling time the time it was waited for, behind a >.
    """
    value, ends = figures[key], {"bandwidth_hz": "swept_to_hz", "settling_time_s": "judged_for_s"}
    if not isfinite(value):
        end = next((figures[end] for ending, end in ends.items() if key.endswith(ending)), nan)
        return "–" if isnan(end) else f">{end * scale:.3g}"
    return writers.rounded(value * scale, "#.3g").rstrip(".")


def summary(result: Result) -> Iterator[RenderableType]:
    """Give the criteria as a table, then findings, notes and the verdict."""
    about = result.about
    yield escape(f"{about.name}  {'GUID ' + about.guid if about.guid else about.file}  {about.model}")
    yield summary_table("criterion", result.criteria)
    yield _cases(result)
    for finding in result.findings:
        held = {True: " Confirmed.", False: " Not confirmed.", None: ""}[finding.holds]
        yield escape(f"{finding.text}.{held}")
    unmeasured = [f"{j.name}: {j.note}" for j in result.criteria if j.measured is None and not j.skipped]
    for note in (*unmeasured, *result.notes):
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
    criteria = [{"group": group, **j.as_dict()}
                for group, judged in (("trajectory", result.trajectory), ("table2", result.table2)) for j in judged]
    return {"schema": SCHEMA, "passed": None if result.unjudged else result.passed, "fmu": subject,
            "reference": result.reference, "reference_inside": result.inside,
            "reference_independent": result.independent if result.reference else None, "notes": result.notes,
            **{key: [asdict(item) for item in getattr(result, key)] for key in ("cases", "comparisons", "findings")},
            "criteria": criteria}


def write_json(result: Result, path: Path) -> None:
    """Write everything but the time series."""
    writers.write_json(as_dict(result), path)


def write_junit(result: Result, path: Path) -> None:
    """Write one test case a criterion."""
    wall = {case.name: case.wall_time for case in result.cases}
    writers.write_junit("emcas validate", {
        title: [j.junit_case(f"emcas.{group}", wall.get(j.name, 0.0)) for j in judged]
        for group, title, judged in (("trajectory", f"trajectory against {result.compared_with}", result.trajectory),
                                     ("table2", "requirements of Table 2", result.table2))}, path)


def write_report(result: Result, path: Path) -> None:
    """Write the page; the same result gives the same bytes."""
    writers.write_page(path, "studies/validate/page.html.j2", [result.about], result=result, about=result.about,
                       trajectory={j.name: j for j in result.trajectory}, trajectory_limit=TRAJECTORY_LIMIT,
                       pictures=pictures(drawings(result)), figure=_figure)
