"""Plot the effects of margins and feed-forward, and write the tables of docs/model/control.md, except that of kinds."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from functools import cache
from math import degrees
from typing import Any

import numpy as np
from make_tables import main, markdown, save

from emcas_fmu.bench.linear.actuator import LinearActuator
from emcas_fmu.bench.linear.frequency import continuous_poles, margins
from emcas_fmu.bench.measure import Test, measure
from emcas_fmu.bench.subject import ParameterSubject
from emcas_fmu.parameters import ParameterSet, load_parameters
from emcas_fmu.plotting import plots
from emcas_fmu.simulation import simulate

THESIS = {"controller.position.setpoint_weight": 1.0}
SETS: Mapping[str, ParameterSet] = {
    "shipped": load_parameters(),
    "shipped, setpoint weight 1": load_parameters().with_values(THESIS),
    "shipped with a speed observer": load_parameters("speed-observer"),
    "robust": load_parameters("robust"),
    "shipped with a load observer": load_parameters("load-observer"),
    "shipped with both observers": load_parameters(["load-observer", "speed-observer"]),
    "robust with a load observer": load_parameters(["robust", "load-observer"]),
    "two degrees of freedom": load_parameters("two-degrees-of-freedom"),
}
COLORS = {"shipped": plots.BLUE, "robust with a load observer": plots.VERMILLION,
          "two degrees of freedom": plots.GREEN}
OBSERVER = SETS["shipped with a load observer"].values["controller.load_observer"]
GAINS = ("controller.position.kp", "controller.position.ki", "controller.velocity.kp")
LINEAR = Test("linear")
LOAD = Test("load", duration=1.0, torque=100.0)
OPPOSED, AIDED = (Test("slew", np.radians(20.0), 1.0, torque) for torque in (-100.0, 100.0))


def step(size: float) -> Test:
    return Test("step", float(np.radians(size)), 1.0)


def figures(parameters: ParameterSet) -> dict[str, float]:
    """Return figures of a set: margins [deg, dB], load step [deg], rates [deg/s], bandwidths [Hz], overshoot [%], times
    [ms] and lag [deg]."""
    subject = ParameterSubject(parameters)

    def of(test: Test, *names: str, sense: str = "maximum") -> list[float]:
        (values,) = measure(test, subject, [{}], names, (sense,) * len(names)).tolist()
        return list(values)

    gain, phase = of(LINEAR, "gain_margin", "phase_margin")
    moves = [of(step(size), "overshoot", "settling_time") for size in (1.0, 5.0, 10.0)]
    return {
        "phase margin / °": degrees(phase), "gain margin / dB": gain,
        "deviation under 100 N·m / °": degrees(of(LOAD, "peak_angle")[0]),
        "within 0.05° after a load step / ms": recovery(parameters),
        "rate against 100 N·m / °/s": degrees(of(OPPOSED, "sustained_rate", sense="minimum")[0]),
        "rate with 100 N·m / °/s": degrees(of(AIDED, "sustained_rate", sense="minimum")[0]),
        **{f"bandwidth at {size}° / Hz": of(Test("sine", float(np.radians(size))), "bandwidth_3db", sense="minimum")[0]
           for size in (1.0, 3.5)},
        "largest overshoot of 1, 5, 10° / %": 100.0 * max(overshoot for overshoot, _ in moves),
        **{f"settling of {size}° / ms": 1e3 * settling for size, (_, settling) in zip((1, 5, 10), moves, strict=True)},
        "20° within 0.2° after / ms": 1e3 * of(step(20.0), "time_to_accuracy")[0], "lag at 5 Hz / °": lag(parameters),
    }


BANDWIDTH, NOTCH = "filters.speed_bandwidth", "filters.notch_frequency"
INERTIAS = ("inertia.motor", "inertia.screw", "inertia.fin", "inertia.shaft", "inertia.fork", "mass.nut")
# 10 kN.m/rad without damping behind the screw, and a notch without damping of its zeros.
HINGE = {"drive_line.shaft_stiffness": 1e4, "drive_line.fork_stiffness": 0.0, "drive_line.structure_stiffness": 0.0,
         "drive_line.hinge_damping": 0.0, "filters.notch_zero_damping": 0.0, "filters.notch_pole_damping": 0.2}


def filtered(name: str, model: str, changes: Mapping[str, float]) -> ParameterSet:
    """Return a set of SETS, by its name there, for a model with filters, with changed values."""
    files = [] if name == "shipped" else [name.replace(" ", "-")]
    return load_parameters(files, model=f"{model}+filters").with_values(changes)


def inertia_margins(parameters: ParameterSet, share: float) -> str:
    """Return the margins as text, for a plant with a `share` of the inertia that the controllers use."""
    values = parameters.values
    nominal, built = (LinearActuator({**values, **{name: values[name] * scale for name in INERTIAS}},
                                   model=parameters.model) for scale in (1.0, share))
    nominal.plant = built.plant
    margin = margins(nominal.loop("reference"))
    return f"{degrees(margin.phase):.1f}° / {margin.gain_db:.1f} dB" if nominal.stable else "unstable"


def observer_table() -> str:
    """Return the table of bandwidths of the speed observer: margins for three inertias, deviation under a load step."""
    rows = []
    for name in ("shipped", "load observer", "two degrees of freedom"):
        for bandwidth in (0.0, 150.0, 300.0, 800.0):
            parameters = filtered(name, "nonlinear", {BANDWIDTH: bandwidth})
            ((angle,),) = measure(LOAD, ParameterSubject(parameters), [{}], ("peak_angle",), ("maximum",))
            rows.append([name, f"{bandwidth:g}", *(inertia_margins(parameters, share) for share in (0.75, 1.0, 1.25)),
                         f"{degrees(angle):.3f}"])
    return markdown(("", "bandwidth / 1/s", "inertia −25 %", "nominal inertia", "inertia +25 %",
                     "deviation under 100 N·m / °"), rows)


def notch_table() -> str:
    """Return the table of notches for a soft hinge: margins, damping of its mode, and the swing [deg] after a push."""
    rows = []
    for name in ("shipped", "two degrees of freedom"):
        for notch, changes in (("none", {}), *((f"{hertz:g} Hz", {NOTCH: 2.0 * np.pi * hertz})
                                               for hertz in (65.0, 60.0, 55.0)),
                               ("none, hinge damped by 0.5 N·m·s/rad", {"drive_line.hinge_damping": 0.5})):
            parameters = filtered(name, "elastic", {**HINGE, **changes})
            linear = LinearActuator(parameters.values, model=parameters.model)
            margin, poles = margins(linear.loop("reference")), continuous_poles(linear.closed)
            modes = poles[np.abs(np.abs(poles.imag) / (2.0 * np.pi) - 65.0) < 2.0]
            run = simulate(parameters.values, 1.5, model=parameters.model,
                           aero_torque=lambda t: 300.0 if 0.1 < t < 0.2 else 0.0)
            swing = np.degrees(np.ptp(run["fin_angle"][run["time"] > 1.3]))
            rows.append([name, notch, f"{degrees(margin.phase):.1f}° / {margin.gain_db:.1f} dB" if linear.stable
                         else "unstable", f"{np.min(-modes.real / np.abs(modes)):.4f}", f"{swing:.2g}"])
    return markdown(("", "notch", "margins", "damping of the mode", "swing 1.1 s after a push / °"), rows)


def respond(parameters: ParameterSet, **inputs: Any) -> Mapping[str, Any]:
    return simulate(parameters.values, 1.2, model=parameters.model, **inputs)


def recovery(parameters: ParameterSet, torque: float = 100.0) -> float:
    """Return the time [ms] from a load step [N.m] until the fin remains within 0.05 deg; inf if it does not."""
    run = respond(parameters, aero_torque=lambda t: torque if t >= 0.1 else 0.0)
    away = np.flatnonzero(np.abs(np.degrees(run["fin_angle"])) > 0.05)
    if not len(away):
        return 0.0
    return float(run["time"][away[-1]] - 0.1) * 1e3 if away[-1] + 1 < len(run["time"]) else float("inf")


def lag(parameters: ParameterSet) -> float:
    """Return the lag [deg] of a sine of 1 deg at 5 Hz."""
    run = respond(parameters, fin_command=lambda t: np.radians(np.sin(10.0 * np.pi * t)))
    late = (run["time"] >= 0.4) & (run["time"] < 1.2 - 1e-9)
    turning = run["fin_angle"][late] * np.exp(-10j * np.pi * run["time"][late])
    return float(-np.degrees(np.angle(1j * np.sum(turning))))


def draw_responses() -> None:
    """Plot a step of 1 deg, a load step, and a slew of 40 deg at 20 V with the sets of COLORS."""
    def step(size: float, start: float = 0.0) -> Any:
        return lambda t: np.radians(size if t >= 0.35 else start)

    panels: tuple[tuple[str, dict[str, Any], tuple[float, float], tuple[float, float]], ...] = (
        ("step of 1 deg", {"fin_command": step(1.0)}, (0.34, 0.46), (-0.05, 1.05)),
        ("100 N·m at 0.35 s", {"aero_torque": lambda t: 100.0 if t >= 0.35 else 0.0}, (0.33, 1.0), (-0.05, 0.55)),
        ("slew at 20 V", {"fin_command": step(20.0, -20.0), "supply_voltage": 20.0}, (0.55, 1.1), (17.0, 21.0)))
    with plots.style():
        picture, (row,) = plots.figure(1, len(panels), height=2.6, width=9.0)
        for axes, (title, inputs, times, angles) in zip(row, panels, strict=True):
            for name, color in COLORS.items():
                run = respond(SETS[name], **inputs)
                axes.plot(run["time"], np.degrees(run["fin_angle"]), color=color, label=name)
            axes.set(title=title, xlim=times, ylim=angles, xlabel="time [s]", ylabel="fin angle [deg]")
        plots.legend_above(picture)
    save(picture, "two_degrees", 150)


def between(share: float) -> ParameterSet:
    """Return the shipped set with gains between those of the robust set (`share` 0) and the shipped gains (1)."""
    low, high = SETS["robust"].values, SETS["shipped"].values
    return load_parameters().with_values({name: low[name] ** (1.0 - share) * high[name] ** share for name in GAINS})


@cache
def of_sets() -> Mapping[str, Mapping[str, float]]:
    """Return the figures of each set."""
    return {name: figures(parameters) for name, parameters in SETS.items()}


def margin_table() -> str:
    """Return the table of the figures of each set."""
    return markdown(("", *next(iter(of_sets().values()))),
                    ((name, *(f"{value:.3g}" for value in row.values())) for name, row in of_sets().items()))


def draw_margins() -> None:
    """Plot the deviation under a load step against the phase margin, with and without a load observer."""
    with plots.style():
        picture, ((axes,),) = plots.figure(1, height=3.4, width=6.4)
        for observer, color, label in ((0.0, plots.BLUE, "shipped loops"),
                                       (OBSERVER, plots.VERMILLION, "with a load observer")):
            points = []
            for share in np.linspace(-0.4, 1.4, 10):
                subject = ParameterSubject(between(float(share)).with_values({"controller.load_observer": observer}))
                ((phase,),) = measure(LINEAR, subject, [{}], ("phase_margin",), ("minimum",))
                ((angle,),) = measure(LOAD, subject, [{}], ("peak_angle",), ("maximum",))
                points.append((degrees(phase), degrees(angle)))
            axes.plot(*np.array(points).T, color=color, label=label)
        for name, marker in (("shipped", "o"), ("robust", "s")):
            row = of_sets()[name]
            axes.plot(row["phase margin / °"], row["deviation under 100 N·m / °"], marker, color="#444444",
                      label=name.strip("`"))
        axes.set(xlabel="phase margin at the drive's reference [deg]", ylabel="deviation under 100 N·m [deg]")
        axes.legend()
    save(picture, "control", 150)


TABLES = {"model/control.md": {"margins": margin_table, "observers": observer_table, "notches": notch_table}}


if __name__ == "__main__":
    draw_margins()
    draw_responses()
    sys.exit(main("--check" in sys.argv[1:], TABLES, "make_control.py"))
