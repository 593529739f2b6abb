"""The pictures of an acceptance report, at most one per test."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from math import degrees, inf, nan
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ...bench.excitation import COMMAND, HOLD, LOAD
from ...bench.metrics import ACCURACY
from ...bench.verdict import Judged
from ...pages.numbers import with_unit
from ...plotting import plots, traces
from ...plotting.plots import LIMIT, REQUIRED, Drawing, Picture, legend_above
from .outcome import Outcome

_ACCURACY = round(degrees(ACCURACY) * 1e3, 6)  # mdeg


def pictures(outcomes: Mapping[str, Outcome], judged: Sequence[Judged]) -> dict[str, Picture]:
    """Return the picture of each test that has one, with the limits of the requirements on its figures."""
    plotted = [name for name, outcome in outcomes.items() if name in _VIEWS and outcome.groups]
    made = plots.pictures(_drawing(outcomes[name], judged) for name in plotted)
    return dict(zip(plotted, made, strict=True))


def _drawing(outcome: Outcome, judged: Sequence[Judged]) -> Drawing:
    """Return the picture of a test; the caption states limits in units other than that of the view."""
    view = _VIEWS[outcome.name]
    limits = [j for j in judged if not j.skipped and j.figure in view.figures]
    figure, caption = view.plot(outcome, sorted({j.limit for j in limits if j.unit == view.unit}))
    words = "; ".join(f"{j.title} {'≥' if j.sense == '>=' else '≤'} {with_unit(j.limit, j.unit)}" for j in limits
                      if j.unit != view.unit)
    return Drawing(outcome.title, figure, f"{caption} Required, not plotted: {words}." if words else caption)


def _limit(axes: Axes, limits: Sequence[float], unit: str, scale: float = 1.0, **more: bool) -> None:
    """Plot required values as lines."""
    for at in limits:
        plots.limits(axes, scale * at, label=f"required {with_unit(at, unit)}", **more, **REQUIRED)


def _steps(outcome: Outcome, limits: Sequence[float]) -> tuple[Figure, str]:
    figure, (panels,) = traces.panels(("fin_angle", "error"), height=2.4, sharex=False)
    angle, error = panels.values()
    for number, group in reversed(list(enumerate(outcome.groups.values()))):
        run = group.data
        begin, command = run.excitation.begin, run.excitation.moves[-1].level
        look: dict[str, Any] = {"color": plots.COLORS[number // 2 % len(plots.COLORS)], "label": group.label,
                                "linestyle": "-" if command > 0.0 else (0, (5, 1.2)), "zero": begin}
        traces.trace(angle, run.columns, "fin_angle", (0.0, begin + 0.4), unit=1e3, **look)
        angle.plot([0.0, 400.0], [degrees(command)] * 2, **LIMIT)
        traces.trace(error, {**run.columns, "error": run.columns["fin_angle"] - command}, "error", (begin, inf),
                     linewidth=1.0, **look)
    _limit(angle, limits, "ms", across=False)
    legend_above(angle, 8)
    angle.set(xlabel="time [ms] from the command", xlim=(-20, 400))
    error.axhspan(-_ACCURACY, _ACCURACY, color=plots.GREEN, alpha=0.10, linewidth=0)
    error.set(xlabel="time [s] from the command", ylabel="angle - command [mdeg]", xlim=(0.0, HOLD),
              ylim=(-2.0 * _ACCURACY, 2.0 * _ACCURACY))
    return figure, ("Above, the first 0.4 s: negative steps are dashed, commands dotted. Below, the remaining "
                    f"error; the green band is the accuracy of Table 2 of Yerlikaya (2016), ±{_ACCURACY:g} mdeg.")


def _bode(outcome: Outcome, limits: Sequence[float]) -> tuple[Figure, str]:
    figure = plots.frequency_responses(
        ((group.data, tuple(nan if sign else float(group.figures[key]) for key, sign in group.bounds.items()),
          {"color": color, "label": group.label})
         for group, color in zip(outcome.groups.values(), plots.COLORS, strict=False)), limits)
    return figure, "Fundamental of fin angle over command, from sweeps. Dots: -3 dB and -90 deg, from sines."


def _slew(outcome: Outcome, limits: Sequence[float]) -> tuple[Figure, str]:
    recorded = outcome.groups["unloaded_positive"].data.columns
    names = [name for name in ("fin_angle", "fin_rate", "motor_current") if name in recorded]
    figure, grid = traces.panels(names, 2, height=1.7, x="time [ms] from the command")
    for panels, direction, sign in zip(grid, ("positive", "negative"), (1.0, -1.0), strict=True):
        for color, load in zip(plots.COLORS, ("unloaded", "opposing", "aiding"), strict=False):
            group = outcome.groups[f"{load}_{direction}"]
            begin = group.data.excitation.begin
            for name, axes in panels.items():
                traces.trace(axes, group.data.columns, name, (begin, begin + 0.35), zero=begin, unit=1e3,
                             color=color, label=group.label.partition(",")[0])
        _limit(panels["fin_rate"], limits, "deg/s", sign)
        panels["fin_angle"].set_title(f"{direction} direction")
        panels["fin_angle"].margins(x=0.0)
    legend_above(figure, 4)  # above a panel it would be wider than the panel
    return figure, "Slews over the full travel in either direction."


def _grid(outcome: Outcome, limits: Sequence[float]) -> tuple[Figure, str]:
    figure, (axes,) = plots.column("angle - command [mdeg]", x="command [deg]", height=2.6)
    group = outcome.groups["grid"]
    command, errors = group.curve["command_deg"], group.data * 1e3
    for side, color, marker, each in zip(("below", "above"), plots.COLORS, "^v", errors, strict=False):
        axes.plot(command, group.curve[f"error_from_{side}_deg"] * 1e3, color=color, linewidth=1.0,
                  label=f"approached from {side}, mean")
        axes.plot(np.repeat(command, each.shape[1]), each.ravel(), linestyle="none", marker=marker, markersize=3.5,
                  color=color, alpha=0.6)
    axes.axhline(0.0, **LIMIT)
    view = axes.get_ylim()
    _limit(axes, limits, "deg", 1e3, sides=True)
    if max(limits, default=0.0) > 4e-3 * np.nanmax(np.abs(errors)):
        axes.set_ylim(view)  # a limit far beyond the errors would flatten their curves
    legend_above(axes)
    return figure, "Errors of all approaches (marks) and their means (lines), in thousandths of a degree."


def _budget(outcome: Outcome, _: Sequence[float]) -> tuple[Figure, str]:
    rows = [(name, group) for name, group in outcome.groups.items() if name != "required"][::-1]
    figure, grid = plots.figure(1, height=0.3 * len(rows) + 0.7, x="error of the fin angle [deg]")
    axes, at = grid[0][0], np.arange(len(rows))
    for q, color, shift in zip(outcome.quantities, plots.COLORS, (0.2, -0.2), strict=False):
        axes.barh(at + shift, [group.figures[q.key] for _, group in rows], 0.38, color=color, label=q.label)
        plots.limits(axes, outcome.groups["required"].figures[q.key], across=False, **{**REQUIRED, "color": color})
    axes.set_yticks(at, [group.label for _, group in rows])
    axes.grid(visible=False, axis="y")
    axes.margins(y=0.01)
    axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=2)
    return figure, "The terms, and below them the sums, samples and the article as set. Dotted lines: required values."


def _stiffness(outcome: Outcome, limits: Sequence[float]) -> tuple[Figure, str]:
    figure, (size, phase) = plots.column("|T/θ| [N.m/rad]", "phase [deg]", height=2.2, height_ratios=(1.5, 1.0))
    for color, group in zip(plots.COLORS, (each for each in outcome.groups.values() if each.curve), strict=False):
        look = {"color": color, "marker": "o", "markersize": 3.5,
                "label": f"{group.label}, {group.figures['load_amplitude_n_m']:.3g} N.m"}
        size.loglog(group.curve["frequency_hz"], group.curve["stiffness_n_m_per_rad"], **look)
        phase.semilogx(group.curve["frequency_hz"], group.curve["phase_deg"], **look)
    if outcome.curves:
        legend_above(size, 3)
    phase.set(ylim=(-190, 190), yticks=(-180, -90, 0, 90, 180))
    plots.frequency_axis(phase, (1, 2, 5, 10, 20, 40))
    return figure, ("Hinge moment over fin angle. 0 deg is a spring; +90 deg a damper; ±180 deg an inertia, whose line "
                    "rises with the square of the frequency.")


def _mission(outcome: Outcome, limits: Sequence[float]) -> tuple[Figure, str]:
    (group,) = outcome.groups.values()
    inputs = {LOAD: np.zeros(len(group.data.columns["time"])), **group.data.excitation.columns}
    columns = {**inputs, **group.data.columns}
    colors = {"fin_angle": plots.BLUE, LOAD: plots.PURPLE, "motor_current": plots.VERMILLION,
              "supply_power": plots.GREEN}
    figure, (panels,) = traces.panels([name for name in colors if name in columns], height=1.5, x="time [s]")
    for name, axes in panels.items():
        traces.trace(axes, columns, name, color=colors[name], label="fin angle",
                     linewidth=1.3 if name == "fin_angle" else 0.8)
        axes.margins(x=0.0)
    traces.trace(panels["fin_angle"], columns, COMMAND)
    legend_above(panels["fin_angle"])
    if "supply_power" not in panels:
        return figure, ""
    panels["supply_power"].axhline(0.0, **LIMIT)
    return figure, "Power below zero is fed back to the supply."


class _View(NamedTuple):
    """How a test is plotted; required values of `figures` are lines if they are in `unit`, otherwise in the caption."""

    plot: Callable[[Outcome, Sequence[float]], tuple[Figure, str]]
    unit: str = ""
    figures: tuple[str, ...] = ()


_VIEWS: Mapping[str, _View] = {
    "step_response": _View(_steps, "ms", ("settling_time", "overshoot")),
    "frequency_response": _View(_bode, "Hz", ("bandwidth_3db",)),
    "slew_rate": _View(_slew, "deg/s", ("sustained_rate",)),
    "static_accuracy": _View(_grid, "deg", ("held_error",)),
    "accuracy_budget": _View(_budget), "dynamic_stiffness": _View(_stiffness), "mission": _View(_mission)}
