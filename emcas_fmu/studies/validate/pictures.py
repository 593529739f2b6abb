"""The pictures of a validation, of the cases that ran to their end."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from math import degrees
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from ...bench import metrics
from ...bench.excitation import Excitation
from ...bench.frequency_response import SWEPT, FrequencyResponse, sweep_response
from ...bench.references import EMBEDDED
from ...figures import plots
from ...figures.plots import COMMAND, LIMIT, Drawing
from ...reference.linear import LinearModel
from .validation import DISPLAY, TRAJECTORY_LIMIT, CaseResult, Result

_DEG = 180.0 / np.pi
_DOTS: dict[str, Any] = {"linestyle": "none", "marker": "o", "markersize": 2.6, "markerfacecolor": "none",
                         "markeredgewidth": 0.6}
# Panels of a run, from above.
_PANELS = {"fin_angle": "fin angle [deg]", "fin_rate": "fin rate [deg/s]", "drive_reference": "DAC [V]",
           "motor_current": "current [A]", "motor_voltage": "voltage [V]"}
# Parameters a variable is limited by.
_LIMITED = {"drive_reference": "drive.reference_limit", "motor_current": "drive.current_limit",
            "motor_voltage": "drive.supply_voltage"}
_SIZES = (1, 5, 10, 20)  # deg, of the plotted steps


def drawings(result: Result) -> Iterator[Drawing]:
    """Yield every picture for which the result has the runs."""
    complete = {name for name, series in result.series.items() if series.run.stopped is None}
    if sizes := [size for size in _SIZES if {f"step_plus{size}", f"step_minus{size}"} <= complete]:
        yield steps(result, sizes)
    if sweeps := [name for name in ("chirp_1deg", "chirp_3p5deg") if name in complete]:
        yield chirp_time(result, sweeps)
        yield bode(result, sweeps)
    if "step_plus20" in complete:
        yield slew(result)
    if {"load_opposing", "load_aiding"} <= complete:
        yield loaded(result)
    if "square" in complete:
        yield _one_case(result, "square", "Modified square wave", plots.BLUE,
                        "Levels of 5, 10, 15 and 20 deg, edges at 400 deg/s.", dots=30)
    if "cold" in complete:
        yield _one_case(result, "cold", "Cold", plots.SKY, "Steps at -6 degC, where friction is higher than the "
                        "controller compensates for.", dots=15)
    if "sag" in complete:
        yield sag(result)
    for case in result.cases:
        if case.name in complete and case.case.kind == EMBEDDED:
            yield _one_case(result, case.name, "Inside the FMU", plots.BLUE, f"{case.case.title}.", dots=10)
    if result.linear_series:
        yield linear(result)


def window(time: Any, begin: float, end: float) -> Any:
    """Return whether each time [s] is between two."""
    return (time >= begin - 1e-9) & (time <= end + 1e-9)


def _line(axes: Axes, result: Result, series: CaseResult, name: str, dots: int, color: str, label: str,
          begin: float = 0.0, end: float = np.inf) -> None:
    """Plot one output over time [ms], and every `dots`-th point of the reference, where there is one."""
    columns, scale = series.judged.columns, DISPLAY[name][0]
    at = window(columns["time"], begin, end)
    axes.plot(columns["time"][at] * 1e3, columns[name][at] * scale, color=color, label=label)
    if name in series.reference:
        time = series.reference["time"]
        inside = np.flatnonzero((time >= begin) & (time <= end))[::dots]
        axes.plot(time[inside] * 1e3, series.reference[name][inside] * scale, color=plots.INK, **_DOTS,
                  label="independent reference" if result.independent else "recorded response")


def _command(axes: Axes, excitation: Excitation, begin: float = 0.0, end: float = np.inf) -> None:
    at = window(excitation.time, begin, end)
    axes.step(excitation.time[at] * 1e3, excitation.command[at] * _DEG, where="post", label="command", **COMMAND)


def _angles(result: Result, cases: Mapping[str, Mapping[str, Any]], dots: int, height: float) -> tuple[Any, Any, Any]:
    """Return a figure with the fin angles of `cases`, and its panels of angles and of errors to the reference.

    `cases` has the look of each. Without any reference there is one panel, which is returned twice.
    """
    if any(result.series[name].reference for name in cases):
        figure, (angle, error) = plots.column("fin angle [deg]", "error [mdeg]", x="time [ms]", height=height,
                                              height_ratios=(2.1, 1.0))
        error.axhspan(-TRAJECTORY_LIMIT * 1e3, TRAJECTORY_LIMIT * 1e3, color=plots.GREEN, alpha=0.10, linewidth=0)
    else:
        figure, (angle,) = plots.column("fin angle [deg]", x="time [ms]", height=1.4 * height)
        error = angle
    for name, look in cases.items():
        series = result.series[name]
        _command(angle, series.run.excitation)
        _line(angle, result, series, "fin_angle", dots, look["color"], look["label"])
        if series.reference:
            response, reference = series.compared("fin_angle")
            error.plot(series.compared("time")[0] * 1e3, (response - reference) * _DEG * 1e3, linewidth=0.9, **look)
    plots.legend_above(angle)
    return figure, angle, error


def steps(result: Result, sizes: Sequence[int]) -> Drawing:
    """Draw the steps of `sizes` [deg], and their errors to the reference."""
    colors, lines = dict(zip(_SIZES, plots.COLORS, strict=False)), {"plus": "-", "minus": (0, (5, 1.2))}
    figure, angle, error = _angles(result, {
        f"step_{sign}{size}": {"color": colors[size], "linestyle": line, "label": f"±{size} deg"}
        for size in reversed(sizes) for sign, line in lines.items()}, 12, 2.5)
    angle.set(yticks=(-20, -10, -5, -1, 1, 5, 10, 20))
    error.set(xlim=(0, 500))
    below = (" Below, fin angle minus reference in thousandths of a degree, negative steps dashed; the green band is "
             "what the trajectory criterion allows.")
    return Drawing("Steps", figure, "Steps of ±1, ±5, ±10 and ±20 deg at 50 ms." + below * (error is not angle))


def chirp_time(result: Result, names: Sequence[str]) -> Drawing:
    """Draw the sweeps over time: whole, and two looks closer."""
    figure, grid = plots.figure(len(names), 3, height=2.1, width_ratios=(2.2, 1, 1), sharey="row", x="time [s]",
                                y=["fin angle [deg]"] * len(names))
    for row, name, color in zip(grid, names, (plots.BLUE, plots.VERMILLION), strict=False):
        run = result.series[name].run
        command = run.excitation.command * _DEG
        for axes, (begin, end) in zip(row, ((0.0, 12.0), (4.0, 5.2), (9.0, 9.4)), strict=True):
            close = end < 12.0
            at = window(run.columns["time"], begin, end)
            time = run.columns["time"][at]
            axes.plot(time, command[at], label="command",
                      **{**COMMAND, "linewidth": 1.0 if close else 0.5, "linestyle": "-"})
            axes.plot(time, run.columns["fin_angle"][at] * _DEG, color=color, linewidth=1.2 if close else 0.5,
                      label=f"{np.max(np.abs(command)):.1f} deg")
            axes.set_xlim(begin, min(end, float(run.excitation.time[-1])))
        plots.legend_above(row[0])
    return Drawing("Sine sweeps", figure,
                   "Logarithmic sweeps from 0.5 to 30 Hz; on the right about 2 to 3 Hz, and 11 Hz.")


def bode(result: Result, names: Sequence[str]) -> Drawing:
    """Draw gain and phase of the sweeps beside the linear model's, where there is one."""
    figure, (gain, phase) = plots.column("", "", height=2.6)
    curves: list[tuple[FrequencyResponse, str, str, Any]] = [
        (sweep_response(result.series[name].run), f"{name[6:-3].replace('p', '.')} deg", color, "-")
        for name, color in zip(names, (plots.BLUE, plots.VERMILLION), strict=False)]
    if result.linear_series:
        frequency = np.geomspace(*SWEPT, 300)
        response = LinearModel(result.parameters).frequency_response(frequency)
        model = FrequencyResponse(frequency, np.abs(response), np.unwrap(np.angle(response)), np.ones(300))
        curves.insert(0, (model, "linear model", plots.GREEN, (0, (5, 1.5))))
    for curve, label, color, line in curves:
        plots.bode(gain, phase, curve.frequency, curve.gain_db, np.degrees(curve.phase),
                   (curve.bandwidth, curve.phase_bandwidth), color=color, linestyle=line, label=label)
    marks = [f"{label}: {curve.bandwidths}" for curve, label, _, _ in curves]
    plots.bode_axes(gain, phase)
    for axes in (gain, phase):
        plots.limits(axes, 10.0, across=False, label="-3 dB, -90 deg; 10 Hz required")
    plots.legend_above(gain)
    phase.set_xlim(SWEPT)
    plots.frequency_axis(phase, (0.5, 1, 2, 5, 10, 20))
    gain.minorticks_off()
    # The jump is no artefact: steady sines of 3.5 deg, with the defaults, lag 81 deg at 13.5 Hz and 105 deg at 14 Hz.
    return Drawing(
        "Frequency response", figure, "Fundamental of fin angle over command, from the sweeps: " + "; ".join(marks)
        + ". Where a large amplitude meets the rate limit its response jumps to a larger lag; "
        "within about 1 Hz of the jump the estimate is smeared, by up to 0.7 dB.")


def _inside(result: Result, cases: Mapping[str, tuple[str, str]], begin: float, end: float, dots: int,
            height: float, without: str = "") -> tuple[Any, Any]:
    """Return a figure of the outputs over time, and its panels (output, case).

    `cases` has the color and the label of each; an output `without` is left out. Limits are lines, and the time is
    shaded where one is active.
    """
    recorded = result.series[next(iter(cases))].run.columns
    outputs = [name for name in _PANELS if name in recorded and name != without]
    figure, grid = plots.figure(len(outputs), len(cases), height=height, sharex=True, sharey="row", x="time [ms]",
                                y=[_PANELS[name] for name in outputs])
    for column, (case, (color, label)) in zip(grid.T, cases.items(), strict=True):
        series = result.series[case]
        columns, excitation = series.judged.columns, series.run.excitation
        at, rows = window(columns["time"], begin, end), window(excitation.time, begin, end)
        for axes, name in zip(column, outputs, strict=True):
            plots.shade(axes, columns["time"][at] * 1e3, columns["saturated"][at] > 0.5, "a limit is active")
            _line(axes, result, series, name, dots, color, label, begin, end)
            if name == "fin_angle":
                _command(axes, excitation, begin, end)
            elif name == "motor_voltage" and "supply_voltage" in excitation.columns:
                supply = excitation.columns["supply_voltage"][rows]
                for limit in (supply, -supply):
                    axes.step(excitation.time[rows] * 1e3, limit, where="post", label="limit", **LIMIT)
            elif (parameter := _LIMITED.get(name, "")) in result.parameters:
                plots.limits(axes, result.parameters[parameter], sides=True, label="limit")
            axes.set_xlim(begin * 1e3, end * 1e3)
    return figure, grid


def slew(result: Result) -> Drawing:
    """Draw the outputs during the largest step."""
    figure, grid = _inside(result, {"step_plus20": (plots.BLUE, "fin")}, 0.04, 0.2, 4, 1.55)
    plots.limits(grid[1, 0], 220.0, color=plots.GREEN, label="220 deg/s required")
    plots.legend_above(figure)
    rate = metrics.motion(result.series["step_plus20"].run)
    return Drawing(
        "Rate and saturation", figure, f"A step to 20 deg: {degrees(rate['peak_rate']):.0f} deg/s at the peak, "
        f"{degrees(rate['sustained_rate']):.0f} deg/s in the mean over the middle 60 % of the travel. A limit that is "
        "active while what is drawn is within its limits is that of the speed reference.")


def loaded(result: Result) -> Drawing:
    """Draw the slews against and with 100 N.m."""
    figure, grid = _inside(result, {"load_opposing": (plots.BLUE, "against 100 N.m"),
                                       "load_aiding": (plots.VERMILLION, "with 100 N.m")},
                              0.3, 0.75, 12, 1.7, without="drive_reference")
    plots.legend_above(figure)
    plots.limits(grid[1, 0], 200.0, color=plots.GREEN)
    grid[1, 0].text(745, 200.0, "200 deg/s required", fontsize=7, ha="right", va="bottom")
    against, along = (degrees(metrics.motion(result.series[name].run, 1)["sustained_rate"])
                      for name in ("load_opposing", "load_aiding"))
    return Drawing(
        "Loaded slews", figure, "From -20 to +20 deg at 350 ms while 100 N.m come on within 20 ms. Mean rate over the "
        f"middle 60 % of the travel: {against:.0f} deg/s against the load, {along:.0f} deg/s with it. The error the "
        "load leaves decays with the integral action of the position loop, where there is one.")


def _one_case(result: Result, name: str, title: str, color: str, caption: str, dots: int) -> Drawing:
    """Draw the fin angle of a case, and its error to the reference."""
    figure, angle, error = _angles(result, {name: {"color": color, "label": "fin"}}, dots, 2.0)
    error.set(xlim=(0, float(result.series[name].run.excitation.time[-1]) * 1e3))
    return Drawing(title, figure, caption + " Below, fin angle minus reference." * (error is not angle))


def sag(result: Result) -> Drawing:
    """Draw a slew during which the supply sags."""
    figure, _ = _inside(result, {"sag": (plots.ORANGE, "fin")}, 0.3, 0.699, 8, 1.6, without="drive_reference")
    plots.legend_above(figure)
    shipped = result.of_thesis and not result.differences
    brakes = ", below the back-EMF of the shipped motor at that speed, which then brakes" if shipped else ""
    supply = result.series["sag"].run.excitation.columns["supply_voltage"]
    return Drawing("Supply sag", figure, "A slew from +20 to -20 deg at 350 ms; from 400 to 470 ms the supply is down "
                   f"from {supply[0]:.3g} to {np.min(supply):.3g} V{brakes}.")


def linear(result: Result) -> Drawing:
    """Draw normalised steps beside the linear model's."""
    figure, (response, difference) = plots.column("fin angle / command", "difference [%]", x="time [ms]", height=2.4,
                                                  height_ratios=(2.0, 1.0))
    for (amplitude, (run, angle)), color in zip(result.linear_series.items(), plots.COLORS, strict=False):
        time = run.columns["time"]
        share = run.columns["fin_angle"] * _DEG / amplitude
        expected = angle[:len(time)] * _DEG / amplitude
        look = {"color": color, "label": f"{amplitude:g} deg"}
        response.plot(time * 1e3, share, **look)
        difference.plot(time * 1e3, 100.0 * (share - expected), linewidth=1.0, **look)
        drawn_linear = (time * 1e3, expected)
    response.plot(*drawn_linear, color=plots.INK, linestyle=(0, (5, 1.5)), linewidth=1.0,
                  label="linear model, any step")
    plots.legend_above(response)
    difference.set(xlim=(40, 200))
    return Drawing(
        "Linear and nonlinear", figure, "Steps divided by their size. The linear model's response is the same for all; "
        "this model has quantisation and friction, which show in the small, and limits, which show in the large.")
