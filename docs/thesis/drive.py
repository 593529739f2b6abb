"""Sections 3.2.1 and 3.2.2: motor and current-mode drive."""

from __future__ import annotations

from math import pi

import numpy as np

from emcas_fmu.ops.arrays import ARRAYS
from emcas_fmu.physics import drive as physics
from emcas_fmu.plotting import plots
from emcas_fmu.studies.analysis import envelope
from emcas_fmu.studies.identification.drive import response

from .entry import Shown, Table
from .listings import COLUMNS, LOST, rows_of
from .pictures import DOTS, Line, Panel, panels
from .runs import Runs

SHORT = 10.0  # s, duration of the short-term torque
# Table 4: one unit of the drive's software in V/A and V/(A.s).
CONVERSION = {"drive.kp": 0.208, "drive.ki": 0.018}
GAINS = ("drive.current_gain", "drive.current_offset", "drive.transport_delay", "drive.kp", "drive.ki")
_HELD = "this set's values · command: analogue reference {} · rotor held"


def torque_speed(runs: Runs) -> Shown:
    """Show the motor's continuous and short-term torque over speed (Figure 3.2)."""
    capability = envelope.envelope(runs.parameters_of("nonlinear+heat"), SHORT)
    rows = tuple((label, curve.current, envelope.CAUSES[curve.bound_by], float(curve.torque[0]),
                  curve.corner_speed * 30.0 / pi)
                 for label, curve in zip(("continuous", f"for {SHORT:g} s"), capability.curves.values(), strict=True))
    return Shown(f"{runs.values['friction.temperature']:g} °C · from cold · supply as set", envelope.draw(capability),
                 "The largest torque in steady motion that heat, the drive's current limit and the supply allow.",
                 Table(("", "current [A]", "limited by", "torque at standstill [N.m]", "voltage limits from [rpm]"),
                       rows),
                 "the curves' values and the duration of short-term torque; 10 s and the motor's heat are estimates.")


def motor(runs: Runs) -> Shown:
    """Show the motor's data with stall torque and no-load speed (Table 3)."""
    rows = rows_of(runs, "motor.", "inertia.motor", "drive.supply_voltage")
    p = runs.parameters.nested()
    free = p.drive.supply_voltage / p.motor.back_emf_constant
    rows += [("stall torque", f"{physics.torque(p, p.drive.current_limit):.3g} N*m", "computed",
             "At the drive's current limit."),
            ("no-load speed", f"{free * 30.0 / pi:.0f} rpm", "computed", "At the supply, without friction.")]
    return Shown("the parameter set", table=Table(COLUMNS, rows),
                 unknown=f"{LOST} It lists the number of poles, twice the pole pairs.")


def current_gain(runs: Runs) -> Shown:
    """Show the reference current and the motor current over the analogue reference (Figure 3.4)."""
    volts, gains = np.linspace(-4.0, 4.0, 17), [runs.values[name] for name in GAINS]
    reference = physics.current_reference_raw(runs.parameters.nested(), volts)

    def after(step: float, rows: int) -> list[float]:
        return [float(response(gains, 0.0, np.array([0.0] + [v] * rows), None, step, runs.values)[-1]) for v in volts]

    soon, late = after(1e-3, 50), after(10.0, 100)
    rows = tuple((name, *map(float, np.polyfit(volts, column, 1)))
                 for name, column in (("reference", reference), ("after 50 ms", soon), ("after 1000 s", late)))
    return Shown(_HELD.format("-4 to 4 V"), panels([Panel("motor current [A]", [
        Line(volts, reference, "reference"), Line(volts, soon, "after 50 ms", DOTS),
        Line(volts, late, "after 1000 s", {**DOTS, "markerfacecolor": "none", "markersize": 6.0})])],
        "analogue reference [V]"),
        "The thesis's line is 8.19 A/V and -0.015 A. The loop's integral determines when the current reaches it.",
        Table(("", "slope [A/V]", "offset [A]"), rows),
        "how long each reference was held; the measured points are not published.")


def current_loop(runs: Runs) -> Shown:
    """Show a step response of the current loop (Figure 3.6)."""
    level, begin, step = 1.0, 5e-3, 2e-5
    time = np.arange(round(0.03 / step)) * step
    reference = np.where(time < begin, 0.0, level)
    gain, offset, delay, kp, ki = (runs.values[name] for name in GAINS)
    sets = {"gains as set": (kp, ki),
            "the same numbers in the drive's own units": (kp * CONVERSION["drive.kp"], ki * CONVERSION["drive.ki"])}
    lines: list[Line] = []
    rows = []
    p = runs.parameters.nested()
    demanded = ARRAYS.clip(physics.current_reference_raw(p, reference), -p.drive.current_limit, p.drive.current_limit)
    for label, gains in sets.items():
        current = response((gain, offset, delay, *gains), 0.0, reference, None, step, runs.values)
        lines.append(Line(1e3 * time, current, label))
        share = gains[0] / (gains[0] + p.motor.resistance)
        rows.append((label, *gains, 1e3 * p.motor.inductance / (p.motor.resistance + gains[0]), 100.0 * share,
                     (p.motor.resistance + gains[0]) / gains[1] if gains[1] else None))
    return Shown(_HELD.format(f"step to {level:g} V at {1e3 * begin:g} ms"), panels([Panel("motor current [A]", [
        Line(1e3 * time, demanded, "reference", plots.COMMAND_STYLE), *lines])], "time [ms]"),
        f"The step arrives after the transport delay of {1e3 * delay:.3g} ms.",
        Table(("", "kp [V/A]", "ki [V/(A.s)]", "time constant [ms]", "reached at once [%]", "rest closes in [s]"),
              rows),
        "the step's size (1 V is an estimate), and the units of the gains 5 and 0.1: both readings are "
        "plotted. The measured current is not published.")


def conversion(runs: Runs) -> Shown:
    """Show the conversion of the drive's gains (Table 4)."""
    units = {e.variable.name: e.variable.unit for e in runs.parameters.entries}
    rows = tuple((name, factor, float(runs.values[name]), units[name], float(runs.values[name]) / factor,
                  float(runs.values[name]) * factor) for name, factor in CONVERSION.items())
    return Shown("the thesis's coefficients, with the set's gains", table=Table(
        ("gain", "coefficient", "as set", "unit", "in the drive's units", "SI, if the set's number is in drive units"),
        rows))
