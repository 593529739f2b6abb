"""The plot of a response over time."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from .actuators import extension_outputs
from .bench import metrics
from .bench.conditions import ESTIMATE
from .bench.excitation import COMMAND
from .bench.runs import Columns, Run
from .fmi.interface import FmuInterface
from .plotting.plots import COLORS, COMMAND_STYLE, legend, panel_grid, shade, time_axis
from .variables import Variable

_LINES = ("-", (0, (5, 1.5)), (0, (1, 1.2)), (0, (5, 1.5, 1, 1.5)))  # styles of outputs in a panel, for several fins


def draw(interface: FmuInterface, title: str, fins: Sequence[Run], columns: Columns,
         panels: Sequence[Sequence[Variable]], estimated: Collection[str]) -> Figure:
    """Plot command and outputs of the fins, their line and extensions over time, and shade active limits.

    `fins` are the runs of the fins, `columns` the outputs of the `interface` by name with ``time`` [s], `panels` the
    actuator's outputs in each panel, `estimated` the names of extensions' outputs that depend on estimates. The caller
    is inside `style()`.
    """
    label, unit_of_time = time_axis(columns["time"][-1])
    time = columns["time"] * unit_of_time
    extensions = extension_outputs(interface.kind)
    shared = interface.line.outputs if interface.line else ()
    plotted, grid = panel_grid(len(panels) + len(shared) + len(extensions), 2, (
        f"{label} (shaded: a limit {'of any fin ' * (len(fins) > 1)}is active)"), width=10.0, sharex=True)
    first, remaining = grid[0], iter(grid)
    commands = [run.excitation.command for run in fins if COMMAND in run.excitation.columns]
    for command in commands:
        first.step(time, np.degrees(command), where="post", label="command", **COMMAND_STYLE)
    for panel, axes in zip(panels, remaining, strict=False):
        _draw_panel(axes, panel, time, fins)
    first.set_title(title)
    legend(first, loc="best", ncols=1 + len(fins) // 5)
    for v, axes in zip(shared, remaining, strict=False):
        measured_in, scale = metrics.shown(v.unit)
        axes.plot(time, columns[v.name] * scale, color=COLORS[0])
        axes.set_ylabel(f"{v.name.replace('_', ' ')} [{measured_in}]")
    for v, axes in zip(extensions, remaining, strict=False):
        _draw_output(axes, v, time, [run.columns[v.name] for run in fins], v.name in estimated)
    limited = np.any([run.columns["saturated"] > 0.0 for run in fins], axis=0)
    for axes in grid:
        shade(axes, time, limited)
        axes.margins(x=0.0)
    return plotted


def _draw_panel(axes: Axes, panel: Sequence[Variable], time: Any, fins: Sequence[Run]) -> None:
    """Plot outputs of one unit, each with a colour; for several fins, colours show fins and line styles outputs."""
    unit, scale = metrics.shown_output(panel[0])
    names, several = [v.name.replace("_", " ") for v in panel], len(fins) > 1
    for j, (v, name) in enumerate(zip(panel, names, strict=True)):
        for k, run in enumerate(fins):
            label = f"fin {k + 1}" if several and len(panel) == 1 else name
            axes.plot(time, run.columns[v.name] * scale, label=label, color=COLORS[(k if several else j) % len(COLORS)],
                      linestyle=_LINES[j % len(_LINES) if several else 0])
    axes.set_ylabel(f"{names[0]} [{unit}]" if len(panel) == 1 else f"[{unit}]")
    if len(panel) > 1:
        legend(axes, loc="best")


def _draw_output(axes: Axes, v: Variable, time: Any, columns: Sequence[Any], estimated: bool) -> None:
    """Plot an extension's output, a line for each fin; for a word of flags, a bar where each flag is set."""
    axes.set_ylabel(f"{v.name.replace('_', ' ')}{f' [{v.unit}]' if v.kind == 'Real' else ''}{ESTIMATE * estimated}")
    flags = [i for i in range(len(v.bits)) if any(np.any(column.astype(int) >> i & 1) for column in columns)]
    for k, column in enumerate(columns):
        color = COLORS[k % len(COLORS)]
        if not v.bits:
            axes.plot(time, column, color=color, drawstyle="default" if v.kind == "Real" else "steps-pre",
                      label=f"fin {k + 1}" if len(columns) > 1 else None)
        for row, i in enumerate(flags):
            at = row + 0.6 * ((k + 0.5) / len(columns) - 0.5)
            axes.plot(time, np.where(column.astype(int) >> i & 1, at, np.nan), color=color, linewidth=3.0)
    if v.items:
        axes.set_yticks(range(1, len(v.items) + 1), [item for item, _ in v.items])
        axes.set_ylim(0.5, len(v.items) + 0.5)
    elif v.bits:
        axes.set_yticks(range(max(len(flags), 1)), [v.bits[i] for i in flags] or ["none"])
        axes.set_ylim(-0.5, max(len(flags), 1) - 0.5)
    elif v.kind == "Boolean":
        axes.set(yticks=(0, 1), ylim=(-0.1, 1.1))
    elif v.kind != "Real":
        axes.yaxis.set_major_locator(MaxNLocator(integer=True, min_n_ticks=1))
