"""Pictures of a campaign: how figures spread, and what they depend on."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from matplotlib.figure import Figure

from ...bench.metrics import shown
from ...plots import BLUE, GRAY, INK, VERMILLION, figure
from .sample import OK
from .summary import PERCENTILES, Spread, Summary

Drawing = tuple[Figure, str, str]
_COLUMNS = 3
_MOST_FACTORS = 12
_BINS = 40


def all_figures(summary: Summary) -> Iterator[Drawing]:
    """Figure, title and caption of each."""
    for experiment in summary.study.plan.experiments:
        spreads = [s for s in summary.spreads if s.name.startswith(f"{experiment.name}.")
                   and np.isfinite([s.mean]).all() and s.smallest != s.largest]
        if spreads:
            yield histograms(experiment.name, spreads, summary)
        if any(s.effects for s in spreads):
            yield dependence(experiment.name, [s for s in spreads if s.effects])


def histograms(name: str, spreads: list[Spread], summary: Summary) -> Drawing:
    """How the figures of an experiment spread."""
    good = np.asarray([status == OK for status in summary.table["status"].to_pylist()])
    drawn, grid = figure(-(-len(spreads) // _COLUMNS), _COLUMNS, width=10.0, height=1.9)
    for axes, s in zip(grid.flat, spreads):
        values = summary.table[s.name].to_numpy()[good]
        values = values[np.isfinite(values)]
        unit, scale = shown(s.figure.unit)
        axes.hist(values * scale, bins=min(_BINS, max(5, int(np.sqrt(len(values))))), color=BLUE, alpha=0.75)
        for p, color in ((50, INK), (95, VERMILLION), (5, VERMILLION)):
            at = s.percentiles[PERCENTILES.index(p)]
            if np.isfinite(at):
                axes.axvline(at * scale, color=color, linewidth=1.0, linestyle="-" if p == 50 else "--")
        without = f" ({s.without} without)" if s.without else ""
        axes.set(title=f"{s.name.partition('.')[2]}{without}", xlabel=unit)
        axes.grid(axis="x", visible=False)
    for axes in grid.flat[len(spreads):]:
        axes.set_visible(False)
    return drawn, f"Experiment {name}: spread", "Number of samples; the lines are the median and, dashed, 5 and 95 %."


def dependence(name: str, spreads: list[Spread]) -> Drawing:
    """Rank correlation of every figure of an experiment with every factor, as bars with their intervals."""
    strongest: dict[str, float] = {}
    for s in spreads:
        for e in s.effects:
            strongest[e.factor] = max(strongest.get(e.factor, 0.0), abs(e.rank))
    factors = sorted(strongest, key=lambda f: -strongest[f])[:_MOST_FACTORS]
    drawn, grid = figure(-(-len(spreads) // _COLUMNS), _COLUMNS, width=10.0, height=0.75 + 0.2 * len(factors),
                         sharex=True, sharey=True)
    places = np.arange(len(factors))
    for axes, s in zip(grid.flat, spreads):
        found = {effect.factor: effect for effect in s.effects}
        for place, factor in zip(places, factors, strict=True):
            if factor in found:
                e = found[factor]
                axes.barh(place, e.rank, color=BLUE if e.sure else GRAY, alpha=0.75, height=0.7)
                axes.plot([e.low, e.high], [place, place], color=INK, linewidth=0.9)
        axes.axvline(0.0, color=INK, linewidth=0.6)
        axes.set(title=s.name.partition(".")[2], xlim=(-1.0, 1.0))
        axes.set_yticks(places, factors, fontsize=7.0)
        axes.grid(axis="y", visible=False)
    for axes in grid.flat[max(len(spreads) - _COLUMNS, 0):len(spreads)]:  # the lowest of each column
        axes.tick_params(labelbottom=True)
    grid.flat[0].invert_yaxis()
    for axes in grid.flat[len(spreads):]:
        axes.set_visible(False)
    return drawn, f"Experiment {name}: what it depends on", (
        "Spearman's rank correlation with each factor; the line is its 95 % interval, grey where that holds zero. Of "
        "the factors without any effect, one in twenty is coloured by chance.")
