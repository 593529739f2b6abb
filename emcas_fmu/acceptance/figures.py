"""The pictures of an acceptance report, one for a test."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from .. import plots
from ..validation.requirements import ACCURACY
from . import frequency, mission, slewing, static_accuracy, steps, stiffness
from .bench import HOLD
from .outcome import Array, Outcome

_LIMIT: dict[str, Any] = {"color": plots.GRAY, "linewidth": 0.9, "linestyle": (0, (1, 1.2)), "zorder": 1.5}
_COMMAND: dict[str, Any] = {"color": plots.GRAY, "linewidth": 1.0, "linestyle": (0, (4, 2)), "zorder": 1.5}
_MOST_POINTS = 3000  # of a line: more than a page has pixels

Drawing = tuple[Figure, str]
"""Figure and caption."""


def picture(outcome: Outcome) -> tuple[str, str] | None:
    """Inline SVG and caption of a test's picture; None where it has none."""
    draw = _DRAWINGS.get(outcome.name)
    if draw is None or outcome.stopped:
        return None
    with plots.style():
        made, caption = draw(outcome)
        return plots.svg(made, outcome.title), caption


def _thin(*columns: Array) -> list[Array]:
    stride = max(len(columns[0]) // _MOST_POINTS, 1)
    return [column[::stride] for column in columns]


def _legend(axes: Axes, columns: int = 6) -> None:
    """Above the panel, where it cannot hide anything."""
    axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=columns, borderaxespad=0.2, handlelength=1.8,
                columnspacing=1.4)


def _steps(outcome: Outcome) -> Drawing:
    made, grid = plots.figure(2, height=2.4, sharex=False)
    angle, error = grid[:, 0]
    pairs = list(outcome.series.items())
    for number, (group, series) in enumerate(reversed(pairs)):
        color = plots.COLORS[(len(pairs) - 1 - number) // 2 % len(plots.COLORS)]
        size = float(series["command_deg"][0])
        look: dict[str, Any] = {"color": color, "linestyle": "-" if size > 0.0 else (0, (5, 1.2))}
        label = outcome.label(group)
        time = series["time_s"]
        near = time <= 0.4
        angle.plot(time[near] * 1e3, series["angle_deg"][near], label=label, **look)
        angle.plot([0.0, 400.0], [size, size], **_LIMIT)
        far = time >= 0.0
        error.plot(*_thin(time[far], series["angle_deg"][far] - size), **{**look, "linewidth": 1.0})
    _legend(angle, 8)
    angle.set(ylabel="fin angle / deg", xlabel="time from the command / ms", xlim=(-20, 400))
    error.axhspan(-ACCURACY, ACCURACY, color=plots.GREEN, alpha=0.10, linewidth=0)
    error.set(ylabel="angle - command / deg", xlabel="time from the command / s", ylim=(-2 * ACCURACY, 2 * ACCURACY),
              xlim=(0.0, HOLD))
    return made, ("Above, the first 0.4 s; negative steps dashed, dotted lines the commands. Below, what is left of "
                  f"the error; the green band is the accuracy of Table 2, ±{ACCURACY:g} deg.")


def _bode(outcome: Outcome) -> Drawing:
    made, grid = plots.figure(3, height=1.9, sharex=True, height_ratios=(1.3, 1.3, 0.8))
    gain, phase, coherence = grid[:, 0]
    for color, (group, curve) in zip(plots.COLORS, outcome.curves.items(), strict=False):
        look = {"color": color, "label": outcome.label(group)}
        found = outcome.figures[group]
        gain.semilogx(curve["frequency_hz"], curve["gain_db"], **look)
        phase.semilogx(curve["frequency_hz"], curve["phase_deg"], **look)
        coherence.semilogx(curve["frequency_hz"], curve["coherence"], **look)
        gain.plot(found["bandwidth_3db_hz"], -3.0, "o", color=color, markersize=5, zorder=4)
        phase.plot(found["bandwidth_90deg_hz"], -90.0, "o", color=color, markersize=5, zorder=4)
    gain.axhline(-3.0, **_LIMIT)
    phase.axhline(-90.0, **_LIMIT)
    _legend(gain)
    gain.set(ylabel="gain / dB", ylim=(-12, 3))
    phase.set(ylabel="phase / deg", ylim=(-200, 10), yticks=(-180, -135, -90, -45, 0))
    ticks = (0.5, 1, 2, 5, 10, 20)
    coherence.set(ylabel="coherence", ylim=(0.0, 1.05), xlabel="frequency / Hz", xticks=ticks,
                  xticklabels=[f"{tick:g}" for tick in ticks])
    for axes in grid[:, 0]:
        axes.minorticks_off()
        axes.margins(x=0.0)
    return made, "Fundamental of fin angle over command; the dots mark -3 dB and -90 deg."


def _slew(outcome: Outcome) -> Drawing:
    made, grid = plots.figure(3, 2, height=1.7, sharex=True, sharey="row")
    for column, direction in enumerate(("positive", "negative")):
        for color, load in zip(plots.COLORS, ("unloaded", "opposing", "aiding"), strict=False):
            series = outcome.series[f"{load}_{direction}"]
            near = series["time_s"] <= 0.35
            for axes, name in zip(grid[:, column], ("angle_deg", "rate_deg_per_s", "current_a"), strict=True):
                axes.plot(series["time_s"][near] * 1e3, series[name][near], color=color,
                          label=outcome.label(f"{load}_{direction}").partition(",")[0])
        grid[0, column].set_title(f"{direction} direction", pad=16)
        _legend(grid[0, column], 3)
        grid[-1, column].set_xlabel("time from the command / ms")
        grid[0, column].margins(x=0.0)
    for axes, label in zip(grid[:, 0], ("fin angle / deg", "fin rate / deg/s", "current / A"), strict=True):
        axes.set_ylabel(label)
    return made, "Full travel in either direction."


def _grid(outcome: Outcome) -> Drawing:
    made, grid = plots.figure(1, height=2.6)
    axes = grid[0, 0]
    curve = outcome.curves["grid"]
    for name, color, marker in (("below", plots.BLUE, "^"), ("above", plots.VERMILLION, "v")):
        errors = outcome.series[name]["errors_deg"] * 1e3
        axes.plot(curve["command_deg"], curve[f"error_from_{name}_deg"] * 1e3, color=color, linewidth=1.0,
                  label=f"approached from {name}, mean")
        axes.plot(np.repeat(curve["command_deg"], errors.shape[1]), errors.ravel(), linestyle="none", marker=marker,
                  markersize=3.5, color=color, alpha=0.6)
    axes.axhline(0.0, **_LIMIT)
    _legend(axes)
    axes.set(xlabel="command / deg", ylabel="angle - command / mdeg")
    return made, "Every approach (marks) and their means (lines), in thousandths of a degree."


def _stiffness(outcome: Outcome) -> Drawing:
    made, grid = plots.figure(2, height=2.2, sharex=True, height_ratios=(1.5, 1.0))
    size, phase = grid[:, 0]
    for color, (group, curve) in zip(plots.COLORS, outcome.curves.items(), strict=False):
        label = f"{outcome.label(group)}, {outcome.figures[group]['load_amplitude_n_m']:.3g} N.m"
        size.loglog(curve["frequency_hz"], curve["stiffness_n_m_per_rad"], color=color, marker="o", markersize=3.5,
                    label=label)
        phase.semilogx(curve["frequency_hz"], curve["phase_deg"], color=color, marker="o", markersize=3.5)
    if outcome.curves:
        _legend(size, 3)
    ticks = (1, 2, 5, 10, 20, 40)
    size.set_ylabel("|T/θ| / N.m/rad")
    phase.set(ylabel="phase / deg", xlabel="frequency / Hz", xticks=ticks, xticklabels=[f"{t:g}" for t in ticks],
              ylim=(-190, 190), yticks=(-180, -90, 0, 90, 180))
    phase.minorticks_off()
    return made, ("Hinge moment over fin angle. 0 deg is a spring; +90 deg a damper; ±180 deg an inertia, whose line "
                  "rises with the square of the frequency.")


def _mission(outcome: Outcome) -> Drawing:
    made, grid = plots.figure(4, height=1.5, sharex=True)
    angle, moment, current, power = grid[:, 0]
    (series,) = outcome.series.values()
    time, command, actual, load, amperes, watts = _thin(*(series[name] for name in (
        "time_s", "command_deg", "angle_deg", "moment_n_m", "current_a", "power_w")))
    angle.plot(time, actual, color=plots.BLUE, label="fin angle")
    angle.plot(time, command, label="command", **_COMMAND)
    _legend(angle)
    moment.plot(time, load, color=plots.PURPLE)
    current.plot(time, amperes, color=plots.VERMILLION, linewidth=0.8)
    power.plot(time, watts, color=plots.GREEN, linewidth=0.8)
    power.axhline(0.0, **_LIMIT)
    for axes, label in zip(grid[:, 0], ("angle / deg", "moment / N.m", "current / A", "power / W"), strict=True):
        axes.set_ylabel(label)
        axes.margins(x=0.0)
    power.set_xlabel("time / s")
    return made, "Power below zero is fed back to the bus."


_DRAWINGS: Mapping[str, Callable[[Outcome], Drawing]] = {
    steps.NAME: _steps, frequency.NAME: _bode, slewing.NAME: _slew, static_accuracy.NAME: _grid,
    stiffness.NAME: _stiffness, mission.NAME: _mission,
}
