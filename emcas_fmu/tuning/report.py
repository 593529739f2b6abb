"""The tuning report: one HTML page with nothing outside it."""

from __future__ import annotations

from pathlib import Path

from jinja2 import Environment, PackageLoader, StrictUndefined, select_autoescape

from .. import __version__
from ..plots import style, svg
from .figures import all_figures
from .optimise import Result
from .output import rows, shown, text, verdict
from .pareto import conflict


def write_report(result: Result, path: Path, command: str, pair: tuple[str, str] | None = None) -> None:
    """Write the page of a result; the same result gives the same bytes."""
    environment = Environment(loader=PackageLoader("emcas_fmu", "tuning"), undefined=StrictUndefined,
                              trim_blocks=True, lstrip_blocks=True, autoescape=select_autoescape(["html.j2"]))
    with style():
        figures = [(svg(drawn, title), title, caption)
                   for drawn, title, caption in all_figures(result, conflict(result.evaluated, pair))]
    by_case = {(j.requirement, j.case): j for j in result.best.judgements}
    page = environment.get_template("report.html.j2").render(
        result=result, version=__version__, command=command, verdict=verdict(result), figures=figures,
        rows=list(zip(rows(result, result.best), rows(result, result.before), strict=True)), by_case=by_case,
        shown=shown, text=text)
    path.write_text(page, encoding="utf-8", newline="\n")
