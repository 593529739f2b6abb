"""Panels of lines over a common axis, the plots of most entries."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import cycle
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from emcas_fmu.bench.runs import Run
from emcas_fmu.plotting import plots
from emcas_fmu.plotting.plots import COMMAND_STYLE

from .rigs import Columns

Look = Mapping[str, Any]
DASHED: Look = {"linestyle": (0, (5, 1.5))}
DOTS: Look = {"linestyle": "none", "marker": "o", "markersize": 4.0}


class Line(NamedTuple):
    """A line through points. Without a colour in `look` the line gets the next colour; `label` is above the panel."""

    x: Any
    y: Any
    label: str = ""
    look: Look = MappingProxyType({})


class Panel(NamedTuple):
    """A panel: the label of its vertical axis, its lines, and levels shown as horizontal lines."""

    label: str
    lines: Sequence[Line]
    levels: Sequence[float] = ()


def panels(parts: Sequence[Panel], x_label: str, x_range: tuple[float, float] | None = None,
           height: float = 2.0) -> Figure:
    """Return panels below each other over the same axis, each of `height` [inch]; a single panel is 35 % higher."""
    figure, grid = plots.figure(len(parts), height=height if len(parts) > 1 else 1.35 * height, sharex=True)
    for axes, panel in zip(grid[:, 0], parts, strict=True):
        _draw(axes, panel, x_range)
    grid[-1, 0].set_xlabel(x_label)
    return figure


def _draw(axes: Axes, panel: Panel, x_range: tuple[float, float] | None) -> None:
    colors = cycle(plots.COLORS)
    for level in panel.levels:
        axes.axhline(level, **plots.LIMIT)
    for line in panel.lines:
        look = dict(line.look)
        if "color" not in look:
            look["color"] = next(colors)
        x, y = np.asarray(line.x), np.asarray(line.y)
        shown = np.ones(len(x), bool) if x_range is None else (x >= x_range[0]) & (x <= x_range[1])
        axes.plot(x[shown], y[shown], label=line.label or "_", **look)
    if any(line.label for line in panel.lines):
        plots.legend_above(axes)
    axes.set_ylabel(panel.label)
    axes.margins(x=0.0)


def command(time: Any, asked: Any) -> Line:
    """Return a command [rad] over time [s] as a line with steps, in degrees."""
    return Line(time, np.degrees(asked), "command", {**COMMAND_STYLE, "drawstyle": "steps-post"})


def command_of(run: Run) -> Line:
    """Return the command of a run over time as a line."""
    return command(run.excitation.time, run.excitation.command)


def angle(columns: Columns, label: str = "", **look: Any) -> Line:
    """Return the fin angle [deg] over time [s] as a line."""
    return Line(columns["time"], np.degrees(columns["fin_angle"]), label, look)


def rate(columns: Columns, label: str = "", **look: Any) -> Line:
    """Return the fin rate [deg/s] over time [s] as a line."""
    return Line(columns["time"], np.degrees(columns["fin_rate"]), label, look)


def current(columns: Columns, label: str = "", **look: Any) -> Line:
    """Return the motor current [A] over time [s] as a line."""
    return Line(columns["time"], columns["motor_current"], label, look)
