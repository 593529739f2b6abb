"""Chapter 4 and sections 5.2 and 5.3: linear model, controllers, their tuning, and homing."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from math import degrees, radians

import numpy as np

from emcas_fmu.bench.excitation import COMMAND, HOLD, Excitation, sine_from_rest, slew_to, step_to
from emcas_fmu.bench.frequency_response import of_ratio
from emcas_fmu.bench.metrics import FIGURES, displayed, motion_figures, rest_figures, shown, usage_figures
from emcas_fmu.extensions.status import STATUS
from emcas_fmu.motions import RATED
from emcas_fmu.plotting import plots
from emcas_fmu.reference.linear import LinearModel
from emcas_fmu.studies.tuning import pictures as tuning_pictures
from emcas_fmu.studies.tuning.evaluate import evaluate
from emcas_fmu.studies.tuning.optimise import tune
from emcas_fmu.studies.tuning.study import shipped_study
from emcas_fmu.studies.validate.claims import compare

from .entry import Show, Shown, Table
from .listings import COLUMNS, rows_of
from .pictures import DASHED, Line, Panel, angle, command_of, current, panels, rate
from .runs import COLD, WARM, Runs

_LINEAR_SPAN = 0.4  # s after a step of the linear comparison
_WEIGHT = "The setpoint weight is this package's: the thesis's PI controller has none."
_GENERATIONS = 2  # of the search that Figure 4.4 shows


def linear_model(runs: Runs) -> Shown:
    """Show the linear model's frequency response, and steady errors of P and PI control under a load (Figure 4.1)."""
    model, frequency = LinearModel(runs.values), np.geomspace(0.1, 100.0, 300)
    response = of_ratio(frequency, model.frequency_response(frequency))
    figure, ((gain,), (phase,)) = plots.figure(2, height=2.2, sharex=True)
    plots.bode(gain, phase, frequency, response.gain_db, np.degrees(response.phase),
               response.bandwidths, color=plots.BLUE)
    plots.bode_axes(gain, phase)
    plots.frequency_axis(phase, (0.1, 1, 10, 100))
    held = {}
    plain = {"controller__position__ki": 0.0, "controller__position__setpoint_weight": 1.0}
    for name, gains in (("P", plain), ("PI", {})):
        held[name] = degrees(float(rest_figures(runs.run(step_to(0.0, HOLD, RATED), **gains))["steady_error"]))
    rows = (("-3 dB [Hz]", response.bandwidth), ("-90 deg [Hz]", response.phase_bandwidth),
            *((f"steady error under {RATED:g} N.m after {HOLD:g} s, {name} position control [deg]", error)
              for name, error in held.items()))
    conditions = runs.conditions("small sines; 0 for the steady errors", f"none; {RATED:g} N.m for the steady errors")
    return Shown(conditions, figure,
                 "Fin angle over command of the thesis's linear model, with sampled controllers and the drive's delay; "
                 "dots mark -3 dB and -90 deg.", Table(("", "value"), rows))


def linear_steps(*sizes: float) -> Show:
    """Return a function that shows steps [deg] of the linear and the nonlinear model (Figures 5.8, 5.9)."""
    def show(runs: Runs) -> Shown:
        model = LinearModel(runs.values)
        lines: list[Line] = []
        rows = []
        for color, size in zip(plots.COLORS, runs.levels(*sizes), strict=False):
            run = runs.run(step_to(radians(size), _LINEAR_SPAN, step=model.sample_time))
            linear = model.simulate(run.excitation.command)
            compared = compare(size, run, linear)
            lines += [angle(run.columns, f"nonlinear, {size:g}°", color=color),
                      Line(run.columns["time"], np.degrees(linear), "linear", {**DASHED, "color": color})]
            rows.append((f"{size:g}°", compared["largest_difference"], 1e3 * compared["rise_time_linear"],
                         1e3 * compared["rise_time_fmu"], 1e3 * compared["saturated_time"]))
        listed = " and ".join(f"{size:g}°" for size in runs.levels(*sizes))
        return Shown(runs.conditions(f"steps to {listed} at 0.05 s"),
                     panels([Panel("fin angle [deg]", lines)], "time [s]", (0.03, 0.05 + _LINEAR_SPAN)),
                     "Models differ in small steps due to friction and encoder counts, in large ones due to limits.",
                     Table(("step", "largest difference [%]", "rise, linear [ms]", "rise, nonlinear [ms]",
                            "a limit active for [ms]"), rows))

    return show


def antiwindup(runs: Runs) -> Shown:
    """Show a slew against the load with the anti-windup and without (Figure 4.2)."""
    excitation = slew_to(runs.reach, 1.5, -RATED)
    off = runs.run(excitation, controller__antiwindup=0.0, controller__drive_antiwindup=0.0)
    responses = {"as set": runs.run(excitation), "none": off}
    rows = []
    for name, run in responses.items():
        moved = displayed(motion_figures(run, 1))
        rows.append((name, moved["overshoot_percent"], moved["settling_time_s"], moved["time_to_accuracy_s"],
                     float(np.trapezoid(run.columns["at_stop"], run.columns["time"]))))
    as_set = responses["as set"]
    return Shown(runs.conditions(f"slew from {-degrees(runs.reach):g}° to {degrees(runs.reach):g}° at 1 s",
                                 f"-{RATED:g} N.m, against the slew"), panels([
        Panel("fin angle [deg]", [command_of(as_set), *(angle(run.columns, name) for name, run in responses.items())]),
        Panel("fin rate [deg/s]", [rate(run.columns) for run in responses.values()]),
        Panel("reference [V]", [Line(run.columns["time"], run.columns["drive_reference"])
                                for run in responses.values()])], "time [s]", (0.95, 2.3)),
        "While the speed reference is at its limit, the position loop's integral winds up without anti-windup.",
        Table(("anti-windup", "overshoot [%]", "settling 2 % [s]", "within 0.2 deg after [s]",
               "at the stop [s]"), rows),
        "all responses: the thesis shows only the structure. Slew and load here keep the speed reference at its limit.")


def compensation(runs: Runs) -> Shown:
    """Show a slow sine with the friction compensation and without, at both temperatures (Figure 5.16)."""
    excitation = sine_from_rest(radians(1.0), 0.5, 6.0)
    lines: list[Line] = []
    switched: list[Line] = []
    rows = []
    pairs: Mapping[str, dict[str, float]] = {"as set": {}, "compensation.gain = 0": {"compensation__gain": 0.0}}
    for temperature in (WARM, COLD):
        for name, gain in pairs.items():
            run = runs.run(excitation, friction__temperature=temperature, **gain)
            figures = displayed(usage_figures(run))
            rows.append((f"{temperature:g} °C, {name}", figures["rms_tracking_error_deg"],
                         figures["peak_tracking_error_deg"], figures["rms_current_a"]))
            error = Line(run.columns["time"], np.degrees(run.columns["tracking_error"]), f"{temperature:g} °C, {name}")
            (switched if gain else lines).append(error)
    return Shown(f"{WARM:g} and {COLD:g} °C · command: sine of 1° at 0.5 Hz · load: none", panels([
        Panel("command - angle [deg]", lines), Panel("command - angle [deg]", switched)], "time [s]", (2.0, 6.0)),
        "Top: with the compensation; bottom: without it. Friction causes an error at every reversal, larger at -6 °C "
        "than at 24 °C.",
        Table(("", "rms error [deg]", "peak error [deg]", "rms current [A]"), rows),
        "all responses: the thesis shows only the block. The slow sine here makes the effect of friction visible.")


def homing(runs: Runs) -> Shown:
    """Show a homing run on the hard stops (Figure 5.12)."""
    subject, start, goal = runs.of("nonlinear+homing"), radians(-8.0), radians(5.0)
    time = np.arange(8001) * 1e-3
    excitation = Excitation("homing", {COMMAND: np.full(len(time), goal), "home": (time >= 0.25).astype(float)})
    columns = subject.run(excitation, {"fin.start_angle": start}).finished()
    names = {float(i): name for i, (name, _) in enumerate(STATUS.items, 1)}
    status = columns["status"]
    begins = [0, *(np.flatnonzero(np.diff(status)) + 1).tolist()]
    rows = tuple((names[float(status[k])], float(columns["time"][k]), degrees(float(columns["fin_angle"][k])),
                  degrees(float(columns["measured_fin_angle"][k]))) for k in begins)
    figure = panels([
        Panel("fin angle [deg]", [angle(columns, "true"), Line(
            columns["time"], np.degrees(columns["measured_fin_angle"]), "believed", DASHED)]),
        Panel("current [A]", [current(columns)]), Panel("", [Line(columns["time"], status)])], "time [s]", height=1.6)
    figure.axes[-1].set_yticks(sorted(set(status)), [names[float(each)] for each in sorted(set(status))])
    return Shown(runs.conditions("5°, followed once homed; home from 0.25 s") + " · start: -8°, not known", figure,
                 "The fin moves to one stop, then to the other; zero is halfway between them.",
                 Table(("status", "from [s]", "true angle [deg]", "believed [deg]"), rows),
                 "the procedure; the one here is this package's (docs/model/homing.md).")


def requirements(runs: Runs) -> Shown:
    """Show the requirements of the position controller without the margins, and the measured figures (Table 17)."""
    study = shipped_study(runs.parameters)
    judged = tuple(r for r in study.requirements if r.test and r.test.kind != "linear")  # margins need more packages
    gains = {t.name: float(runs.values[t.name]) for t in study.tunables}
    (evaluation,) = evaluate(replace(study, cases=study.cases[:1], requirements=judged), [gains])
    nominal = evaluation.by_requirement()
    rows = []
    for r in judged:
        if r.name in nominal:
            unit, factor = shown(r.unit)
            title = f"{r.name.replace('_', ' ')}: {FIGURES[r.figure].title}"
            rows.append((title, "at most" if r.sense == "maximum" else "at least", unit, r.limit * factor,
                         nominal[r.name].measured * factor, r.source))
    return Shown(runs.conditions("steps, slews and sines of models/tuning.toml", "that of each test"),
                 table=Table(("requirement", "", "unit", "limit", "measured, nominal", "source"), rows),
                 unknown="the table's rise time, settling time and overshoot; except those of Table 2, limits are "
                 "estimates. emcas tune also judges stability margins.")


def tunables(runs: Runs) -> Shown:
    """Show the optimised parameters and their bounds (Table 18)."""
    study = shipped_study(runs.parameters)
    units = {e.variable.name: e.variable.unit for e in runs.parameters.entries}
    rows = tuple((t.name, units[t.name], t.lower, t.upper) for t in study.tunables)
    return Shown("models/tuning.toml", table=Table(("parameter", "unit", "from", "to"), rows),
                 unknown="the thesis's bounds; these are estimates. The thesis optimises both loops and the "
                 f"anti-windup. {_WEIGHT}")


def optimised(runs: Runs) -> Shown:
    """Show the gains of the set (Table 19)."""
    names = {t.name for t in shipped_study(runs.parameters).tunables}
    return Shown("the parameter set", table=Table(COLUMNS, rows_of(runs, *names)),
                 unknown=f"the thesis's gains, which belong to another actuator. {_WEIGHT}")


def search(runs: Runs) -> Shown:
    """Show a short search for gains that uses only steps (Figure 4.4)."""
    study = shipped_study(runs.parameters)
    steps = [(r, r.test) for r in study.requirements if r.test and r.test.kind == "step"]
    tuned = tune(replace(study, cases=study.cases[:1], requirements=tuple(r for r, _ in steps)),
                 generations=_GENERATIONS)
    tests = sorted({test for _, test in steps}, key=lambda test: test.amplitude)
    listed = ", ".join(f"{degrees(test.amplitude):g}°" for test in tests)
    drawing = tuning_pictures.responses(tuned, tests)
    rows = tuple((name, tuned.before.gains[name], value) for name, value in tuned.best.gains.items())
    return Shown(runs.conditions(f"steps to {listed}"), drawing.figure,
                 f"Steps with the set's gains (before) and with those of a short search over Table 18's bounds, "
                 f"{len(tuned.evaluated)} evaluations of these steps only. It shows the method; emcas tune has found "
                 "the shipped gains with all cases and tests.",
                 Table(("parameter", "as set", "this search"), rows),
                 f"the step's size and the bounds of its response. {_WEIGHT}")
