"""The summary page of a campaign, one self-contained HTML file."""

from __future__ import annotations

from math import isfinite
from pathlib import Path

from ...bench.measure import BANDWIDTHS
from ...bench.metrics import shown
from ...figures.plots import pictures
from ...pages.page import write_page
from ...pages.provenance import Source
from ...reference.files import parameters_hash
from .figures import drawings
from .measure import lacking
from .plan import Factor
from .summary import PERCENTILES, Summary, text

_MOST_LEVELS = 8


def described(factor: Factor) -> tuple[str, str]:
    """Return a factor's distribution in one line, and the unit of its numbers; angles are in degrees."""
    unit, scale = shown(factor.unit) if factor.unit.startswith("rad") else (factor.unit, 1.0)
    kind, numbers, levels = factor.distribution.kind, factor.distribution.numbers, factor.distribution.levels
    if kind != "choice":
        return f"{kind}, {', '.join(f'{name} {value * scale:.4g}' for name, value in numbers.items())}", unit
    if len(levels) > _MOST_LEVELS:
        return f"{len(levels)} levels, {levels[0] * scale:g} .. {levels[-1] * scale:g}", unit
    return f"one of {', '.join(f'{level * scale:g}' for level in levels)}", unit


def seconds(value: float) -> str:
    """Return a time [s] as text."""
    return f"{value:.2f} s" if isfinite(value) else "–"


def _source(summary: Summary) -> Source:
    study, plan = summary.study, summary.study.plan
    what = f"FMU with SHA-256 {plan.fmu_sha256}, campaign" if plan.fmu else "campaign"
    return Source(what, study.path.name, "", parameters_hash(plan.base), plan.actuator.name)


def write_report(summary: Summary, path: Path, command: str) -> None:
    """Write the page, which names the `command` that runs the campaign; the same rows give the same bytes."""
    plan = summary.study.plan
    factors = [*((f.name, *described(f)) for f in plan.factors),
               *((name, f"follows {leader}", "") for name, leader in plan.followers.items())]
    write_page(path, "studies/campaign/page.html.j2", [_source(summary)], s=summary, study=summary.study, plan=plan,
               command=command, pictures=pictures(drawings(summary)), shares=[f">{p} %" for p in PERCENTILES],
               factors=factors, text=text, seconds=seconds, unit=lambda figure: shown(figure.unit)[0],
               left_out=lacking(plan.model), bandwidths=BANDWIDTHS)
