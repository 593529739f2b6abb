"""What a tuning run leaves: a parameter file with provenance, JSON, and a table for the terminal."""

from __future__ import annotations

import json
from math import degrees, isfinite
from pathlib import Path
from typing import Any

from rich.table import Table

from .. import __version__
from ..bench.writers import plain
from ..parameters import file_entry, write_parameters
from .evaluate import Evaluation
from .experiments import FIGURES
from .optimise import Result
from .study import Requirement

_SHOWN = {"rad": ("deg", degrees(1.0)), "rad/s": ("deg/s", degrees(1.0)), "s": ("ms", 1e3), "1": ("%", 100.0)}


def shown(requirement: Requirement, value: float) -> tuple[float, str]:
    """A figure in the unit people read it in."""
    unit, factor = _SHOWN.get(requirement.unit, (requirement.unit, 1.0))
    return value * factor, unit


def text(value: float, unit: str = "") -> str:
    """A figure for people."""
    return f"{value:.3g} {unit}".rstrip() if isfinite(value) else "not reached"


def rows(result: Result, evaluation: Evaluation) -> list[dict[str, Any]]:
    """A row for each requirement: its worst case, the figure, the limit and the margin."""
    found = evaluation.by_requirement()
    table = []
    for r in result.study.requirements:
        judged = found[r.name]
        measured, unit = shown(r, judged.measured)
        table.append({"requirement": r.name, "figure": r.figure, "how": FIGURES[r.figure].title, "case": judged.case,
                      "measured": measured, "sense": r.sense, "limit": shown(r, r.limit)[0], "unit": unit,
                      "margin": judged.margin, "met": judged.share <= 1.0, "source": r.source})
    return table


def summary(result: Result) -> Table:
    """The requirements with the tuned gains, worst case each."""
    gains = ", ".join(f"{name} = {value:g}" for name, value in result.best.gains.items())
    table = Table("requirement", "case", "measured", "limit", "margin", "", title=f"Tuned gains: {gains}",
                  title_justify="left")
    for column in table.columns:
        column.no_wrap = True
    for column in table.columns[2:5]:
        column.justify = "right"
    for row in rows(result, result.best):
        table.add_row(row["requirement"], row["case"], text(row["measured"], row["unit"]),
                      f"{'≤' if row['sense'] == 'maximum' else '≥'} {row['limit']:.3g}", f"{row['margin']:.0%}",
                      "ok" if row["met"] else "MISSED")
    return table


def verdict(result: Result) -> str:
    """One line: whether the search was stopped, whether all is met, and what binds."""
    worst = result.best.worst
    binding = f"what binds: {', '.join(result.binding())}"
    so_far = f"stopped by Ctrl-C, the best of {len(result.evaluated)} evaluations: " if result.stopped else ""
    if result.met:
        return f"{so_far}all requirements are met in every case; smallest margin {worst.margin:.1%}; {binding}"
    missed = [row["requirement"] for row in rows(result, result.best) if not row["met"]]
    return (f"{so_far}no gains were found that meet {', '.join(missed)}; the worst, {worst.requirement} in case "
            f"{worst.case}, stands at {worst.share:.0%} of its limit; {binding}")


def write_tuned(result: Result, path: Path, command: str) -> None:
    """Write the set that was tuned with the gains over it, each with the command and the smallest margin."""
    worst = result.best.worst
    note = f"{command}; smallest margin {worst.margin:.1%} ({worst.requirement}, case {worst.case})"
    units = {e.variable.name: e.variable.unit for e in result.study.base.entries}
    gains = {name: file_entry([value], units[name], "tuned", note) for name, value in result.best.gains.items()}
    write_parameters(result.study.base.replace(gains), path,
                     [f"Gains tuned by emcas {__version__}: {command}", verdict(result)])


def write_json(result: Result, path: Path, command: str) -> None:
    """Gains, requirements by worst case, every judgement, what binds."""
    document = {
        "schema": "emcas-tuning/1", "command": command, "study": result.study.digest, "seed": result.seed,
        "met": result.met, "stopped": result.stopped, "evaluations": len(result.evaluated),
        "gains": dict(result.best.gains), "before": dict(result.before.gains), "binding": result.binding(),
        "requirements": rows(result, result.best), "requirements_before": rows(result, result.before),
        "judgements": [{"requirement": j.requirement, "case": j.case, "measured_si": j.measured, "share": j.share}
                       for j in result.best.judgements],
    }
    text = json.dumps(plain(document), indent=1, allow_nan=False)
    path.write_text(text + "\n", encoding="utf-8", newline="\n")
