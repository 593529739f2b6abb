"""A comparison as one page with pictures: approved and present trajectories, and their difference."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined, select_autoescape

from .. import __version__, plots
from .compare import Comparison
from .model import TRACES
from .table import HEADER, NUMERIC, lines, verdict


def write_report(comparison: Comparison, remedy: str, path: Path) -> None:
    """Write the page; the same comparison gives the same bytes."""
    environment = Environment(loader=PackageLoader("emcas_fmu", "baseline"), undefined=StrictUndefined,
                              trim_blocks=True, lstrip_blocks=True, autoescape=select_autoescape(["html.j2"]))
    page = environment.get_template("report.html.j2").render(
        about=comparison.identification, comparison=comparison, verdict=verdict(comparison), remedy=remedy,
        header=HEADER, numeric=NUMERIC, lines=list(lines(comparison, everything=True)), version=__version__,
        figures=list(_figures(comparison)))
    path.write_text(page, encoding="utf-8", newline="\n")


def _figures(comparison: Comparison) -> Iterator[tuple[str, str]]:
    """Caption and picture of each trajectory."""
    titles = {approved.case.name: approved.case.title for approved in comparison.baseline.cases}
    for case, outputs in comparison.curves.items():
        for name, (time, old, new) in outputs.items():
            unit, limit = TRACES[name][0], comparison.baseline.limits.traces[name]
            with plots.style():
                figure, ((above,), (below,)) = plots.figure(2, height=1.5, sharex=True, height_ratios=(2, 1))
                above.plot(time, old, color=plots.GRAY, linewidth=3.0, label="approved")
                above.plot(time, new, color=plots.BLUE, label="now")
                above.set(ylabel=f"{name} / {unit}")
                above.legend(loc="best")
                below.plot(time, new - old, color=plots.VERMILLION)
                below.axhspan(-limit, limit, color=plots.GREEN, alpha=0.15, linewidth=0.0)
                below.set(ylabel=f"change / {unit}", xlabel="time / s")
                picture = plots.svg(figure, f"{name} of {case}, approved and now")
            largest = float(np.max(np.abs(new - old)))
            yield (f"{case}: {titles[case]}. Largest change of {name} {largest:.3g} {unit}, "
                   f"limit {limit:g} {unit} (shaded)"), picture
