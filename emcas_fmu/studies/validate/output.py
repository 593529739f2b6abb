"""A validation as JSON, JUnit XML and a page. Angles are in deg, rates in deg/s, times in s, frequencies in Hz."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

import fmpy

from ...bench import writers
from ...plots import pictures
from .pictures import drawings
from .study import TRAJECTORY_LIMIT, Result

SCHEMA = "emcas-validation/1"
"""Name and version of the JSON layout; the number changes when a field changes its meaning or goes."""


def as_dict(result: Result) -> dict[str, Any]:
    """Return everything but the time series."""
    about = result.about
    name, _, version = about.name.partition(" ")
    subject = {"path": about.file, "name": name, "guid": about.guid, "version": version,
               "generation_tool": about.generation_tool, "sha256": about.sha256, "platform": fmpy.platform,
               "fmpy": fmpy.__version__, "parameters": result.parameters,
               "differences": result.differences, "estimates": about.estimates,
               "kind": about.kind, "model": about.model, "fin": about.fin}
    criteria = [{"group": group, **asdict(j), "margin": j.margin, "passed": j.passed}
                for group, judged in (("trajectory", result.trajectory), ("table2", result.table2)) for j in judged]
    return {"schema": SCHEMA, "passed": result.passed, "fmu": subject, "reference": result.reference,
            "notes": result.notes, **{key: [asdict(item) for item in getattr(result, key)]
                                      for key in ("cases", "comparisons", "findings")}, "criteria": criteria}


def write_json(result: Result, path: Path) -> None:
    """Write everything but the time series."""
    writers.write_json(as_dict(result), path)


def write_junit(result: Result, path: Path) -> None:
    """Write one test case a criterion."""
    wall = {case.name: case.wall_time for case in result.cases}
    writers.write_junit("emcas validate", {
        title: [j.junit_case(f"emcas.{group}", wall.get(j.name, 0.0)) for j in judged]
        for group, title, judged in (("trajectory", "trajectory against the reference", result.trajectory),
                                     ("table2", "requirements of Table 2", result.table2))}, path)


def write_report(result: Result, path: Path) -> None:
    """Write the page; the same result gives the same bytes."""
    writers.write_page(path, "studies/validate/page.html.j2", result=result, about=result.about,
                       trajectory={j.name: j for j in result.trajectory}, trajectory_limit=TRAJECTORY_LIMIT,
                       pictures=pictures(drawings(result)))
