"""The report that is signed: one HTML page with nothing outside it."""

from __future__ import annotations

from math import isfinite
from pathlib import Path

from jinja2 import Environment, PackageLoader, StrictUndefined, select_autoescape

from .. import __version__
from .campaign import Campaign
from .figures import picture


def number(value: float | bool | None) -> str:
    """A figure for people: four digits, a dash for none, infinity as a word."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if value is None or value != value:
        return "–"
    if not isfinite(value):
        return "not reached" if value > 0.0 else "-∞"
    return f"{value:.0f}" if abs(value) >= 1e4 else f"{value:.4g}"


def with_unit(value: float | None, unit: str) -> str:
    """A figure with its unit, typeset."""
    text, shown = number(value).replace("-", "−"), typeset(unit)
    return text if not shown or text == "–" else f"{text}{shown}" if shown.startswith("°") else f"{text} {shown}"


def typeset(unit: str) -> str:
    """A unit as a page shows it."""
    return {"1": "", "deg": "°", "deg/s": "°/s"}.get(unit, unit.replace("N.m", "N·m"))


def page(campaign: Campaign, date: str = "") -> str:
    """The page; the same campaign and date give the same text."""
    environment = Environment(loader=PackageLoader("emcas_fmu", "acceptance"), undefined=StrictUndefined,
                              trim_blocks=True, lstrip_blocks=True, autoescape=select_autoescape(["html.j2"]))
    environment.filters.update(number=lambda value: number(value).replace("-", "−"), quantity=with_unit, unit=typeset)
    return environment.get_template("report.html.j2").render(
        c=campaign, about=campaign.identification, date=date, version=__version__,
        failed=[j.name for j in campaign.judged if not j.passed],
        sources=list(dict.fromkeys(j.source for j in campaign.judged)),
        pictures={name: picture(outcome) for name, outcome in campaign.outcomes.items()})


def write_report(campaign: Campaign, path: Path, date: str = "") -> None:
    """Write the page."""
    path.write_text(page(campaign, date), encoding="utf-8", newline="\n")
