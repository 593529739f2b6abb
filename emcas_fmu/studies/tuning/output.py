"""Outputs of a search for gains: a parameter file with provenance, JSON, a page, and a table for the terminal."""

from __future__ import annotations

from math import isnan
from pathlib import Path
from typing import Any

from rich.table import Table

from ... import __version__
from ...bench import writers
from ...bench.metrics import FIGURES, shown
from ...pages.numbers import beside, number, with_unit
from ...pages.page import write_page
from ...pages.terminal import table
from ...parameters import file_entry, write_parameters
from .evaluate import HOPELESS, Evaluation, margin_text
from .optimise import Tuning


def rows(result: Tuning, evaluation: Evaluation) -> list[dict[str, Any]]:
    """Return a row for each requirement in its worst case: figure and limit in the unit that is shown, and margin."""
    worst = evaluation.by_requirement()
    judged = [(r, worst[r.name], *shown(r.unit)) for r in result.study.requirements]
    return [{"requirement": r.name, "figure": r.figure, "how": FIGURES[r.figure].title, "case": j.case,
             "measured": j.measured * factor, "sense": r.sense, "limit": r.limit * factor, "unit": unit,
             "margin": j.margin, "met": j.met, "source": r.source} for r, j, unit, factor in judged]


def summary(result: Tuning) -> Table:
    """Return a table of the requirements, each in its worst case with the returned gains."""
    gains = ", ".join(f"{name} = {gain(value)}" for name, value in result.best.gains.items())
    return table(["requirement", "case", ">measured", ">limit", ">margin", ""], (
        [row["requirement"], row["case"], with_unit(row["measured"], row["unit"], row["limit"]),
         f"{'≤' if row['sense'] == 'maximum' else '≥'} {with_unit(row['limit'], row['unit'])}",
         margin_text(row["margin"]), "ok" if row["met"] else "MISSED"] for row in rows(result, result.best)),
        f"{'Initial gains' if result.unimproved else 'Tuned gains'}: {gains}", range(2, 5))


def gain(value: float) -> str:
    """Return a gain [SI] as text with up to twelve digits."""
    return f"{value:.12g}"


def verdict(result: Tuning) -> str:
    """Return a line: how the search ended, whether all requirements are met, and which requirements are binding."""
    worst = result.best.worst
    binding = f"binding: {', '.join(result.binding)}"
    none = "this search found no gains better than the initial ones"  # the journal may have those of another search
    best = none if result.unimproved else f"chosen from {len(result.evaluated)} evaluations"
    ending = (f"stopped by Ctrl-C, {best}: " if result.stopped else
              f"{none}, which are returned: " if result.unimproved else "")
    if result.met:
        return (f"{ending}all requirements are met in every case; smallest margin {margin_text(worst.margin)}; "
                f"{binding}")
    missed = [row["requirement"] for row in rows(result, result.best) if not row["met"]]
    return (f"{ending}the returned gains miss {', '.join(missed)}; the worst, {worst.requirement} in case "
            f"{worst.case}, has a margin of {margin_text(worst.margin)}; {binding}")


def objectives(result: Tuning) -> str:
    """Return a line: the objectives of initial and returned gains, and the largest one near the returned gains.

    An objective with a share that is HOPELESS is only a bound.
    """
    initial, returned = result.before.objective, result.best.objective

    def bound(value: float) -> str:
        return " or more" * (value >= HOPELESS)

    nearby = "" if isnan(result.nearby) else (
        f"; {'' if bound(result.nearby) else 'at most '}{number(result.nearby)}{bound(result.nearby)} if the third "
        "digit of a returned gain changes by one")
    return (f"objective: {beside(initial, returned)}{bound(initial)} initial, {beside(returned, initial)}"
            f"{bound(returned)} returned{nearby}")


def at_bounds(result: Tuning) -> str:
    """Return a line that names the tuned gains near a bound of the search; empty if there are none."""
    gains = ", ".join(f"{name} = {gain(result.best.gains[name])} ({bound})" for name, bound in result.at_bound.items())
    return gains and (f"near a bound of the search (within 1 % of its logarithmic range): {gains}; wider bounds may "
                      "give better gains")


def write_tuned(result: Tuning, path: Path, command: str) -> None:
    """Write a parameter file with the tuned gains; the note of each gain has the command and the smallest margin.

    If the search found no better gains, the file contains the initial gains with their sources and notes.
    """
    worst = result.best.worst
    note = f"{command}; smallest margin {margin_text(worst.margin)} ({worst.requirement}, case {worst.case})"
    units = {e.variable.name: e.variable.unit for e in result.study.base.entries}
    gains = {name: file_entry([value], units[name], "tuned", note)
             for name, value in result.best.gains.items() if not result.unimproved}
    write_parameters(result.study.base.with_values(gains), path,
                     [f"{'Initial gains, returned' if result.unimproved else 'Gains tuned'} by emcas {__version__}: "
                      f"{command}", verdict(result), objectives(result), *filter(None, [at_bounds(result)])])


def write_json(result: Tuning, path: Path, command: str) -> None:
    """Write a JSON file: gains [SI], requirements in their worst cases, all judgements, the binding requirements."""
    writers.write_json({
        "schema": "emcas-tuning/1", "command": command, "model": result.study.base.actuator.name,
        "study": result.study.digest, "seed": result.seed,
        "met": result.met, "stopped": result.stopped, "evaluations": len(result.evaluated),
        "objective": {"before": result.before.objective, "returned": result.best.objective, "nearby": result.nearby},
        "gains": dict(result.best.gains), "before": dict(result.before.gains), "unimproved": result.unimproved,
        "at_bound": result.at_bound, "binding": result.binding,
        "requirements": rows(result, result.best), "requirements_before": rows(result, result.before),
        "judgements": [{"requirement": j.requirement, "case": j.case, "measured_si": j.measured, "share": j.share}
                       for j in result.best.judgements],
    }, path)


def write_report(result: Tuning, path: Path, pair: tuple[str, str] | None = None) -> None:
    """Write the page of a result; `pair` are the requirements of the trade-off (default: the most conflicting)."""
    from ...plotting.plots import pictures  # here: at the top, Matplotlib would take a third of the start of a command
    from .pictures import drawings

    by_case = {(j.requirement, j.case): j for j in result.best.judgements}
    write_page(
        path, "studies/tuning/page.html.j2", [result.study.base], result=result, verdict=verdict(result), shown=shown,
        objectives=objectives(result), gain=gain, margin=margin_text,
        by_case=by_case, rows=list(zip(rows(result, result.best), rows(result, result.before), strict=True)),
        units={e.variable.name: e.variable.unit for e in result.study.base.entries},
        pictures=pictures(drawings(result, pair)))
