"""A comparison as JSON, JUnit XML and Markdown."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any

import junitparser

from .. import __version__
from ..bench.writers import plain
from .compare import Changed, Comparison
from .model import SCHEMA as BASELINE
from .table import HEADER, NUMERIC, line, lines, verdict

SCHEMA = "emcas-baseline-check/1"
"""Name and version of the JSON layout; the number changes when a field changes its meaning or goes."""


def as_dict(comparison: Comparison) -> dict[str, Any]:
    """For JSON: figures that are never reached, and infinite shares, become None."""
    rows = [{**asdict(row), "change": row.change, "share_of_limit": row.share, "passed": row.passed}
            for row in comparison.rows]
    document = {"schema": SCHEMA, "baseline_schema": BASELINE, "tool": f"emcas {__version__}",
                "passed": comparison.passed, "article": asdict(comparison.identification), "fin": comparison.fin,
                "recorded": dict(comparison.baseline.recorded), "comparisons": rows, "stopped": comparison.stopped,
                "changed_parameters": [asdict(c) for c in comparison.parameters],
                "changed_marks": [asdict(c) for c in comparison.marks], "notes": comparison.notes}
    found: dict[str, Any] = plain(document)
    return found


def write_json(comparison: Comparison, path: Path) -> None:
    """Write everything but the trajectories."""
    path.write_text(json.dumps(as_dict(comparison), indent=1, allow_nan=False) + "\n", encoding="utf-8", newline="\n")


def write_junit(comparison: Comparison, path: Path) -> None:
    """Write a test case for each comparison with a limit, a suite for each case."""
    suites = junitparser.JUnitXml("emcas baseline check")
    for approved in comparison.baseline.cases:
        case = approved.case
        suite = junitparser.TestSuite(case.title)
        if case.name in comparison.stopped:
            test = junitparser.TestCase("run", f"emcas.baseline.{case.name}", 0.0)
            test.result = [junitparser.Failure(comparison.stopped[case.name], "not finished")]
            suite.add_testcase(test)
        for row in (row for row in comparison.rows if row.case == case.name and row.limit is not None):
            name = row.name if row.at is None else f"{row.name}_trajectory"
            test = junitparser.TestCase(name, f"emcas.baseline.{case.name}", 0.0)
            if not row.passed:
                cells = dict(zip(HEADER, line(row).cells, strict=True))
                test.result = [junitparser.Failure(", ".join(f"{key} {cells[key]}" for key in HEADER[1:-1]), "drift")]
            suite.add_testcase(test)
        suites.add_testsuite(suite)
    suites.update_statistics()  # type: ignore[no-untyped-call]
    suites.write(str(path), pretty=True)


def append_markdown(comparison: Comparison, remedy: str, path: Path, everything: bool = False) -> None:
    """Append a section; to a file, as the summary of a job is one that several steps write to."""
    with path.open("a", encoding="utf-8", newline="\n") as file:
        file.write("\n".join(_markdown(comparison, remedy, everything)) + "\n\n")


def _markdown(comparison: Comparison, remedy: str, everything: bool) -> Iterator[str]:
    about = comparison.identification
    yield f"### {'✅' if comparison.passed else '❌'} {_cell(about.file)}: {verdict(comparison)}\n"
    yield from _table(HEADER, [x.cells if x.row.passed else (*x.cells[:-1], f"**{x.cells[-1]}**")
                               for x in lines(comparison, everything)], NUMERIC)
    for case, why in comparison.stopped.items():
        yield f"**{case}** {_cell(why)}\n"
    if comparison.parameters:
        yield "Parameters that are not those approved:\n"
        yield from _changes(comparison.parameters)
    if not comparison.passed:
        yield f"{_cell(remedy)}\n"
    yield from (f"Note: {_cell(note)}\n" for note in comparison.notes)


def _changes(changes: tuple[Changed, ...]) -> Iterator[str]:
    yield from _table(("parameter", "approved", "now"), [(c.name, c.approved, c.now) for c in changes], range(1, 3))


def _table(header: tuple[str, ...], rows: list[tuple[str, ...]], numeric: range) -> Iterator[str]:
    yield f"| {' | '.join(header)} |"
    yield f"|{'|'.join('---:' if k in numeric else '---' for k in range(len(header)))}|"
    yield from (f"| {' | '.join(map(_cell, row))} |" for row in rows)
    yield ""


def _cell(text: str) -> str:
    return " ".join(text.replace("|", "\\|").replace("<", "&lt;").split())
