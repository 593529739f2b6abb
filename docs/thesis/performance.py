"""Section 5.4.1, unloaded tests: steps, modified square wave, sine sweep; and Tables 2 and 20."""

from __future__ import annotations

from math import degrees, radians

import numpy as np

from emcas_fmu.bench.excitation import step_to
from emcas_fmu.bench.frequency_response import SWEPT, sweep_response
from emcas_fmu.bench.metrics import displayed, motion_figures, rms
from emcas_fmu.bench.requirements import Specification, load_requirements
from emcas_fmu.bench.verdict import judge
from emcas_fmu.plotting import plots

from .entry import Show, Shown, Table
from .pictures import Line, Panel, angle, command_of, current, panels, rate
from .runs import Runs

_MOTION = {"rise_time_s": "rise 10-90 % [s]", "settling_time_s": "settling 2 % [s]",
           "overshoot_percent": "overshoot [%]", "steady_error_deg": "error at the end [deg]",
           "peak_rate_deg_per_s": "peak rate [deg/s]", "sustained_rate_deg_per_s": "mean rate [deg/s]"}
_RATE = 220.0  # deg/s, Table 2
_SWEEPS = {"chirp_1deg": "1°", "chirp_3p5deg": "3.5°"}
_DRAWN = "chirp_3p5deg"
_SENSES = {"minimum": "at least", "maximum": "at most"}


def steps(runs: Runs) -> Shown:
    """Show steps without load (Figure 5.18)."""
    lines: list[Line] = []
    commands: list[Line] = []
    rows = []
    sizes = runs.levels(1.0, 5.0, 10.0, 20.0)
    for color, size in zip(plots.COLORS, reversed(sizes), strict=False):
        for sign in (1.0, -1.0):
            run = runs.run(step_to(radians(sign * size), 0.5))
            commands.append(command_of(run)._replace(label="command" if not commands else ""))
            lines.append(angle(run.columns, f"±{size:g}°" if sign > 0.0 else "", color=color))
            moved = displayed(motion_figures(run))
            rows.append((f"{sign * size:+g}°", *(moved[key] for key in _MOTION)))
    listed = ", ".join(f"±{size:g}" for size in sizes)
    return Shown(runs.conditions(f"steps to {listed}° at 0.05 s"),
                 panels([Panel("fin angle [deg]", [*commands, *lines])], "time [s]", (0.0, 0.4), 2.6),
                 "Steps from rest at zero.", Table(("step", *_MOTION.values()), rows),
                 "the step's size; its measured curve is not published.")


def step_rate(runs: Runs) -> Shown:
    """Show the fin rate of the largest steps (Figure 5.20)."""
    size, lines = degrees(runs.reach), list[Line]()
    rows = []
    for sign in (1.0, -1.0):
        run = runs.run(step_to(sign * runs.reach, 0.5))
        lines.append(rate(run.columns, f"{sign * size:+g}°"))
        moved = displayed(motion_figures(run))
        rows.append((f"{sign * size:+g}°", moved["peak_rate_deg_per_s"], moved["sustained_rate_deg_per_s"]))
    return Shown(runs.conditions(f"steps to ±{size:g}° at 0.05 s"),
                 panels([Panel("fin rate [deg/s]", lines, (_RATE, -_RATE))], "time [s]", (0.03, 0.3)),
                 f"Dotted: {_RATE:g} deg/s, the required mean rate (Table 2).",
                 Table(("step", "peak rate [deg/s]", "mean rate [deg/s]"), rows))


_SQUARE = "levels, holds and the edges' rate; 5 to 20°, 150 ms and 400 deg/s are estimates."


def square_command(runs: Runs) -> Shown:
    """Show the command of the modified square wave (Figure 5.21)."""
    run = runs.case("square")
    return Shown(runs.conditions("modified square wave"),
                 panels([Panel("command [deg]", [command_of(run)._replace(label="")])], "time [s]"),
                 "Levels of growing size on both sides, with edges of limited rate.", unknown=_SQUARE)


def square(runs: Runs) -> Shown:
    """Show the response to the modified square wave: angle, tracking error, rate (Figure 5.22)."""
    run = runs.case("square")
    columns = run.columns
    error = np.degrees(columns["tracking_error"])
    rows = (("largest tracking error [deg]", float(np.max(np.abs(error)))),
            ("its root mean square [deg]", rms(error)),
            ("largest rate [deg/s]", degrees(float(np.max(np.abs(columns["fin_rate"]))))))
    return Shown(runs.conditions("modified square wave"), panels([
        Panel("fin angle [deg]", [command_of(run), angle(columns, "fin")]),
        Panel("command - angle [deg]", [Line(columns["time"], error)]),
        Panel("fin rate [deg/s]", [rate(columns)])], "time [s]"),
        "The thesis plots the difference between simulation and test, which is not published; here, command - angle.",
        Table(("", "value"), rows), _SQUARE)


_SWEPT = "amplitude, frequencies and duration; these, logarithmic from 0.5 to 30 Hz in 12 s, are estimates."


def sweep(*window: float) -> Show:
    """Return a function that shows the sine sweep over time, whole or within a window [s] (Figures 5.23, 5.24)."""
    def show(runs: Runs) -> Shown:
        run = runs.case(_DRAWN)
        begin, end = window or (0.0, run.excitation.stop)
        width = 1.0 if window else 0.4
        lines = [command_of(run), angle(run.columns, "fin", linewidth=width)]
        lines[0] = lines[0]._replace(look={**lines[0].look, "linewidth": width})
        parts = [Panel("fin angle [deg]", lines)]
        if window:
            parts.append(Panel("current [A]", [current(run.columns)]))
        return Shown(runs.conditions("sine sweep of 3.5°"), panels(parts, "time [s]", (begin, end)),
                     "The response lags more as the frequency grows." if not window else
                     "Near 5 Hz: the angle lags the command.", unknown=_SWEPT)

    return show


def bode(runs: Runs) -> Shown:
    """Show gain and phase of the sine sweeps (Figure 5.26)."""
    figure, ((gain,), (phase,)) = plots.figure(2, height=2.2, sharex=True)
    rows = []
    for color, (name, label) in zip(plots.COLORS, _SWEEPS.items(), strict=False):
        response = sweep_response(runs.case(name))
        plots.bode(gain, phase, response.frequency, response.gain_db, np.degrees(response.phase),
                   response.bandwidths, color=color, label=label)
        rows.append((label, *response.stated))
    plots.bode_axes(gain, phase)
    gain.axvline(10.0, **plots.LIMIT)
    phase.axvline(10.0, **plots.LIMIT)
    plots.legend_above(gain)
    phase.set_xlim(SWEPT)
    plots.frequency_axis(phase, (0.5, 1, 2, 5, 10, 20))
    gain.minorticks_off()
    return Shown(runs.conditions("sine sweeps of 1° and 3.5°, 0.5 to 30 Hz"), figure,
                 "Fundamental of fin angle over command, by Welch's method; dots mark -3 dB and -90 deg, the dotted "
                 "vertical line marks the 10 Hz of Table 2.",
                 Table(("amplitude", "-3 dB [Hz]", "-90 deg [Hz]"), rows), _SWEPT)


def _table2(runs: Runs) -> Specification:
    """Return the shipped requirements from Table 2 of the thesis."""
    shipped = load_requirements(None, runs.subject.parameters)
    return Specification(tuple(r for r in shipped.requirements if "Table 2" in r.source))


def required(runs: Runs) -> Shown:
    """Show the performance that the thesis requires (Table 2)."""
    rows = tuple((r.title, _SENSES[r.sense], round(r.limit * r.shown[1], 9), r.shown[0], r.how)
                 for r in _table2(runs).requirements)
    return Shown("the thesis's limits",
                 table=Table(("requirement", "", "limit", "unit", "how it is measured here"), rows),
                 unknown="how the thesis measures each figure.")


def realised(runs: Runs) -> Shown:
    """Show the performance of the set (Table 20)."""
    table2 = _table2(runs)
    rows = tuple((j.title, _SENSES[r.sense], j.limit, j.measured, j.margin, j.unit, j.passed)
                 for r, j in zip(table2.requirements, judge(runs.subject, table2), strict=True))
    return Shown(runs.conditions("steps, slews and sine sweeps of Table 2", "none, and 100 N.m against the slew"),
                 table=Table(("requirement", "", "limit", "measured", "margin", "unit", "met"), rows),
                 caption="The actuator is simulated; most parameters are estimates. emcas validate has the details.",
                 unknown="the values that were realised.")
