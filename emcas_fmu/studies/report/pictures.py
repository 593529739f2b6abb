"""The pictures of an acceptance report, one for a test."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from math import degrees
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from ...bench.excitation import HOLD
from ...bench.metrics import ACCURACY as _ACCURACY
from ...bench.verdict import Judged
from ...bench.writers import with_unit
from ...figures import plots
from ...figures.plots import COMMAND, LIMIT, Drawing, Picture, legend_above
from .outcome import Array, Outcome
from .study import Result

ACCURACY = round(degrees(_ACCURACY), 9)  # deg
_REQUIRED: Mapping[str, Any] = {**LIMIT, "color": plots.PURPLE, "linewidth": 1.1}
_MOST_POINTS = 3000  # of a line: more than a page has pixels


def pictures(result: Result) -> dict[str, Picture]:
    """Draw the picture of each test that has one, with the limits that requirements set its figures."""
    drawn = {name: outcome for name, outcome in result.outcomes.items() if name in _DRAWINGS and not outcome.stopped}
    return dict(zip(drawn, plots.pictures(_drawn(outcome, result.limits(name)) for name, outcome in drawn.items()),
                    strict=True))


def _drawn(outcome: Outcome, limits: Sequence[Judged]) -> Drawing:
    """Draw a test; limits that have no line in its panels stand in the caption."""
    left = list(limits)
    drawing = _DRAWINGS[outcome.name](outcome, left)
    words = "; ".join(f"{j.title} {'≥' if j.sense == '>=' else '≤'} {with_unit(j.limit, j.unit)}" for j in left)
    return drawing._replace(caption=f"{drawing.caption} Required, and not drawn: {words}.") if words else drawing


def _limit(axes: Axes, limits: list[Judged], unit: str, scale: float = 1.0, *, across: bool = True, sides: bool = False,
           label: bool = True) -> None:
    """Draw limits of a unit as lines, and drop them from `limits`: levels, on both `sides` of zero, or instants."""
    for at in dict.fromkeys(j.limit for j in limits if j.unit == unit):
        words = f"required {with_unit(at, unit)}" if label else None
        plots.limits(axes, at * scale, sides=sides, across=across, label=words, **_REQUIRED)
    limits[:] = [j for j in limits if j.unit != unit]


def _thin(*columns: Array) -> list[Array]:
    stride = max(len(columns[0]) // _MOST_POINTS, 1)
    return [column[::stride] for column in columns]


def _steps(outcome: Outcome, limits: list[Judged]) -> Drawing:
    made, (angle, error) = plots.column("fin angle [deg]", "angle - command [deg]", x="time from the command [s]",
                                        height=2.4, sharex=False)
    pairs = list(outcome.series.items())
    for number, (group, series) in enumerate(reversed(pairs)):
        color = plots.COLORS[(len(pairs) - 1 - number) // 2 % len(plots.COLORS)]
        size = float(series["command_deg"][0])
        look: dict[str, Any] = {"color": color, "linestyle": "-" if size > 0.0 else (0, (5, 1.2))}
        look["label"] = outcome.label(group)
        time = series["time_s"]
        near = time <= 0.4
        angle.plot(time[near] * 1e3, series["angle_deg"][near], **look)
        angle.plot([0.0, 400.0], [size, size], **LIMIT)
        far = time >= 0.0
        error.plot(*_thin(time[far], series["angle_deg"][far] - size), **{**look, "linewidth": 1.0})
    _limit(angle, limits, "ms", across=False)
    _limit(error, limits, "deg", sides=True)
    legend_above(angle, 8)
    angle.set(xlabel="time from the command [ms]", xlim=(-20, 400))
    error.axhspan(-ACCURACY, ACCURACY, color=plots.GREEN, alpha=0.10, linewidth=0)
    error.set(ylim=(-2 * ACCURACY, 2 * ACCURACY), xlim=(0.0, HOLD))
    return Drawing(outcome.title, made, "Above, the first 0.4 s; negative steps dashed, dotted lines the commands. "
                   f"Below, what is left of the error; the green band is the accuracy of Table 2, ±{ACCURACY:g} deg.")


def _bode(outcome: Outcome, limits: list[Judged]) -> Drawing:
    made, (gain, phase, coherence) = plots.column("", "", "coherence", height=1.9, height_ratios=(1.3, 1.3, 0.8))
    for color, (group, curve) in zip(plots.COLORS, outcome.curves.items(), strict=False):
        look = {"color": color, "label": outcome.label(group)}
        figures = outcome.figures[group]
        plots.bode(gain, phase, curve["frequency_hz"], curve["gain_db"], curve["phase_deg"],
                   (figures["bandwidth_3db_hz"], figures["bandwidth_90deg_hz"]), **look)
        coherence.semilogx(curve["frequency_hz"], curve["coherence"], **look)
    plots.bode_axes(gain, phase)
    _limit(phase, list(limits), "Hz", across=False, label=False)
    _limit(gain, limits, "Hz", across=False)
    legend_above(gain)
    coherence.set(ylim=(0.0, 1.05))
    plots.frequency_axis(coherence, (0.5, 1, 2, 5, 10, 20))
    for axes in (gain, phase, coherence):
        axes.minorticks_off()
        axes.margins(x=0.0)
    return Drawing(outcome.title, made, "Fundamental of fin angle over command; the dots mark -3 dB and -90 deg.")


def _slew(outcome: Outcome, limits: list[Judged]) -> Drawing:
    panels = [panel for panel in (("fin_angle", "fin angle [deg]"), ("fin_rate", "fin rate [deg/s]"),
                                  ("motor_current", "current [A]")) if panel[0] in outcome.series["unloaded_positive"]]
    names = [name for name, _ in panels]
    made, grid = plots.figure(len(panels), 2, height=1.7, sharex=True, sharey="row", x="time from the command [ms]",
                              y=[label for _, label in panels])
    for column, direction in enumerate(("positive", "negative")):
        for color, load in zip(plots.COLORS, ("unloaded", "opposing", "aiding"), strict=False):
            series = outcome.series[f"{load}_{direction}"]
            near = series["time_s"] <= 0.35
            for axes, (name, _) in zip(grid[:, column], panels, strict=True):
                axes.plot(series["time_s"][near] * 1e3, series[name][near], color=color,
                          label=outcome.label(f"{load}_{direction}").partition(",")[0])
        if "fin_rate" in names:
            rate = grid[names.index("fin_rate"), column]
            _limit(rate, list(limits), "deg/s", 1.0 if direction == "positive" else -1.0)
            legend_above(rate, 3)
        grid[0, column].set_title(f"{direction} direction", pad=16)
        legend_above(grid[0, column], 3)
        grid[0, column].margins(x=0.0)
    limits[:] = [j for j in limits if j.unit != "deg/s" or "fin_rate" not in names]
    return Drawing(outcome.title, made, "Full travel in either direction.")


def _grid(outcome: Outcome, limits: list[Judged]) -> Drawing:
    made, (axes,) = plots.column("angle - command [mdeg]", x="command [deg]", height=2.6)
    curve = outcome.curves["grid"]
    for name, color, marker in (("below", plots.BLUE, "^"), ("above", plots.VERMILLION, "v")):
        errors = outcome.series[name]["errors_deg"] * 1e3
        axes.plot(curve["command_deg"], curve[f"error_from_{name}_deg"] * 1e3, color=color, linewidth=1.0,
                  label=f"approached from {name}, mean")
        axes.plot(np.repeat(curve["command_deg"], errors.shape[1]), errors.ravel(), linestyle="none", marker=marker,
                  markersize=3.5, color=color, alpha=0.6)
    axes.axhline(0.0, **LIMIT)
    # A limit much beyond what is measured would flatten it: that one stands in the caption.
    measured = max(float(np.max(np.abs(series["errors_deg"]))) for series in outcome.series.values())
    near = [j for j in limits if j.limit <= 4.0 * measured]
    limits[:] = [j for j in limits if j not in near]
    _limit(axes, near, "deg", 1e3, sides=True)
    limits += near
    legend_above(axes)
    return Drawing(outcome.title, made, "Every approach (marks) and their means (lines), in thousandths of a degree.")


def _stiffness(outcome: Outcome, limits: list[Judged]) -> Drawing:
    made, (size, phase) = plots.column("|T/θ| [N.m/rad]", "phase [deg]", height=2.2, height_ratios=(1.5, 1.0))
    for color, (group, curve) in zip(plots.COLORS, outcome.curves.items(), strict=False):
        look = {"color": color, "marker": "o", "markersize": 3.5,
                "label": f"{outcome.label(group)}, {outcome.figures[group]['load_amplitude_n_m']:.3g} N.m"}
        size.loglog(curve["frequency_hz"], curve["stiffness_n_m_per_rad"], **look)
        phase.semilogx(curve["frequency_hz"], curve["phase_deg"], **look)
    _limit(size, limits, "N.m/rad")
    if outcome.curves:
        legend_above(size, 3)
    phase.set(ylim=(-190, 190), yticks=(-180, -90, 0, 90, 180))
    plots.frequency_axis(phase, (1, 2, 5, 10, 20, 40))
    return Drawing(outcome.title, made, "Hinge moment over fin angle. 0 deg is a spring; +90 deg a damper; ±180 deg an "
                   "inertia, whose line rises with the square of the frequency.")


def _mission(outcome: Outcome, limits: list[Judged]) -> Drawing:
    (series,) = outcome.series.values()
    panels = [panel for panel in (("angle_deg", "angle [deg]", plots.BLUE),
                                  ("moment_n_m", "moment [N.m]", plots.PURPLE),
                                  ("motor_current", "current [A]", plots.VERMILLION),
                                  ("supply_power", "power [W]", plots.GREEN)) if panel[0] in series]
    made, column = plots.column(*(label for _, label, _ in panels), x="time [s]", height=1.5)
    for axes, (name, _, color) in zip(column, panels, strict=True):
        axes.plot(*_thin(series["time_s"], series[name]), color=color, linewidth=1.3 if name == "angle_deg" else 0.8,
                  label="fin angle")
        axes.margins(x=0.0)
        _limit(axes, limits, {"motor_current": "A", "supply_power": "W", "moment_n_m": "N.m"}.get(name, ""), sides=True)
        if name == "supply_power":
            axes.axhline(0.0, **LIMIT)
    column[0].plot(*_thin(series["time_s"], series["command_deg"]), label="command", **COMMAND)
    legend_above(column[0])
    return Drawing(outcome.title, made, "Power below zero is fed back to the bus." if "supply_power" in series else "")


_DRAWINGS: Mapping[str, Callable[[Outcome, list[Judged]], Drawing]] = {
    "step_response": _steps, "frequency_response": _bode, "slew_rate": _slew, "static_accuracy": _grid,
    "dynamic_stiffness": _stiffness, "mission": _mission,
}
