"""The pictures of a validation; each function gives nothing where a run it needs was not made."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from math import degrees
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from ... import plots
from ...bench import metrics
from ...plots import COMMAND, LIMIT, Drawing
from ...reference.linear import LinearModel
from .study import TRAJECTORY_LIMIT, Result, Series, window

_DEG = 180.0 / np.pi
_DOTS: dict[str, Any] = {"linestyle": "none", "marker": "o", "markersize": 2.6, "markerfacecolor": "none",
                         "markeredgewidth": 0.6}
# name, scale, label; in the order of the panels
_PANELS = (("fin_angle", _DEG, "fin angle / deg"), ("fin_rate", _DEG, "fin rate / deg/s"),
           ("drive_reference", 1.0, "DAC / V"), ("motor_current", 1.0, "current / A"),
           ("motor_voltage", 1.0, "voltage / V"))
_COMMAND_ENTRY = ("command", COMMAND)
# Parameters a variable is limited by.
_LIMITED = {"drive_reference": "drive.reference_limit", "motor_current": "drive.current_limit",
            "motor_voltage": "drive.supply_voltage"}
_SHADE_ENTRY = ("a limit is active", {"color": plots.GRAY, "alpha": 0.3, "linewidth": 7})
_LIMIT_ENTRY = ("limit", LIMIT)
_REQUIRED: Mapping[str, Any] = {**LIMIT, "color": plots.GREEN}


def drawings(result: Result) -> Iterator[Drawing | None]:
    """Every picture the result has the runs for."""
    for draw in (steps, chirp_time, bode, slew, loaded, square, cold, sag, linear):
        yield draw(result)


def _have(result: Result, *names: str) -> bool:
    return all(name in result.series and result.series[name].run.stopped is None for name in names)


def _line(axes: Axes, series: Series, name: str, scale: float, *, begin: float = 0.0, end: float = np.inf,
          dots: int = 0, **more: Any) -> None:
    """One variable over time [ms]; every `dots`-th point of the reference on it, and then the run it is of."""
    columns = (series.exact if dots and series.exact else series.run).columns
    at = window(columns, begin, end)
    axes.plot(columns["time"][at] * 1e3, columns[name][at] * scale, **more)
    if dots and name in series.reference:
        time = series.reference["time"]
        inside = np.flatnonzero((time >= begin) & (time <= end))[::dots]
        axes.plot(time[inside] * 1e3, series.reference[name][inside] * scale, color=plots.INK, **_DOTS)


def _command(axes: Axes, series: Series, begin: float = 0.0, end: float = np.inf, **more: Any) -> None:
    made = series.run.excitation
    at = window({"time": made.time}, begin, end)
    axes.step(made.time[at] * 1e3, made.command[at] * _DEG, where="post", **{**COMMAND, **more})


def _error(axes: Axes, series: Series, **look: Any) -> None:
    """Fin angle minus reference [mdeg] over time [ms], where there is a reference."""
    if series.exact:
        run = series.exact.columns
        rows = min(len(run["time"]), len(series.reference["time"]))
        difference = (run["fin_angle"][:rows] - series.reference["fin_angle"][:rows]) * _DEG * 1e3
        axes.plot(run["time"][:rows] * 1e3, difference, **look)


def _error_panel(axes: Axes) -> None:
    axes.set_ylabel("error / mdeg")
    axes.axhspan(-TRAJECTORY_LIMIT * 1e3, TRAJECTORY_LIMIT * 1e3, color=plots.GREEN, alpha=0.10, linewidth=0)


def _angle_panels(result: Result, height: float) -> Any:
    """A panel of angles, and where there is a reference one of errors below."""
    if result.reference:
        figure, grid = plots.figure(2, height=height, sharex=True, height_ratios=(2.1, 1.0))
        _error_panel(grid[1, 0])
    else:
        figure, grid = plots.figure(1, height=1.4 * height)
    grid[-1, 0].set_xlabel("time / ms")
    return figure, grid[0, 0], grid[-1, 0]


def _legend(axes: Axes, *entries: tuple[str, Mapping[str, Any]], columns: int = 6) -> None:
    handles = [axes.plot([], [], label=label, **look)[0] for label, look in entries]
    plots.legend_above(axes, columns, handles=handles)


def _reference(result: Result) -> tuple[tuple[str, Mapping[str, Any]], ...]:
    return (("independent reference", {"color": plots.INK, **_DOTS}),) if result.reference else ()


def _limits(axes: Axes, value: Any, time: Any = None) -> None:
    for sign in (1.0, -1.0):
        if time is None:
            axes.axhline(sign * value, **LIMIT)
        else:
            axes.step(time, sign * value, where="post", **LIMIT)


def steps(result: Result) -> Drawing | None:
    """The step family, and its error to the reference."""
    sizes = [size for size in (1, 5, 10, 20) if _have(result, f"step_plus{size}", f"step_minus{size}")]
    if not sizes:
        return None
    figure, angle, error = _angle_panels(result, 2.5)
    colors = dict(zip((1, 5, 10, 20), plots.COLORS, strict=False))
    for size in reversed(sizes):
        for sign, line in (("plus", "-"), ("minus", (0, (5, 1.2)))):
            series = result.series[f"step_{sign}{size}"]
            _command(angle, series)
            _line(angle, series, "fin_angle", _DEG, dots=12, color=colors[size])
            _error(error, series, color=colors[size], linestyle=line, linewidth=0.9)
    _legend(angle, *((f"±{size} deg", {"color": colors[size]}) for size in sizes), _COMMAND_ENTRY, *_reference(result))
    angle.set(ylabel="fin angle / deg", yticks=(-20, -10, -5, -1, 1, 5, 10, 20))
    error.set(xlim=(0, 500))
    below = (" Below, fin angle minus reference in thousandths of a degree, negative steps dashed; the green band is "
             "what the trajectory criterion allows.")
    return Drawing("Steps", figure, "Steps of ±1, ±5, ±10 and ±20 deg at 50 ms." + (below if result.reference else ""))


def chirp_time(result: Result) -> Drawing | None:
    """The sweeps over time: whole, and two looks closer."""
    names = [name for name in ("chirp_1deg", "chirp_3p5deg") if _have(result, name)]
    if not names:
        return None
    figure, grid = plots.figure(len(names), 3, width=9.0, height=2.1, width_ratios=(2.2, 1, 1), sharey="row")
    for row, name, color in zip(grid, names, (plots.BLUE, plots.VERMILLION), strict=False):
        series = result.series[name]
        for axes, (begin, end) in zip(row, ((0.0, 12.0), (4.0, 5.2), (9.0, 9.4)), strict=True):
            close = end < 12.0
            at = window(series.run.columns, begin, end)
            time = series.run.columns["time"][at]
            command = series.run.excitation.command[:len(at)][at] * _DEG
            axes.plot(time, command, **{**COMMAND, "linewidth": 1.0 if close else 0.5, "linestyle": "-"})
            axes.plot(time, series.run.columns["fin_angle"][at] * _DEG, color=color, linewidth=1.2 if close else 0.5)
            axes.set_xlim(begin, min(end, float(series.run.excitation.time[-1])))
        amplitude = float(np.max(np.abs(series.run.excitation.command))) * _DEG
        row[0].set_ylabel("fin angle / deg")
        _legend(row[0], ("command", {**COMMAND, "linestyle": "-"}), (f"{amplitude:.1f} deg", {"color": color}))
    for axes in grid[-1]:
        axes.set_xlabel("time / s")
    return Drawing("Sine sweeps", figure,
                   "Logarithmic sweeps from 0.5 to 30 Hz; on the right about 2 to 3 Hz, and 11 Hz.")


def bode(result: Result) -> Drawing | None:
    """Gain and phase of both amplitudes beside the linear model's, where there is one."""
    names = [name for name in ("chirp_1deg", "chirp_3p5deg") if _have(result, name)]
    if not names:
        return None
    figure, grid = plots.figure(2, height=2.6, sharex=True)
    gain, phase = grid[:, 0]
    frequency = np.geomspace(*metrics.SWEPT, 300)
    labels = [f"{name[6:-3].replace('p', '.')} deg" for name in names]
    curves: list[tuple[metrics.FrequencyResponse, str, str, Any]] = [
        (metrics.sweep_response(result.series[name].run), label, color, "-")
        for name, label, color in zip(names, labels, (plots.BLUE, plots.VERMILLION), strict=False)]
    if result.linear_series:
        response = LinearModel(result.parameters).frequency_response(frequency)
        model = metrics.FrequencyResponse(frequency, np.abs(response), np.unwrap(np.angle(response)), np.ones(300))
        curves.insert(0, (model, "linear model", plots.GREEN, (0, (5, 1.5))))
    entries = []
    marks: list[str] = []
    for curve, label, color, line in curves:
        look: dict[str, Any] = {"color": color, "linestyle": line}
        gain.semilogx(curve.frequency, curve.gain_db, **look)
        phase.semilogx(curve.frequency, np.degrees(curve.phase), **look)
        for axes, at, level in ((gain, curve.bandwidth, -3.0), (phase, curve.phase_bandwidth, -90.0)):
            axes.plot(at, level, "o", color=color, markersize=5, zorder=4)
        marks.append(f"{label}: -3 dB at {curve.bandwidth:.1f} Hz, -90 deg at {curve.phase_bandwidth:.1f} Hz")
        entries.append((label, look))
    gain.axhline(-3.0, **LIMIT)
    phase.axhline(-90.0, **LIMIT)
    for axes in (gain, phase):
        axes.axvline(10.0, **LIMIT)
    _legend(gain, *entries, ("-3 dB, -90 deg; 10 Hz required", LIMIT))
    gain.set(ylabel="gain / dB", ylim=(-12, 3))
    phase.set(ylabel="phase / deg", xlabel="frequency / Hz", ylim=(-200, 10), yticks=(-180, -135, -90, -45, 0),
              xlim=metrics.SWEPT, xticks=(0.5, 1, 2, 5, 10, 20), xticklabels=("0.5", "1", "2", "5", "10", "20"))
    phase.minorticks_off()
    gain.minorticks_off()
    # The jump is no artefact: steady sines of 3.5 deg, with the defaults, lag 81 deg at 13.5 Hz and 105 deg at 14 Hz.
    return Drawing(
        "Frequency response", figure, "Fundamental of fin angle over command, from the sweeps: " + "; ".join(marks)
        + ". Where a large amplitude meets the rate limit its response jumps to a larger lag; "
        "within about 1 Hz of the jump the estimate is smeared, by up to 0.7 dB.")


def _panels(result: Result, name: str, without: str = "") -> list[tuple[str, float, str]]:
    """The panels a run has outputs for."""
    there = result.series[name].run.columns
    return [panel for panel in _PANELS if panel[0] in there and panel[0] != without]


def _column_of_panels(result: Result, grid: Any, series: Series, panels: Sequence[tuple[str, float, str]], color: str,
                      begin: float, end: float, dots: int) -> None:
    """A run's variables under each other, with their limits, shaded where one is active."""
    values, columns = result.parameters, (series.exact if dots and series.exact else series.run).columns
    made = series.run.excitation
    at = window(columns, begin, end)
    for axes, (name, scale, label) in zip(grid, panels, strict=True):
        plots.shade(axes, columns["time"][at] * 1e3, columns["saturated"][at] > 0.5)
        _line(axes, series, name, scale, begin=begin, end=end, color=color, dots=dots)
        if name == "fin_angle":
            _command(axes, series, begin, end)
        elif name == "motor_voltage" and "supply_voltage" in made.columns:
            inside = window({"time": made.time}, begin, end)
            _limits(axes, made.columns["supply_voltage"][inside], made.time[inside] * 1e3)
        elif (limit := _LIMITED.get(name, "")) in values:
            _limits(axes, values[limit])
        axes.set_ylabel(label)
        axes.set_xlim(begin * 1e3, end * 1e3)
    grid[-1].set_xlabel("time / ms")


def slew(result: Result) -> Drawing | None:
    """What happens inside the largest step."""
    if not _have(result, "step_plus20"):
        return None
    series, panels = result.series["step_plus20"], _panels(result, "step_plus20")
    figure, grid = plots.figure(len(panels), height=1.55, sharex=True)
    _column_of_panels(result, grid[:, 0], series, panels, plots.BLUE, 0.04, 0.2, 4)
    grid[1, 0].axhline(220.0, **_REQUIRED)
    _legend(grid[0, 0], ("fin", {"color": plots.BLUE}), _COMMAND_ENTRY, *_reference(result), _LIMIT_ENTRY,
            ("220 deg/s required", _REQUIRED), _SHADE_ENTRY, columns=6)
    rate = metrics.motion(series.run)
    return Drawing(
        "Rate and saturation", figure, f"A step to 20 deg: {degrees(rate['peak_rate']):.0f} deg/s at the peak, "
        f"{degrees(rate['sustained_rate']):.0f} deg/s in the mean over the middle 60 % of the travel. A limit that is "
        "active while what is drawn is within its limits is that of the speed reference.")


def loaded(result: Result) -> Drawing | None:
    """The slews against and with 100 N.m."""
    if not _have(result, "load_opposing", "load_aiding"):
        return None
    panels = _panels(result, "load_opposing", "drive_reference")
    figure, grid = plots.figure(len(panels), 2, height=1.7, sharex=True, sharey="row")
    for column, name, color in ((0, "load_opposing", plots.BLUE), (1, "load_aiding", plots.VERMILLION)):
        _column_of_panels(result, grid[:, column], result.series[name], panels, color, 0.3, 0.75, 12)
        what = "against 100 N.m" if column == 0 else "with 100 N.m"
        entries = (_COMMAND_ENTRY, *_reference(result)) if column == 0 else (_LIMIT_ENTRY, _SHADE_ENTRY)
        _legend(grid[0, column], (what, {"color": color}), *entries, columns=3)
    for axes in grid[:, 1]:
        axes.set_ylabel("")
    grid[1, 0].axhline(200.0, **_REQUIRED)
    grid[1, 0].text(745, 200.0, "200 deg/s required", fontsize=7, ha="right", va="bottom")
    against, along = (degrees(metrics.motion(result.series[name].run, 1)["sustained_rate"])
                      for name in ("load_opposing", "load_aiding"))
    return Drawing(
        "Loaded slews", figure, "From -20 to +20 deg at 350 ms while 100 N.m come on within 20 ms. Mean rate over the "
        f"middle 60 % of the travel: {against:.0f} deg/s against the load, {along:.0f} deg/s with it. The error the "
        "load leaves decays with the integral action of the position loop, where there is one.")


def square(result: Result) -> Drawing | None:
    """The modified square wave, and its error to the reference."""
    if not _have(result, "square"):
        return None
    return _angle_and_error(result, result.series["square"], "Modified square wave", plots.BLUE,
                            "Levels of 5, 10, 15 and 20 deg, edges at 400 deg/s.", dots=30)


def cold(result: Result) -> Drawing | None:
    """Steps at -6 degC."""
    if not _have(result, "cold"):
        return None
    return _angle_and_error(result, result.series["cold"], "Cold", plots.SKY,
                            "Steps at -6 degC, where friction is higher than the controller knows.", dots=15)


def _angle_and_error(result: Result, series: Series, title: str, color: str, caption: str, dots: int) -> Drawing:
    figure, angle, error = _angle_panels(result, 2.0)
    _command(angle, series)
    _line(angle, series, "fin_angle", _DEG, color=color, dots=dots)
    _error(error, series, color=color, linewidth=0.9)
    _legend(angle, ("fin", {"color": color}), _COMMAND_ENTRY, *_reference(result))
    angle.set_ylabel("fin angle / deg")
    error.set(xlim=(0, float(series.run.excitation.time[-1]) * 1e3))
    return Drawing(title, figure, caption + (" Below, fin angle minus reference." if result.reference else ""))


def sag(result: Result) -> Drawing | None:
    """A slew during which the supply sags."""
    if not _have(result, "sag"):
        return None
    panels = _panels(result, "sag", "drive_reference")
    figure, grid = plots.figure(len(panels), height=1.6, sharex=True)
    _column_of_panels(result, grid[:, 0], result.series["sag"], panels, plots.ORANGE, 0.3, 0.699, 8)
    _legend(grid[0, 0], ("fin", {"color": plots.ORANGE}), _COMMAND_ENTRY, *_reference(result), _LIMIT_ENTRY,
            _SHADE_ENTRY)
    return Drawing("Supply sag", figure, "A slew from +20 to -20 deg at 350 ms; from 400 to 470 ms the supply is down "
                   "from 39 to 28 V, below the back-EMF of the shipped motor at that speed, which then brakes.")


def linear(result: Result) -> Drawing | None:
    """Normalised steps beside the linear model's."""
    if not result.linear_series:
        return None
    figure, grid = plots.figure(2, height=2.4, sharex=True, height_ratios=(2.0, 1.0))
    response, difference = grid[:, 0]
    entries: list[tuple[str, Mapping[str, Any]]] = []
    for (amplitude, (run, angle)), color in zip(result.linear_series.items(), plots.COLORS, strict=False):
        time = run.columns["time"]
        share = run.columns["fin_angle"] * _DEG / amplitude
        expected = angle[:len(time)] * _DEG / amplitude
        response.plot(time * 1e3, share, color=color)
        difference.plot(time * 1e3, 100.0 * (share - expected), color=color, linewidth=1.0)
        entries.append((f"{amplitude:g} deg", {"color": color}))
        drawn_linear = (time * 1e3, expected)
    dashed = {"color": plots.INK, "linestyle": (0, (5, 1.5)), "linewidth": 1.0}
    response.plot(*drawn_linear, **dashed)
    _legend(response, *entries, ("linear model, any step", dashed))
    response.set_ylabel("fin angle / command")
    difference.set(ylabel="difference / %", xlabel="time / ms", xlim=(40, 200))
    return Drawing(
        "Linear and nonlinear", figure, "Steps divided by their size. The linear model's response is the same for all; "
        "this model has quantisation and friction, which show in the small, and limits, which show in the large.")
