"""Pictures of a campaign: distributions of figures, their dependence on the factors, the worst samples."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import isfinite
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from ...bench.metrics import shown
from ...figures.plots import BLUE, COLORS, COMMAND, GRAY, INK, VERMILLION, Drawing, column, figure, legend_above
from .experiments import Experiment
from .history import history
from .sample import subject_of
from .sampling import Sampler
from .summary import Spread, Summary

_COLUMNS = 3
_MOST_FACTORS = 12
_BINS = 40
_MOST_WORST = 6  # samples in a picture


def drawings(summary: Summary) -> Iterator[Drawing]:
    """Yield the pictures of each experiment."""
    for experiment in summary.study.plan.experiments:
        spreads = [s for s in summary.spreads_of(experiment.name) if isfinite(s.mean) and s.smallest != s.largest]
        if spreads:
            yield histograms(experiment.name, spreads)
        if dependent := [s for s in spreads if s.effects]:
            yield dependence(experiment.name, dependent)
        if drawing := worst(summary, experiment, spreads):
            yield drawing


def _panels(spreads: Sequence[Spread], height: float, **more: Any) -> tuple[Figure, list[Any]]:
    """Return a picture with a panel for each spread; `height` of a row in inches."""
    drawn, grid = figure(-(-len(spreads) // _COLUMNS), _COLUMNS, width=10.0, height=height, **more)
    for axes in grid.flat[len(spreads):]:
        axes.set_visible(False)
    return drawn, list(grid.flat[:len(spreads)])


def histograms(name: str, spreads: Sequence[Spread]) -> Drawing:
    """Plot histograms of the figures of an experiment."""
    drawn, panels = _panels(spreads, 1.9)
    for axes, s in zip(panels, spreads, strict=True):
        unit, scale = shown(s.figure.unit)
        axes.hist(s.values * scale, bins=min(_BINS, max(5, int(np.sqrt(len(s.values))))), color=BLUE, alpha=0.75)
        for p, color in ((50, INK), (95, VERMILLION), (5, VERMILLION)):
            if isfinite(s.percentiles[p]):
                axes.axvline(s.percentiles[p] * scale, color=color, linewidth=1.0, linestyle="-" if p == 50 else "--")
        without = f" ({s.without} without)" if s.without else ""
        axes.set(title=f"{s.name.partition('.')[2]}{without}", xlabel=unit)
        axes.grid(axis="x", visible=False)
    return Drawing(f"Experiment {name}: spread", drawn,
                   "Number of samples; the lines are the median and, dashed, 5 and 95 %.")


def dependence(name: str, spreads: Sequence[Spread]) -> Drawing:
    """Plot the rank correlations of the figures of an experiment with the factors, as bars with their intervals."""
    strongest: dict[str, float] = {}
    for s in spreads:
        for e in s.effects:
            strongest[e.factor] = max(strongest.get(e.factor, 0.0), abs(e.rank_correlation))
    factors = sorted(strongest, key=lambda f: -strongest[f])[:_MOST_FACTORS]
    drawn, panels = _panels(spreads, 0.75 + 0.2 * len(factors), sharex=True, sharey=True)
    for axes, s in zip(panels, spreads, strict=True):
        effects = {e.factor: e for e in s.effects}
        for position, factor in enumerate(factors):
            if factor in effects:
                e = effects[factor]
                axes.barh(position, e.rank_correlation, color=BLUE if e.sure else GRAY, alpha=0.75, height=0.7)
                axes.plot([e.low, e.high], [position, position], color=INK, linewidth=0.9)
        axes.axvline(0.0, color=INK, linewidth=0.6)
        axes.set(title=s.name.partition(".")[2], xlim=(-1.0, 1.0))
        axes.set_yticks(range(len(factors)), factors, fontsize=7.0)
        axes.grid(axis="y", visible=False)
    for axes in panels[-_COLUMNS:]:  # the lowest of each column
        axes.tick_params(labelbottom=True)
    panels[0].invert_yaxis()
    return Drawing(
        f"Experiment {name}: what it depends on", drawn,
        "Spearman's rank correlation with each factor; the line is its 95 % interval, grey where that holds zero. Of "
        "the factors without any effect, one in twenty is coloured by chance.")


def worst(summary: Summary, experiment: Experiment, spreads: Sequence[Spread]) -> Drawing | None:
    """Plot over each other, run again, the samples that are the worst in a figure; None if there are none."""
    by_sample: dict[int, list[str]] = {}
    for s in spreads:
        for index, _ in s.worst[:1]:
            by_sample.setdefault(index, []).append(s.name.partition(".")[2])
    if not by_sample:
        return None
    plan, sampler = summary.study.plan, Sampler(summary.study)
    ranked = sorted(by_sample.items(), key=lambda item: -len(item[1]))[:_MOST_WORST]
    drawn, (angle, error) = column("fin angle [deg]", "tracking error [deg]", x="time from the command [s]", width=10.0,
                                   height=2.4)
    for k, (index, names) in enumerate(ranked):
        response = history(plan, experiment, sampler.draw([index])[0].tolist(), subject_of(plan))
        time = response.time - response.excitation.begin
        look = {"color": COLORS[k % len(COLORS)], "label": f"{index}: {', '.join(names)}"}
        if not k:
            angle.step(time, np.degrees(response.excitation.command), where="post", **COMMAND)
        angle.plot(time, response.in_unit("fin_angle", "deg"), **look)
        error.plot(time, response.in_unit("tracking_error", "deg"), **look)
    legend_above(angle, 1)
    return Drawing(f"Experiment {experiment.name}: worst samples", drawn,
                   "The samples that are the worst of all by the figures named; the command (dashed) is the first's.")
