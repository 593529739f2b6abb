"""Outputs and inputs over time, as lines in panels."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import degrees, inf
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from . import plots

SHOWN: Mapping[str, tuple[str, float]] = {
    "fin_angle": ("fin angle [deg]", degrees(1.0)), "fin_command": ("fin angle [deg]", degrees(1.0)),
    "error": ("error [mdeg]", degrees(1e3)), "fin_rate": ("fin rate [deg/s]", degrees(1.0)),
    "aero_torque": ("moment [N.m]", 1.0), "drive_reference": ("DAC [V]", 1.0), "motor_current": ("current [A]", 1.0),
    "motor_voltage": ("voltage [V]", 1.0), "supply_voltage": ("voltage [V]", 1.0), "supply_power": ("power [W]", 1.0)}
"""The label of each variable's panel, and the factor from SI to the unit in the label."""
_ENOUGH_POINTS = 6000  # of a line, more than the pixels across a page; less than twice as many are plotted


def panels(names: Sequence[str], columns: int = 1, **more: Any) -> tuple[Figure, list[dict[str, Axes]]]:
    """Return a figure with a row of panels for each variable, and the panels of each column by the variables' names.

    `more` are arguments of `plots.figure`.
    """
    figure, grid = plots.figure(len(names), columns, y=[SHOWN[name][0] for name in names],
                                **{"sharex": True, "sharey": "row", **more})
    return figure, [dict(zip(names, column, strict=True)) for column in grid.T]


def trace(axes: Axes, columns: Mapping[str, Any], name: str, window: tuple[float, float] = (-inf, inf), *,
          zero: float = 0.0, unit: float = 1.0, every: int = 1, **look: Any) -> None:
    """Plot a variable over ``time`` minus `zero` [s], within a `window` [s] of ``time``; a command is plotted in steps.

    `unit` is the number of units of the time axis in a second. At most every `every`-th row is plotted.
    """
    at = _within(columns, window)
    at = at[::max(every, len(at) // _ENOUGH_POINTS)]
    command = {"label": "command", "drawstyle": "steps-post", **plots.COMMAND_STYLE} if name == "fin_command" else {}
    axes.plot((columns["time"][at] - zero) * unit, columns[name][at] * SHOWN[name][1], **{**command, **look})


def shade(axes: Axes, columns: Mapping[str, Any], flag: str, window: tuple[float, float], label: str,
          unit: float = 1.0) -> None:
    """Shade the times within a `window` [s] at which a flag is set; `unit` as in `trace`."""
    at = _within(columns, window)
    plots.shade(axes, columns["time"][at] * unit, columns[flag][at] > 0.5, label)


def _within(columns: Mapping[str, Any], window: tuple[float, float]) -> Any:
    """Return the indices of the rows within a window [s] that includes its ends."""
    return np.flatnonzero((columns["time"] >= window[0] - 1e-9) & (columns["time"] <= window[1] + 1e-9))
