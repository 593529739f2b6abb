"""The validation report: one HTML page with nothing outside it."""

from __future__ import annotations

from pathlib import Path

from jinja2 import Environment, PackageLoader, StrictUndefined, select_autoescape

from .. import __version__
from .figures import all_figures
from .requirements import TRAJECTORY_LIMIT
from .results import Result


def _number(value: float | bool | None) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    return "–" if value is None or value != value else f"{value:.3g}" if abs(value) < 1000 else f"{value:.0f}"


def write_report(result: Result, path: Path) -> None:
    """Write the page of a result; the same result gives the same bytes."""
    environment = Environment(loader=PackageLoader("emcas_fmu", "validation"), undefined=StrictUndefined,
                              trim_blocks=True, lstrip_blocks=True, autoescape=select_autoescape(["html.j2"]))
    environment.filters["number"] = _number
    page = environment.get_template("report.html.j2").render(
        result=result, version=__version__, figures=list(all_figures(result)), trajectory_limit=TRAJECTORY_LIMIT,
        judged=[c for c in result.criteria if not c.skipped],
        failed=[c for c in result.criteria if not c.skipped and not c.passed],
        trajectory=[c for c in result.criteria if c.group == "trajectory"],
        table2=[c for c in result.criteria if c.group == "table2"],
        used_estimates=[n for n in result.fmu.estimates if n not in {d.name for d in result.fmu.differences}])
    path.write_text(page, encoding="utf-8", newline="\n")
