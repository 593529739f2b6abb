"""The pictures of a validation, from the cases that ran to their end."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from math import degrees, inf, isfinite
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes

from ...bench import metrics
from ...bench.frequency_response import SWEPT, FrequencyResponse, of_ratio, sweep_response
from ...bench.references import EMBEDDED
from ...pages.numbers import with_unit
from ...plotting import plots, traces
from ...plotting.plots import LIMIT, REQUIRED, Drawing
from ...plotting.traces import trace
from ...reference.linear import LinearModel
from .validation import TRAJECTORY_LIMIT, CaseResult, Validation

Look = Mapping[str, Any]
Window = tuple[float, float]
_DOTS: Look = {"color": plots.INK, "linestyle": "none", "marker": "o", "markersize": 2.6, "markerfacecolor": "none",
               "markeredgewidth": 0.6}
# The parameter that limits each variable.
_LIMITED = {"drive_reference": "drive.reference_limit", "motor_current": "drive.current_limit",
            "motor_voltage": "drive.supply_voltage"}
_WHOLE = 0.0, inf
_ANGLE = ("fin_angle", "error")
_BELOW = (" Below, fin angle minus reference in thousandths of a degree; the green band is the trajectory "
          "criterion.")
_LOADED = ("fin_angle", "fin_rate", "motor_current", "motor_voltage")
_SWEEPS = {"chirp_1deg": ("1 deg", plots.BLUE), "chirp_3p5deg": ("3.5 deg", plots.VERMILLION)}


class View(NamedTuple):
    """A picture of cases over time.

    Each of the `columns` of panels has a window of time [s], and the line properties of its cases by name. `panels` are
    the variables. At most every `dots`-th point of a reference gets a mark; 0: none. In the panel of the fin rate, a
    line is at the limit of the requirement `rate`.
    """

    title: str
    columns: Sequence[tuple[Window, Mapping[str, Look]]]
    panels: Sequence[str]
    dots: int
    caption: str | Callable[[Validation], str]
    rate: str = ""


def drawings(result: Validation) -> Iterator[Drawing]:
    """Yield every picture with a finished case in each of its columns."""
    finished = {name: case for name, case in result.cases.items() if case.judged.stopped is None}
    embedded = [View("Inside the FMU", [(_WHOLE, _fin(name, plots.BLUE))], _ANGLE, 10, f"{case.case.title}.")
                for name, case in finished.items() if case.case.kind == EMBEDDED]
    for view in (*_VIEWS, *embedded):
        columns = [(window, [(finished[name], look) for name, look in cases.items() if name in finished])
                   for window, cases in view.columns]
        if all(cases for _, cases in columns):
            yield _over_time(result, view, columns)
    if sweeps := {look: finished[name] for name, look in _SWEEPS.items() if name in finished}:
        yield _bode(result, sweeps)
    if result.linear_series:
        yield _linear(result)


def _over_time(result: Validation, view: View, columns: Sequence[tuple[Window, Sequence[tuple[CaseResult, Look]]]]
               ) -> Drawing:
    """Plot a view: outputs with reference, command and limits; a column with one case is shaded while a limit acts."""
    shown = [(window, case) for window, cases in columns for case, _ in cases]
    names = [name for name in view.panels if name in shown[0][1].judged.columns]
    error = "error" in view.panels and any(case.reference for _, case in shown)
    label, unit = plots.time_axis(max(min(window[1], case.judged.columns["time"][-1]) for window, case in shown))
    figure, grid = traces.panels([*names, *["error"] * error], len(columns),
                                 height={1: 2.8, 2: 2.0}.get(len(names) + error, 1.6), x=label, sharex="col",
                                 height_ratios=[2.1] * len(names) + [1.0] * error)
    for panels, (window, cases) in zip(grid, columns, strict=True):
        for case, look in cases:
            for name in names:
                _output(panels[name], name, result, case, window, view.dots, unit, look)
                if len(cases) == 1:
                    traces.shade(panels[name], case.judged.columns, "saturated", window, "a limit is active", unit)
            if error and case.reference:
                response, reference = case.compared("fin_angle")
                trace(panels["error"], {"time": case.compared("time")[0], "error": response - reference}, "error",
                      window, unit=unit, **{**look, "linewidth": 0.9})
        for j in (j for j in result.requirements if j.name == view.rate):
            plots.limits(panels["fin_rate"], j.limit, label=f"required {with_unit(j.limit, j.unit)}", **REQUIRED)
        if error:
            panels["error"].axhspan(-TRAJECTORY_LIMIT * 1e3, TRAJECTORY_LIMIT * 1e3, color=plots.GREEN, alpha=0.10,
                                    linewidth=0)
        for axes in panels.values():
            axes.margins(x=0.0)
    plots.legend_above(figure)
    caption = view.caption if isinstance(view.caption, str) else view.caption(result)
    largest = max(float(np.max(np.abs(case.run.excitation.command))) for _, case in shown)
    return Drawing(view.title, figure, caption + _clipped(result, degrees(largest)) + _BELOW * error)


def _clipped(result: Validation, largest: float) -> str:
    """Return a sentence on the command limit, for a caption, if the `largest` command [deg] is beyond it."""
    limit = degrees(result.parameters.get("command.limit", inf))
    return f" Commands are clipped to {limit:.4g} deg." * (largest > limit + 1e-9)


def _output(axes: Axes, name: str, result: Validation, case: CaseResult, window: Window, dots: int,
            unit: float, look: Look) -> None:
    """Plot an output of a case with its reference, and with its command or limits; see `traces.trace`."""
    excitation = case.run.excitation
    inputs = {"time": excitation.time, **excitation.columns}
    trace(axes, case.judged.columns, name, window, unit=unit, **look)
    if dots and name in case.reference:
        label = "independent reference" if result.independent else "recorded response"
        trace(axes, case.reference, name, window, unit=unit, every=dots, label=label, **_DOTS)
    if name == "fin_angle":
        trace(axes, inputs, "fin_command", window, unit=unit)
    elif name == "motor_voltage" and "supply_voltage" in inputs:
        for sign in (1.0, -1.0):
            trace(axes, {**inputs, "supply_voltage": sign * inputs["supply_voltage"]}, "supply_voltage", window,
                  unit=unit, drawstyle="steps-post", label="limit", **LIMIT)
    elif (parameter := _LIMITED.get(name, "")) in result.parameters:
        plots.limits(axes, result.parameters[parameter], sides=True, label="limit")


def _bode(result: Validation, cases: Mapping[tuple[str, str], CaseResult]) -> Drawing:
    """Plot gain, phase and coherence of the sweeps, and of the linear model if it was compared."""
    curves: list[tuple[FrequencyResponse, dict[str, Any]]] = [
        (sweep_response(case.run), {"label": label, "color": color}) for (label, color), case in cases.items()]
    if result.linear_series:
        frequency = np.geomspace(*SWEPT, 300)
        curves.insert(0, (of_ratio(frequency, LinearModel(result.parameters).frequency_response(frequency)),
                          {"label": "linear model", "color": plots.GREEN, "linestyle": (0, (5, 1.5))}))
    figure = plots.frequency_responses(
        ((curve, curve.bandwidths, look) for curve, look in curves),
        [j.limit for j in result.requirements if j.figure == "bandwidth_3db"])
    return Drawing(
        "Frequency response", figure, "Fundamental of fin angle over command, from the sweeps: "
        + "; ".join("{}, -3 dB: {} Hz, -90 deg: {} Hz".format(look["label"], *curve.stated)
                    for curve, look in curves)
        + ". Where a limit of the rate acts, the lag rises faster with frequency.")


def _linear(result: Validation) -> Drawing:
    """Plot responses to steps, divided by the step's size, with the linear model's response."""
    figure, (response, difference) = plots.column("fin angle / command", "difference [%]", x="time [ms]", height=2.4,
                                                  height_ratios=(2.0, 1.0))
    for (amplitude, (run, linear)), color in zip(result.linear_series.items(), plots.COLORS, strict=False):
        time = run.columns["time"] * 1e3
        share, expected = (np.degrees(angle[:len(time)]) / amplitude for angle in (run.columns["fin_angle"], linear))
        response.plot(time, share, color=color, label=f"{amplitude:g} deg")
        difference.plot(time, 100.0 * (share - expected), linewidth=1.0, color=color, label=f"{amplitude:g} deg")
    response.plot(time, expected, color=plots.INK, linestyle=(0, (5, 1.5)), linewidth=1.0,
                  label="linear model, any step")
    plots.legend_above(response)
    difference.set(xlim=(40, 200))
    return Drawing(
        "Linear and nonlinear", figure, "Steps divided by their size. The linear model is the thesis's, without "
        "trajectory generator; its response is the same for all." + _clipped(result, max(result.linear_series)))


def _slew_caption(result: Validation) -> str:
    rate = metrics.motion_figures(result.cases["step_plus20"].run)
    return (f"A step to 20 deg: {_rate(rate['peak_rate'])} at the peak, {_rate(rate['sustained_rate'])} in the mean "
            "over the middle 60 % of the travel. A limit that is active while no plotted variable is at its limit is "
            "that of another variable, such as the speed reference.")


def _rate(rate: float) -> str:
    return f"{degrees(rate):.0f} deg/s" if isfinite(rate) else "no rate (the fin does not travel so far)"


def _loaded_caption(result: Validation) -> str:
    against, along = (_rate(metrics.motion_figures(result.cases[name].run, 1)["sustained_rate"])
                      for name in ("load_opposing", "load_aiding"))
    return ("Slews from -20 to +20 deg at 350 ms; a load of 100 N.m rises within 20 ms. Mean rate over the middle 60 % "
            f"of the travel: {against} against the load, {along} with it. The error that the load "
            "causes decays by the integral action of the position loop, if it has one.")


def _sag_caption(result: Validation) -> str:
    supply = result.cases["sag"].run.excitation.columns["supply_voltage"]
    shipped = result.of_thesis and not result.differences
    brakes = ", below the back-EMF of the motor at the speed of the slew: it brakes at first" * shipped
    return ("A slew from +20 to -20 deg at 350 ms; from 400 to 470 ms the supply drops from "
            f"{supply[0]:.3g} to {np.min(supply):.3g} V{brakes}.")


def _fin(name: str, color: str, **more: Any) -> dict[str, Look]:
    """Return the only case of a column of panels, with its line properties."""
    return {name: {"color": color, "label": "fin", **more}}


_VIEWS = (
    View("Steps", [((0.0, 0.5), {
        f"step_{sign}{size}": {"color": color, "linestyle": line, "label": f"±{size} deg"}
        for size, color in zip((20, 10, 5, 1), plots.COLORS[3::-1], strict=True)
        for sign, line in (("plus", "-"), ("minus", (0, (5, 1.2))))})],
        _ANGLE, 12, "Steps of up to ±20 deg at 50 ms, negative ones dashed."),
    *(View(f"Sine sweep of {label}", [((0.0, 12.0), _fin(name, color, linewidth=0.5)), ((4.0, 5.2), _fin(name, color)),
                                      ((9.0, 9.4), _fin(name, color))],
           _ANGLE, 0, "Logarithmic sweep from 0.5 to 30 Hz: left, all of it; middle, 2 to 3 Hz; right, 11 to 12 Hz.")
      for name, (label, color) in _SWEEPS.items()),
    View("Rate and saturation", [((0.04, 0.2), _fin("step_plus20", plots.BLUE))],
         ("fin_angle", "fin_rate", "drive_reference", "motor_current", "motor_voltage"), 4, _slew_caption,
         "unloaded_rate"),
    View("Loaded slews", [((0.3, 0.75), _fin("load_opposing", plots.BLUE, label="against 100 N.m")),
                          ((0.3, 0.75), _fin("load_aiding", plots.VERMILLION, label="with 100 N.m"))],
         _LOADED, 12, _loaded_caption, "loaded_rate"),
    View("Modified square wave", [(_WHOLE, _fin("square", plots.BLUE))], _ANGLE, 30,
         "Levels of 5, 10, 15 and 20 deg, edges at 400 deg/s."),
    View("Cold", [(_WHOLE, _fin("cold", plots.SKY))], _ANGLE, 15,
         "Steps at -6 degC."),
    View("Supply sag", [((0.3, 0.699), _fin("sag", plots.ORANGE))], _LOADED, 8, _sag_caption))
