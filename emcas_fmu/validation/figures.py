"""The pictures of a validation report; each function returns nothing where a run it needs was not made."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from .. import plots
from . import metrics, requirements
from .linear import LinearModel
from .results import Result, Series
from .runs import Columns

_DEG = 180.0 / np.pi
_DOTS: dict[str, Any] = {"linestyle": "none", "marker": "o", "markersize": 2.6, "markerfacecolor": "none",
                         "markeredgewidth": 0.6}
_COMMAND: dict[str, Any] = {"color": plots.GRAY, "linewidth": 1.0, "linestyle": (0, (4, 2)), "zorder": 1.5}
_LIMIT: dict[str, Any] = {"color": plots.GRAY, "linewidth": 0.9, "linestyle": (0, (1, 1.2)), "zorder": 1.5}
# name, scale, label; in the order of the panels
_PANELS = (("fin_angle", _DEG, "fin angle / deg"), ("fin_rate", _DEG, "fin rate / deg/s"),
           ("drive_reference", 1.0, "DAC / V"), ("motor_current", 1.0, "current / A"),
           ("motor_voltage", 1.0, "voltage / V"))

Drawing = tuple[str, Figure, str]
"""Title, figure, caption."""


def all_figures(result: Result) -> Iterator[tuple[str, str, str]]:
    """Title, inline SVG and caption of every figure the result has the runs for."""
    drawings: Sequence[Callable[[Result], Drawing | None]] = (
        steps, chirp_time, bode, slew, loaded, square, cold, sag, linear)
    for draw in drawings:
        with plots.style():
            made = draw(result)
            if made:
                title, figure, caption = made
                yield title, plots.svg(figure, title), caption


def _have(result: Result, *names: str) -> bool:
    return all(name in result.series and len(result.series[name].run.columns["time"]) for name in names)


def _window(columns: Columns, begin: float, end: float) -> Any:
    time = columns["time"]
    return (time >= begin - 1e-9) & (time <= end + 1e-9)


def _line(axes: Axes, series: Series, name: str, scale: float, *, begin: float = 0.0, end: float = np.inf,
          dots: int = 0, **more: Any) -> None:
    """One variable over time [ms]; every `dots`-th point of the reference on it, and then the run it is of."""
    columns = (series.exact if dots else series.run).columns
    at = _window(columns, begin, end)
    axes.plot(columns["time"][at] * 1e3, columns[name][at] * scale, **more)
    if dots and len(series.reference):
        time = series.reference["time"]
        inside = np.flatnonzero((time >= begin) & (time <= end))[::dots]
        axes.plot(time[inside] * 1e3, series.reference[name][inside] * scale, color=plots.INK, **_DOTS)


def _command(axes: Axes, series: Series, begin: float = 0.0, end: float = np.inf, **more: Any) -> None:
    time, command = series.inputs["time"], series.inputs["fin_command"]
    at = (time >= begin - 1e-9) & (time <= end + 1e-9)
    axes.step(time[at] * 1e3, command[at] * _DEG, where="post", **{**_COMMAND, **more})


def _error(series: Series) -> tuple[Any, Any]:
    """Time [ms] and fin angle minus reference [mdeg]."""
    run = series.exact.columns
    rows = min(len(run["time"]), len(series.reference["time"]))
    difference = (run["fin_angle"][:rows] - series.reference["fin_angle"][:rows]) * _DEG * 1e3
    return run["time"][:rows] * 1e3, difference


def _error_panel(axes: Axes, limit: bool = True) -> None:
    axes.set_ylabel("error / mdeg")
    if limit:
        axes.axhspan(-requirements.TRAJECTORY_LIMIT * 1e3, requirements.TRAJECTORY_LIMIT * 1e3, color=plots.GREEN,
                     alpha=0.10, linewidth=0)


def _legend(axes: Axes, *entries: tuple[str, Mapping[str, Any]], columns: int = 6) -> None:
    """A legend above the panel, where it cannot hide anything."""
    handles = [axes.plot([], [], label=label, **look)[0] for label, look in entries]
    axes.legend(handles=handles, loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=columns, borderaxespad=0.2,
                handlelength=1.8, columnspacing=1.4)


_REFERENCE_ENTRY = ("independent reference", {"color": plots.INK, **_DOTS})
_COMMAND_ENTRY = ("command", _COMMAND)


def _limits(axes: Axes, value: float | Any, time: Any = None) -> None:
    for sign in (1.0, -1.0):
        if time is None:
            axes.axhline(sign * value, **_LIMIT)
        else:
            axes.step(time, sign * value, where="post", **_LIMIT)


def steps(result: Result) -> Drawing | None:
    """The step family, and its error to the reference."""
    sizes = [size for size in (1, 5, 10, 20) if _have(result, f"step_plus{size}", f"step_minus{size}")]
    if not sizes:
        return None
    figure, grid = plots.figure(2, height=2.5, sharex=True, height_ratios=(2.2, 1.0))
    angle, error = grid[:, 0]
    colors = dict(zip((1, 5, 10, 20), plots.COLORS, strict=False))
    for size in reversed(sizes):
        for sign, line in (("plus", "-"), ("minus", (0, (5, 1.2)))):
            series = result.series[f"step_{sign}{size}"]
            _command(angle, series)
            _line(angle, series, "fin_angle", _DEG, dots=12, color=colors[size])
            error.plot(*_error(series), color=colors[size], linestyle=line, linewidth=0.9)
    _legend(angle, *((f"±{size} deg", {"color": colors[size]}) for size in sizes), _COMMAND_ENTRY, _REFERENCE_ENTRY)
    angle.set(ylabel="fin angle / deg", yticks=(-20, -10, -5, -1, 1, 5, 10, 20))
    _error_panel(error)
    error.set(xlabel="time / ms", xlim=(0, 500))
    return ("Steps", figure, "Steps of ±1, ±5, ±10 and ±20 deg at 50 ms. Below, fin angle minus reference in "
            "thousandths of a degree, negative steps dashed; the green band is what the trajectory criterion allows.")


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
            at = _window(series.run.columns, begin, end)
            time = series.run.columns["time"][at]
            _, command = series.inputs["time"][at], series.inputs["fin_command"][at] * _DEG
            axes.plot(time, command, **{**_COMMAND, "linewidth": 1.0 if close else 0.5, "linestyle": "-"})
            axes.plot(time, series.run.columns["fin_angle"][at] * _DEG, color=color, linewidth=1.2 if close else 0.5)
            axes.set_xlim(begin, min(end, float(series.inputs["time"][-1])))
        amplitude = float(np.max(np.abs(series.inputs["fin_command"]))) * _DEG
        row[0].set_ylabel("fin angle / deg")
        _legend(row[0], ("command", {**_COMMAND, "linestyle": "-"}), (f"FMU, {amplitude:.1f} deg", {"color": color}))
    for axes in grid[-1]:
        axes.set_xlabel("time / s")
    return ("Sine sweeps", figure, "Logarithmic sweeps from 0.5 to 30 Hz; on the right about 2 to 3 Hz, and 11 Hz.")


def bode(result: Result) -> Drawing | None:
    """Gain and phase of both amplitudes beside the linear model's."""
    names = [name for name in ("chirp_1deg", "chirp_3p5deg")
             if _have(result, name) and result.series[name].run.stopped is None]
    if not names:
        return None
    figure, grid = plots.figure(2, height=2.6, sharex=True)
    gain, phase = grid[:, 0]
    frequency = np.geomspace(*requirements.SWEPT, 300)
    response = LinearModel(result.fmu.parameters).frequency_response(frequency)
    model = metrics.FrequencyResponse(frequency, np.abs(response), np.unwrap(np.angle(response)), np.ones(300))
    labels = [f"FMU, {name[6:-3].replace('p', '.')} deg" for name in names]
    curves = [(requirements.response_of(result.series[name]), label, color, "-") for name, label, color
              in zip(names, labels, (plots.BLUE, plots.VERMILLION), strict=False)]
    entries = []
    marks: list[str] = []
    for curve, label, color, line in [(model, "linear model", plots.GREEN, (0, (5, 1.5))), *curves]:
        look: dict[str, Any] = {"color": color, "linestyle": line}
        gain.semilogx(curve.frequency, curve.gain_db, **look)
        phase.semilogx(curve.frequency, np.degrees(curve.phase), **look)
        for axes, at, level in ((gain, curve.bandwidth, -3.0), (phase, curve.phase_bandwidth, -90.0)):
            axes.plot(at, level, "o", color=color, markersize=5, zorder=4)
        marks.append(f"{label}: -3 dB at {curve.bandwidth:.1f} Hz, -90 deg at {curve.phase_bandwidth:.1f} Hz")
        entries.append((label, look))
    gain.axhline(-3.0, **_LIMIT)
    phase.axhline(-90.0, **_LIMIT)
    for axes in (gain, phase):
        axes.axvline(10.0, **_LIMIT)
    _legend(gain, *entries[1:], entries[0], ("-3 dB, -90 deg; 10 Hz required", _LIMIT))
    gain.set(ylabel="gain / dB", ylim=(-12, 3))
    phase.set(ylabel="phase / deg", xlabel="frequency / Hz", ylim=(-200, 10), yticks=(-180, -135, -90, -45, 0),
              xlim=requirements.SWEPT, xticks=(0.5, 1, 2, 5, 10, 20), xticklabels=("0.5", "1", "2", "5", "10", "20"))
    phase.minorticks_off()
    gain.minorticks_off()
    # The jump is no artefact: steady sines of 3.5 deg, with the defaults, lag 81 deg at 13.5 Hz and 105 deg at 14 Hz.
    return ("Frequency response", figure, "Fundamental of fin angle over command, from the sweeps. FMU, linear model: "
            + "; ".join(marks) + ". Where a large amplitude meets the rate limit its response jumps to a larger lag; "
            "within about 1 Hz of the jump the estimate is smeared, by up to 0.7 dB.")


def _column_of_panels(result: Result, grid: Any, series: Series, color: str, end: float, begin: float = 0.0,
                      panels: Sequence[tuple[str, float, str]] = _PANELS, dots: int = 0) -> None:
    """A run's variables under each other, with their limits, shaded where one is active."""
    values, columns = result.fmu.parameters, (series.exact if dots else series.run).columns
    at = _window(columns, begin, end)
    supply = series.inputs.get("supply_voltage", np.full(len(series.inputs["time"]), values["drive.supply_voltage"]))
    for axes, (name, scale, label) in zip(grid, panels, strict=True):
        plots.shade(axes, columns["time"][at] * 1e3, columns["saturated"][at] > 0.5)
        _line(axes, series, name, scale, begin=begin, end=end, color=color, dots=dots)
        if name == "fin_angle":
            _command(axes, series, begin, end)
        elif name == "drive_reference":
            _limits(axes, values["drive.reference_limit"])
        elif name == "motor_current":
            _limits(axes, values["drive.current_limit"])
        elif name == "motor_voltage":
            inside = (series.inputs["time"] >= begin) & (series.inputs["time"] <= end + 1e-9)
            _limits(axes, supply[inside], series.inputs["time"][inside] * 1e3)
        axes.set_ylabel(label)
        axes.set_xlim(begin * 1e3, end * 1e3)
    grid[-1].set_xlabel("time / ms")


_SHADE_ENTRY = ("a limit is active", {"color": plots.GRAY, "alpha": 0.3, "linewidth": 7})
_LIMIT_ENTRY = ("limit", _LIMIT)


def slew(result: Result) -> Drawing | None:
    """What happens inside the largest step."""
    if not _have(result, "step_plus20"):
        return None
    figure, grid = plots.figure(5, height=1.55, sharex=True)
    series = result.series["step_plus20"]
    _column_of_panels(result, grid[:, 0], series, plots.BLUE, 0.2, begin=0.04, dots=4)
    grid[1, 0].axhline(220.0, **{**_LIMIT, "color": plots.GREEN})
    _legend(grid[0, 0], ("FMU", {"color": plots.BLUE}), _COMMAND_ENTRY, _REFERENCE_ENTRY, _LIMIT_ENTRY,
            ("220 deg/s required", {**_LIMIT, "color": plots.GREEN}), _SHADE_ENTRY, columns=6)
    rate = requirements.slew_of(series)
    return ("Rate and saturation", figure, f"A step to 20 deg: {rate.peak:.0f} deg/s at the peak, "
            f"{rate.sustained:.0f} deg/s in the mean over the middle 60 % of the travel. Limits of the speed reference "
            "are not drawn; they are what is active once DAC, current and voltage are within theirs.")


def loaded(result: Result) -> Drawing | None:
    """The slews against and with 100 N.m."""
    if not _have(result, "load_opposing", "load_aiding"):
        return None
    figure, grid = plots.figure(4, 2, height=1.7, sharex=True, sharey="row")
    panels = [panel for panel in _PANELS if panel[0] != "drive_reference"]
    for column, name, color in ((0, "load_opposing", plots.BLUE), (1, "load_aiding", plots.VERMILLION)):
        _column_of_panels(result, grid[:, column], result.series[name], color, 0.75, begin=0.3, panels=panels, dots=12)
        what = "against 100 N.m" if column == 0 else "with 100 N.m"
        _legend(grid[0, column], (what, {"color": color}), *((_COMMAND_ENTRY, _REFERENCE_ENTRY) if column == 0 else
                                                           (_LIMIT_ENTRY, _SHADE_ENTRY)), columns=3)
    for axes in grid[:, 1]:
        axes.set_ylabel("")
    grid[1, 0].axhline(200.0, **{**_LIMIT, "color": plots.GREEN})
    grid[1, 0].text(745, 200.0, "200 deg/s required", fontsize=7, ha="right", va="bottom")
    rates = [requirements.slew_of(result.series[name], 1) for name in ("load_opposing", "load_aiding")]
    return ("Loaded slews", figure, "From -20 to +20 deg at 350 ms while 100 N.m come on within 20 ms. Mean rate over "
            f"the middle 60 % of the travel: {rates[0].sustained:.0f} deg/s against the load, {rates[1].sustained:.0f} "
            "deg/s with it. The error the load leaves decays with the integral action of the position loop.")


def square(result: Result) -> Drawing | None:
    """The modified square wave, and its error to the reference."""
    if not _have(result, "square"):
        return None
    return _angle_and_error(result.series["square"], "Modified square wave", plots.BLUE,
                            "Levels of 5, 10, 15 and 20 deg, edges at 400 deg/s.", dots=30)


def cold(result: Result) -> Drawing | None:
    """Steps at -6 degC."""
    if not _have(result, "cold"):
        return None
    return _angle_and_error(result.series["cold"], "Cold", plots.SKY,
                            "Steps at -6 degC, where friction is higher than the controller knows.", dots=15)


def _angle_and_error(series: Series, title: str, color: str, caption: str, dots: int) -> Drawing:
    figure, grid = plots.figure(2, height=2.0, sharex=True, height_ratios=(2.0, 1.0))
    angle, error = grid[:, 0]
    _command(angle, series)
    _line(angle, series, "fin_angle", _DEG, color=color, dots=dots)
    error.plot(*_error(series), color=color, linewidth=0.9)
    _error_panel(error)
    _legend(angle, ("FMU", {"color": color}), _COMMAND_ENTRY, _REFERENCE_ENTRY)
    angle.set_ylabel("fin angle / deg")
    error.set(xlabel="time / ms", xlim=(0, float(series.inputs["time"][-1]) * 1e3))
    return title, figure, caption + " Below, fin angle minus reference."


def sag(result: Result) -> Drawing | None:
    """A slew during which the supply sags."""
    if not _have(result, "sag"):
        return None
    figure, grid = plots.figure(4, height=1.6, sharex=True)
    panels = [panel for panel in _PANELS if panel[0] != "drive_reference"]
    _column_of_panels(result, grid[:, 0], result.series["sag"], plots.ORANGE, 0.699, begin=0.3, panels=panels, dots=8)
    _legend(grid[0, 0], ("FMU", {"color": plots.ORANGE}), _COMMAND_ENTRY, _REFERENCE_ENTRY, _LIMIT_ENTRY, _SHADE_ENTRY)
    return ("Supply sag", figure, "A slew from +20 to -20 deg at 350 ms; from 400 to 470 ms the supply is down from 39 "
            "to 28 V, below the motor's back-EMF at that speed, so that the motor brakes.")


def linear(result: Result) -> Drawing | None:
    """Normalised steps of the FMU beside the linear model's."""
    if not result.linear_series:
        return None
    figure, grid = plots.figure(2, height=2.4, sharex=True, height_ratios=(2.0, 1.0))
    response, difference = grid[:, 0]
    entries: list[tuple[str, Mapping[str, Any]]] = []
    for (amplitude, (series, angle)), color in zip(result.linear_series.items(), plots.COLORS, strict=False):
        time = series.run.columns["time"]
        share = series.run.columns["fin_angle"] * _DEG / amplitude
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
    return ("Linear and nonlinear", figure, "Steps divided by their size. The linear model's response is the same for "
            "all; the FMU has quantisation and friction, which show in the small, and limits, which show in the large.")
