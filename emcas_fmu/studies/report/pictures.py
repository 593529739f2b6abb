"""The pictures of an acceptance report, one per test."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from math import degrees
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from ...bench.excitation import HOLD, LOAD
from ...bench.metrics import ACCURACY as _ACCURACY
from ...bench.runs import Run
from ...bench.verdict import Judged
from ...figures import plots
from ...figures.plots import COMMAND, LIMIT, Drawing, Picture, legend_above
from ...pages.numbers import with_unit
from .acceptance import Result
from .outcome import Array, Outcome

ACCURACY = round(degrees(_ACCURACY), 9)  # deg
_REQUIRED: Mapping[str, Any] = {**LIMIT, "color": plots.PURPLE, "linewidth": 1.1}
_MOST_POINTS = 3000  # of a line: more than a page has pixels
# Figures whose requirements have their limits in a test's picture.
_LIMITED = {"step_response": ("settling_time", "overshoot"), "static_accuracy": ("held_error",),
            "slew_rate": ("sustained_rate",), "frequency_response": ("bandwidth_3db",)}


def pictures(result: Result) -> dict[str, Picture]:
    """Return the picture of each test that has one, with the limits of the requirements on its figures."""
    plotted = {name: outcome for name, outcome in result.outcomes.items() if name in _DRAWINGS and not outcome.stopped}
    return dict(zip(plotted, plots.pictures(_drawing(outcome, result.judged) for outcome in plotted.values()),
                    strict=True))


def _drawing(outcome: Outcome, judged: Sequence[Judged]) -> Drawing:
    """Return the picture of a test; limits without a line in its panels are written in the caption."""
    left = [j for j in judged if not j.skipped and j.figure in _LIMITED.get(outcome.name, ())]
    drawing = _DRAWINGS[outcome.name](outcome, left)
    words = "; ".join(f"{j.title} {'≥' if j.sense == '>=' else '≤'} {with_unit(j.limit, j.unit)}" for j in left)
    return drawing._replace(caption=f"{drawing.caption} Required, and not drawn: {words}.") if words else drawing


def _limit(axes: Axes, limits: list[Judged], unit: str, scale: float = 1.0, *, across: bool = True, sides: bool = False,
           label: bool = True) -> None:
    """Plot the limits in a unit as lines, at levels (on both `sides` of zero) or times; remove them from `limits`."""
    for at in dict.fromkeys(j.limit for j in limits if j.unit == unit):
        words = f"required {with_unit(at, unit)}" if label else None
        plots.limits(axes, at * scale, sides=sides, across=across, label=words, **_REQUIRED)
    limits[:] = [j for j in limits if j.unit != unit]


def _thin(*columns: Array) -> list[Array]:
    stride = max(len(columns[0]) // _MOST_POINTS, 1)
    return [column[::stride] for column in columns]


def _column(run: Run, name: str) -> Array:
    """Return an output for a picture: angles and rates in degrees."""
    column = run.columns[name]
    return column if name in ("time", "motor_current", "supply_power") else np.degrees(column)


def _steps(outcome: Outcome, limits: list[Judged]) -> Drawing:
    made, (angle, error) = plots.column("fin angle [deg]", "angle - command [deg]", x="time from the command [s]",
                                        height=2.4, sharex=False)
    runs = list(outcome.data.items())
    for number, (group, run) in reversed(list(enumerate(runs))):
        size = degrees(run.excitation.moves[-1].level)
        look: dict[str, Any] = {"color": plots.COLORS[number // 2 % len(plots.COLORS)],
                                "linestyle": "-" if size > 0.0 else (0, (5, 1.2)), "label": outcome.label(group)}
        time, response = run.columns["time"] - run.excitation.begin, _column(run, "fin_angle")
        near, after = time <= 0.4, time >= 0.0
        angle.plot(time[near] * 1e3, response[near], **look)
        angle.plot([0.0, 400.0], [size, size], **LIMIT)
        error.plot(*_thin(time[after], response[after] - size), **{**look, "linewidth": 1.0})
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
    recorded = outcome.data["unloaded_positive"].columns
    panels = {name: label for name, label in (("fin_angle", "fin angle [deg]"), ("fin_rate", "fin rate [deg/s]"),
                                              ("motor_current", "current [A]")) if name in recorded}
    made, grid = plots.figure(len(panels), 2, height=1.7, sharex=True, sharey="row", x="time from the command [ms]",
                              y=panels.values())
    for column, (direction, sign) in zip(grid.T, (("positive", 1.0), ("negative", -1.0)), strict=True):
        rows = dict(zip(panels, column, strict=True))
        for color, load in zip(plots.COLORS, ("unloaded", "opposing", "aiding"), strict=False):
            run, label = outcome.data[f"{load}_{direction}"], outcome.label(f"{load}_{direction}").partition(",")[0]
            time = run.columns["time"] - run.excitation.begin
            near = run.excitation.judged(run.columns["time"]) & (time <= 0.35)
            for name, axes in rows.items():
                axes.plot(time[near] * 1e3, _column(run, name)[near], color=color, label=label)
        if "fin_rate" in rows:
            _limit(rows["fin_rate"], list(limits), "deg/s", sign)
            legend_above(rows["fin_rate"], 3)
        column[0].set_title(f"{direction} direction", pad=16)
        legend_above(column[0], 3)
        column[0].margins(x=0.0)
    limits[:] = [j for j in limits if j.unit != "deg/s" or "fin_rate" not in panels]
    return Drawing(outcome.title, made, "Full travel in either direction.")


def _grid(outcome: Outcome, limits: list[Judged]) -> Drawing:
    made, (axes,) = plots.column("angle - command [mdeg]", x="command [deg]", height=2.6)
    curve = outcome.curves["grid"]
    for name, color, marker in (("below", plots.BLUE, "^"), ("above", plots.VERMILLION, "v")):
        errors = outcome.data[name] * 1e3
        axes.plot(curve["command_deg"], curve[f"error_from_{name}_deg"] * 1e3, color=color, linewidth=1.0,
                  label=f"approached from {name}, mean")
        axes.plot(np.repeat(curve["command_deg"], errors.shape[1]), errors.ravel(), linestyle="none", marker=marker,
                  markersize=3.5, color=color, alpha=0.6)
    axes.axhline(0.0, **LIMIT)
    # A limit far beyond the errors would flatten their curves: it is written in the caption.
    measured = max(float(np.max(np.abs(errors))) for errors in outcome.data.values())
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
    (run,) = outcome.data.values()
    time, load = run.columns["time"], run.excitation.columns.get(LOAD, np.zeros(len(run.columns["time"])))
    panels = [(label, unit, color, load if name == LOAD else _column(run, name)) for name, label, unit, color in (
        ("fin_angle", "angle", "deg", plots.BLUE), (LOAD, "moment", "N.m", plots.PURPLE),
        ("motor_current", "current", "A", plots.VERMILLION), ("supply_power", "power", "W", plots.GREEN))
        if name == LOAD or name in run.columns]
    made, column = plots.column(*(f"{label} [{unit}]" for label, unit, *_ in panels), x="time [s]", height=1.5)
    for axes, (label, unit, color, values) in zip(column, panels, strict=True):
        axes.plot(*_thin(time, values), color=color, linewidth=1.3 if label == "angle" else 0.8, label="fin angle")
        axes.margins(x=0.0)
        _limit(axes, limits, "" if label == "angle" else unit, sides=True)
        if label == "power":
            axes.axhline(0.0, **LIMIT)
    column[0].plot(*_thin(time, np.degrees(run.excitation.command)), label="command", **COMMAND)
    legend_above(column[0])
    return Drawing(outcome.title, made,
                   "Power below zero is fed back to the bus." if "supply_power" in run.columns else "")


_DRAWINGS: Mapping[str, Callable[[Outcome, list[Judged]], Drawing]] = {
    "step_response": _steps, "frequency_response": _bode, "slew_rate": _slew, "static_accuracy": _grid,
    "dynamic_stiffness": _stiffness, "mission": _mission,
}
