"""The summary of a campaign as a page with pictures, and as tables for the terminal."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np
from rich.table import Table
from rich.text import Text

from ...bench.measure import BANDWIDTHS
from ...bench.metrics import shown
from ...bench.verdict import SENSES
from ...pages.page import write_page
from ...pages.provenance import Source
from ...pages.terminal import table
from ...plotting import plots
from ...plotting.plots import BLUE, COLORS, COMMAND_STYLE, GRAY, INK, VERMILLION, Drawing
from ...reference.files import parameters_hash
from .distributions import Factor
from .experiments import REQUIREMENT, Experiment, lacking
from .quantiles import PERCENTILES
from .sample import history
from .summary import Spread, Summary, measured, text

_SHOWN = 5, 50, 95  # percentiles in the terminal's tables
_COLUMNS = 3  # plots in a row of a picture
_MOST_FACTORS = 12  # most factors in a plot
_MOST_BINS = 40
_MOST_WORST = 6  # most samples in the picture of the worst samples, and most names of figures in a sample's label
_MOST_LEVELS = 8  # most levels of a choice that are listed


def drawings(summary: Summary) -> Iterator[Drawing]:
    """Yield the pictures of each experiment: histograms, rank correlations and worst samples."""
    for experiment in summary.study.experiments:
        if spreads := [s for s in summary.spreads_of(experiment.name) if isfinite(s.mean) and s.varies]:
            yield histograms(experiment.name, spreads)
            if dependent := [s for s in spreads if s.effects]:
                yield dependence(experiment.name, dependent)
            yield worst(summary, experiment, spreads)


def histograms(name: str, spreads: Sequence[Spread]) -> Drawing:
    """Plot histograms of the figures of an experiment."""
    plot, grid = plots.panel_grid(len(spreads), _COLUMNS, width=10.0, height=1.9)
    for axes, s in zip(grid, spreads, strict=True):
        unit, scale = shown(s.figure.unit)
        axes.hist(s.values * scale, bins=min(_MOST_BINS, max(5, int(np.sqrt(len(s.values))))), color=BLUE)
        for p, color in ((50, INK), (95, VERMILLION), (5, VERMILLION)):
            if isfinite(s.percentiles[p]):
                axes.axvline(s.percentiles[p] * scale, color=color, linewidth=1.0, linestyle="-" if p == 50 else "--")
        without = f" ({s.without} without)" if s.without else ""
        axes.set(title=f"{s.name.partition('.')[2]}{without}", xlabel=unit)
        axes.grid(axis="x", visible=False)
    return Drawing(f"Experiment {name}: spread", plot,
                   "Number of samples; the lines are the median and, dashed, the 5 and 95 % percentiles.")


def dependence(name: str, spreads: Sequence[Spread]) -> Drawing:
    """Plot the rank correlations between figures of an experiment and factors as bars with 95 % intervals."""
    strongest: dict[str, float] = {}
    for s in spreads:
        for e in s.effects:
            strongest[e.factor] = max(strongest.get(e.factor, 0.0), abs(e.rank_correlation))
    factors = sorted(strongest, key=lambda f: -strongest[f])[:_MOST_FACTORS]
    height = 0.75 + 0.2 * len(factors)  # of a row, in inches
    plot, grid = plots.panel_grid(len(spreads), _COLUMNS, width=10.0, height=height, sharex=True, sharey=True)
    for axes, s in zip(grid, spreads, strict=True):
        effects = {e.factor: e for e in s.effects}
        for position, effect in enumerate(map(effects.get, factors)):
            if effect:
                axes.barh(position, effect.rank_correlation, color=BLUE if effect.sure else GRAY, height=0.7)
                axes.plot([effect.low, effect.high], [position, position], color=INK, linewidth=0.9)
        axes.axvline(0.0, color=INK, linewidth=0.6)
        axes.set(title=s.name.partition(".")[2], xlim=(-1.0, 1.0))
        axes.set_yticks(range(len(factors)), factors, fontsize=7.0)
        axes.grid(axis="y", visible=False)
    grid[0].invert_yaxis()
    return Drawing(
        f"Experiment {name}: effects of the factors", plot,
        "Spearman's rank correlation with each factor; the line is its 95 % interval. A bar is grey if the interval "
        "contains zero. Of the factors without an effect, one in twenty is coloured by chance.")


def worst(summary: Summary, experiment: Experiment, spreads: Sequence[Spread]) -> Drawing:
    """Run the samples again that are the worst in a figure, and plot their responses together."""
    by_sample: dict[int, list[str]] = {}
    for s in spreads:
        by_sample.setdefault(s.worst[0][0], []).append(s.name.partition(".")[2])
    ranked = sorted(by_sample.items(), key=lambda item: -len(item[1]))[:_MOST_WORST]
    responses = [history(summary.study, experiment, index) for index, _ in ranked]
    label, unit_of_time = plots.time_axis(max(each.time[-1] for each in responses))
    plot, (angle, error) = plots.column("fin angle [deg]", "tracking error [deg]", x=f"{label} from the command",
                                         width=10.0, height=2.4)
    for k, ((index, names), response) in enumerate(zip(ranked, responses, strict=True)):
        time = (response.time - response.excitation.begin) * unit_of_time
        more = f" and {len(names) - _MOST_WORST} more" if len(names) > _MOST_WORST else ""
        look = {"color": COLORS[k % len(COLORS)], "label": f"{index}: {', '.join(names[:_MOST_WORST])}{more}"}
        if not k:
            angle.step(time, np.degrees(response.excitation.command), where="post", **COMMAND_STYLE)
        angle.plot(time, response.in_unit("fin_angle", "deg"), **look)
        error.plot(time, response.in_unit("tracking_error", "deg"), **look)
    plots.legend_above(angle, 1)
    return Drawing(f"Experiment {experiment.name}: worst samples", plot,
                   "Each sample is the worst in the figures of its label; the command (dashed) is that of the first.")


def described(factor: Factor) -> tuple[str, str]:
    """Return a factor's distribution as text, and the unit of its numbers; angles are in degrees."""
    unit, scale = shown(factor.unit) if factor.unit.startswith("rad") else (factor.unit, 1.0)
    kind, numbers, levels = factor.distribution.kind, factor.distribution.numbers, factor.distribution.levels
    if kind != "choice":
        return f"{kind}, {', '.join(f'{name} {value * scale:.4g}' for name, value in numbers.items())}", unit
    if len(levels) > _MOST_LEVELS:
        return f"{len(levels)} levels, {levels[0] * scale:g} .. {levels[-1] * scale:g}", unit
    return f"one of {', '.join(f'{level * scale:g}' for level in levels)}", unit


def seconds(value: float) -> str:
    """Return a time [s] as text; a dash if it is not finite."""
    return f"{value:.2f} s" if isfinite(value) else "–"


def write_report(summary: Summary, path: Path, command: str) -> None:
    """Write the page of a summary, with the `command` that runs the campaign."""
    study = summary.study
    source = Source(f"FMU with SHA-256 {study.fmu_sha256}, campaign" if study.fmu else "campaign", study.path.name, "",
                    parameters_hash(study.base), study.actuator.name)
    factors = [*((f.name, *described(f)) for f in study.factors),
               *((name, f"follows {leader}", "") for name, leader in study.followers.items())]
    write_page(path, "studies/campaign/page.html.j2", [source], s=summary, study=study, command=command,
               pictures=plots.pictures(drawings(summary)), shares=[f">{p} %" for p in PERCENTILES], factors=factors,
               text=text, measured=measured, seconds=seconds, unit=lambda figure: shown(figure.unit)[0],
               left_out=lacking(study.model), bandwidths=BANDWIDTHS)


def tables(summary: Summary) -> Iterator[Table]:
    """Yield tables for the terminal: the percentiles of every figure, the requirements and the faults."""
    yield table(["figure", "unit", *(f">{p} %" for p in _SHOWN), "depends most on"], (
        [s.name, shown(s.figure.unit)[0], *(measured(s, s.percentiles[p]) for p in _SHOWN),
         *(f"{_short(e.factor)} ({e.rank_correlation:+.2f})" if e.sure else "" for e in s.effects[:1])]
        for s in summary.spreads if not s.name.startswith(f"{REQUIREMENT}.")),
        "Percentiles over the samples", whole=[0])
    if summary.chances:
        yield _requirements(summary)
    if found := summary.findings:
        several = len({f.experiment for f in found}) > 1
        yield table(["single fault", "samples", "detected", "median delay", "tripped before", "monitors"], (
            [f"{f.experiment}: {f.fault}" if several else f.fault, str(f.samples), str(f.found), seconds(f.delay),
             str(f.before), ", ".join(f"{name} {n}" for name, n in f.monitors.items() if n)] for f in found),
            "Faults, and their detection by the built-in test", whole=[0])


def _requirements(summary: Summary) -> Table:
    """Return a table of requirements: median and bad percentile of the figure, and the samples that meet the limit."""
    low, median, high = _SHOWN
    *each, together = summary.chances
    rows: list[Sequence[str | Text] | None] = []
    for chance in each:
        r: Any = chance.requirement
        s = summary.by_name.get(f"{REQUIREMENT}.{r.name}")
        figures = [measured(s, s.percentiles[p]) for p in (median, high if r.sign > 0.0 else low)] if s else ["", ""]
        rows.append([r.name, f"{SENSES[r.sense]} {r.shown_limit:g} {r.shown[0]}", *figures,
                     f"{chance.met} of {chance.samples}", str(chance)])
    rows += ([j.name, f"{j.sense} {j.limit:g} {j.unit}", "", "", Text("not judged", "dim"), ""]
             for j in summary.study.left_out)
    last = "all that were judged" if summary.study.left_out else "all of them"
    rows += None, [last, "", "", "", f"{together.met} of {together.samples}", str(together)]
    return table(["requirement", ">required", f">{median} %", f">worst {low} %", ">met by", ">probability (95 %)"],
                 rows, "Samples that meet the requirements", whole=[0], plain=True)


def _short(factor: str) -> str:
    """Return a factor's name without the experiment's name."""
    return factor.split(".", 2)[2].removeprefix("inputs.") if factor.startswith("experiments.") else factor
