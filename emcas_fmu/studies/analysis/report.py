"""The analysis as one HTML page with nothing outside it."""

from __future__ import annotations

from pathlib import Path

from jinja2 import Environment, PackageLoader, StrictUndefined, select_autoescape

from ... import __version__
from .analyse import Analysis, figures
from .figures import all_figures


def _number(value: float | None) -> str:
    if value is None:
        return "–"
    return f"{value:.0f}" if abs(value) >= 1000 else f"{value:.3g}" if abs(value) >= 1e-9 else "0"


def write_report(found: Analysis, path: Path) -> None:
    """Write the page; the same analysis gives the same bytes."""
    environment = Environment(loader=PackageLoader("emcas_fmu", "studies/analysis"), undefined=StrictUndefined,
                              trim_blocks=True, lstrip_blocks=True, autoescape=select_autoescape(["html.j2"]))
    environment.filters["number"] = _number
    page = environment.get_template("report.html.j2").render(f=figures(found), version=__version__,
                                                             figures=list(all_figures(found)))
    path.write_text(page, encoding="utf-8", newline="\n")
