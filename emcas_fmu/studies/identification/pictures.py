"""Plots that all experiments use: measured points with a model, and residuals."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
from scipy.stats import norm

from ...plotting.plots import COLORS, GRAY, Drawing, figure, legend
from .estimation import Fit
from .records import Array

MOST_POINTS = 800  # of a series: more would only make the page larger


class Series(NamedTuple):
    """Measured points `x`, `y`, and the line of a model with a band of +-`band`, if any."""

    label: str
    x: Array
    y: Array
    model_x: Array
    model_y: Array
    band: Array | None = None


def thinned(*columns: Array) -> tuple[Array, ...]:
    """Return at most `MOST_POINTS` equally spaced rows of columns of the same length."""
    step = max(-(-len(columns[0]) // MOST_POINTS), 1)
    return tuple(c[::step] for c in columns)


def panels(title: str, parts: Iterable[tuple[str, Iterable[Series]]], x_label: str, y_label: str, caption: str,
           height: float = 3.4, sharey: bool = True) -> Drawing:
    """Plot panels side by side, each with a title and the points and models of its series; `height` is in inches."""
    plotted = [(name, list(series)) for name, series in parts]
    plot, grid = figure(1, len(plotted), width=9.5, height=height, sharey=sharey, x=x_label, y=[y_label])
    for axes, (name, series) in zip(grid[0], plotted, strict=True):
        for color, s in zip(COLORS * 4, series):
            x, y = thinned(s.x, s.y)
            size, alpha = (3.0, 0.45) if len(x) > 60 else (6.0, 1.0)
            # The model of a single series has another colour than its points, among which it would be hard to see.
            axes.plot(*thinned(s.model_x, s.model_y), color=COLORS[1] if len(series) == 1 else color, label=s.label)
            axes.plot(x, y, ".", color=color, markersize=size, alpha=alpha, linewidth=0, zorder=1.9,
                      label=s.label if len(series) > 1 else None)
            if s.band is not None:
                axes.fill_between(s.model_x, s.model_y - s.band, s.model_y + s.band, color=color, alpha=0.3,
                                  linewidth=0)
        axes.set_title(name)
        legend(axes, loc="best")
    return Drawing(title, plot, caption)


def residuals(series: Sequence[tuple[str, Array]], fit: Fit, x_label: str, y_label: str,
              factor: float = 1.0) -> Drawing:
    """Plot residuals over a quantity on which they may depend, their distribution and their autocorrelation.

    `series` has the label and that quantity for each stretch. Plotted residuals are multiplied by `factor`.
    """
    plot, ((first, second, third),) = figure(1, 3, width=9.5, height=2.9, width_ratios=(2.2, 1, 1), x=x_label,
                                              y=[y_label])
    colors = dict(zip(dict.fromkeys(label for label, _ in series), COLORS * 9))
    for (label, x), y in zip(series, fit.residuals, strict=True):
        first.plot(*thinned(x, y * factor), ".", color=colors[label], label=label, markersize=2.5, alpha=0.5,
                   linewidth=0)
    if 1 < len(colors) <= 3:
        legend(first, loc="lower right", markerscale=3, ncols=len(colors))
    first.axhline(0.0, color=GRAY, linewidth=0.8)
    scaled = [r / (np.sqrt(np.mean(r**2)) or 1.0) for r in fit.residuals]
    standard = np.concatenate(scaled)
    second.hist(standard, bins=np.linspace(-4.0, 4.0, 33).tolist(), density=True, color=COLORS[0])
    x = np.linspace(-4.0, 4.0, 100)
    second.plot(x, norm.pdf(x), color=COLORS[1], label="normal")
    second.set_xlabel("residual / its deviation")
    second.set_yticks([])
    second.legend(loc="upper right")
    lags = range(1, 21)
    autocorrelation = [sum(float(r[:-k] @ r[k:]) for r in scaled if len(r) > k)
                       / max(sum(len(r) - k for r in scaled if len(r) > k), 1) for k in lags]
    third.bar(lags, autocorrelation, color=COLORS[0], width=0.6)
    bound = 2.0 / np.sqrt(len(standard))
    third.axhspan(-bound, bound, color=GRAY, alpha=0.3, linewidth=0)
    third.set_xlabel("lag [samples]")
    third.set_ylabel("autocorrelation")
    return Drawing("Residuals", plot, "Differences from the fitted model. Left: they should have no trend. "
                   "Middle: their distribution should be nearly normal. Right: the uncertainties account for their "
                   "autocorrelation (grey: 2 sigma of white noise).")
