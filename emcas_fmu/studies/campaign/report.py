"""The summary page of a campaign: one HTML file with nothing outside it."""

from __future__ import annotations

from math import isfinite
from pathlib import Path

from ...bench.metrics import shown
from ...bench.writers import write_page
from ...plots import style, svg
from .distributions import Distribution
from .figures import all_figures
from .measure import left_out
from .plan import Factor
from .summary import PERCENTILES, Summary, angles, text

_MOST_LEVELS = 8


def described(factor: Factor) -> tuple[str, str]:
    """A factor's distribution in a line, and the unit of its numbers."""
    unit, scale = angles(factor.unit)
    return _line(factor.distribution, scale), unit


def _line(found: Distribution, scale: float) -> str:
    if found.kind == "choice":
        levels = [f"{level * scale:g}" for level in found.levels]
        few = len(levels) <= _MOST_LEVELS
        return f"one of {', '.join(levels)}" if few else f"{len(levels)} levels, {levels[0]} .. {levels[-1]}"
    return f"{found.kind}, {', '.join(f'{name} {value * scale:.4g}' for name, value in found.numbers.items())}"


def seconds(value: float) -> str:
    """A time [s] for people."""
    return f"{value:.2f} s" if isfinite(value) else "–"


def write_report(summary: Summary, path: Path, command: str) -> None:
    """Write the page; the same rows give the same bytes. `command` runs the campaign."""
    with style():
        pictures = [(svg(drawn, title), title, caption) for drawn, title, caption in all_figures(summary)]
    plan = summary.study.plan
    write_page(path, "studies/campaign/page.html.j2", s=summary, study=summary.study, plan=plan, command=command,
               pictures=pictures, percentiles=PERCENTILES, text=text, described=described, seconds=seconds,
               unit=lambda figure: shown(figure.unit)[0], left_out=left_out(plan.model))
