"""Lever, screw, encoders and backlash: Figures 2.1, 2.2, 3.37, 3.38 and 5.15, and Table 1."""

from __future__ import annotations

from math import degrees, radians
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from emcas_fmu.bench.excitation import sine_from_rest, step_to
from emcas_fmu.bench.metrics import motion_figures
from emcas_fmu.control import sensors
from emcas_fmu.errors import EmcasError
from emcas_fmu.ops.arrays import ARRAYS
from emcas_fmu.physics import kinematics as physics
from emcas_fmu.plotting import plots
from emcas_fmu.studies.analysis.modes import load_rod, modes_at, thesis_modes
from emcas_fmu.studies.identification import backlash as identification

from .entry import Shown, Table
from .pictures import Line, Panel, angle, command_of, panels
from .rigs import Columns
from .runs import Runs

ASSEMBLY = (0.0, 2.5, 5.0, 7.5, 10.0)  # deg
# Friction at the fin makes the flank change with the direction, as in docs/model/elastic.md.
_BACKLASH = {"friction.fin_coulomb": 5.0}
_SWING, _FREQUENCY, _CYCLES = 10.0, 0.25, 3  # deg, Hz


def assembly(runs: Runs) -> Shown:
    """Show the mounted lever, and the fin rates in both directions over the assembly angle (Figure 2.1)."""
    p, reach = runs.parameters.nested(), runs.reach
    rates = []
    for mounted in ASSEMBLY:
        both = [motion_figures(runs.run(step_to(side * reach, 1.0), kinematics__initial_angle=radians(mounted)))
                for side in (1.0, -1.0)]
        rates.append((mounted, *(degrees(each["sustained_rate"]) for each in both)))
    figure, ((lever, rate),) = plots.figure(1, 2, height=3.0)
    arm = 1e3 * p.kinematics.moment_arm
    for fin, look in ((-reach, {"color": plots.GRAY}), (reach, {"color": plots.GRAY}), (0.0, {"color": plots.BLUE})):
        along = arm * np.tan(fin + p.kinematics.initial_angle)
        lever.plot([0.0, along], [0.0, -arm], marker="o", markersize=4.0, **look)
        lever.annotate(f"{degrees(fin):+.3g}°" if fin else "0°", (along, -arm), (0, -11), textcoords="offset points",
                       ha="center", fontsize=8)
    lever.axhline(-arm, **plots.LIMIT)
    lever.axvline(0.0, **plots.LIMIT)
    lever.set(xlabel="along the screw [mm]", ylabel="from the hinge [mm]", title="lever, to scale", aspect="equal",
              xlim=(-0.75 * arm, 0.75 * arm), ylim=(-1.2 * arm, 0.1 * arm))
    table = np.array(rates)
    for column, name in ((1, "positive"), (2, "negative")):
        rate.plot(table[:, 0], table[:, column], marker="o", markersize=4.0, label=f"{name} direction")
    rate.set(xlabel="assembly angle [deg]", ylabel="mean rate [deg/s]")
    plots.legend_above(rate)
    reach_deg = degrees(reach)
    return Shown(runs.conditions(f"steps from 0 to ±{reach_deg:g}°"), figure,
                 "Left, the lever at fin angle 0 and at the ends of the range; the screw is dotted. The set's assembly "
                 f"angle is {degrees(p.kinematics.initial_angle):.3g}°. Right, the mean rate over the middle 60 % of a "
                 "step in either direction: with an assembly angle, one direction is slower.",
                 Table(("assembly angle [deg]", "positive [deg/s]", "negative [deg/s]"), tuple(rates)),
                 "the assembly angle's value; the set's is an estimate.")


def ratio(runs: Runs) -> Shown:
    """Show motor angle and reduction ratio over the fin angle, (2.5) and (2.6) (Figure 2.2)."""
    p = runs.parameters.nested()
    fin = np.linspace(-runs.reach, runs.reach, 81)
    motor = physics.motor_angle(ARRAYS, p, fin)
    reduction = physics.reduction_ratio(ARRAYS, p, physics.lever_tangent(ARRAYS, p, motor))
    rows = tuple((degrees(fin[i]), float(motor[i]), 1e3 * float(physics.nut_position(ARRAYS, p, motor[i])),
                  float(reduction[i])) for i in (0, 40, 80))
    return Shown("geometry alone", panels([Panel("motor angle / rad", [Line(np.degrees(fin), motor)]),
                                           Panel("reduction ratio", [Line(np.degrees(fin), reduction)])],
                                          "fin angle [deg]"),
                 "The ratio is smallest where the lever is perpendicular to the screw, and grows with the lever angle.",
                 Table(("fin angle [deg]", "motor angle [rad]", "nut [mm]", "reduction ratio"), rows))


def natural_frequencies(runs: Runs) -> Shown:
    """Show the rod's natural frequencies, with the thesis's numbers and with the set's (Table 1)."""
    rod = load_rod()
    thesis, here = thesis_modes(), modes_at(rod, runs.values, 0.0)
    rows = (("inertia on the rod [kg.m2]", rod["thesis.inertia"], here["inertia_kgm2"]),
            ("mass on the rod [kg]", rod["thesis.mass"], here["mass_kg"]), *((label, thesis[name], here[name])
            for name, label in (("axial_hz", "in tension [Hz]"), ("torsional_hz", "in torsion [Hz]"),
                                ("axial_over_bandwidth", "in tension, over the bandwidth"),
                                ("torsional_over_bandwidth", "in torsion, over the bandwidth"))))
    return Shown("rod of Table 1 (models/rod.toml)",
                 table=Table(("", "with Table 1's inertia and mass", "with those of the set"), rows),
                 caption="The thesis states {} to {} times the bandwidth, which divides rad/s by Hz.".format(
                     *(int(thesis[f"{name}_rad_per_s_over_hz"]) for name in ("axial", "torsional"))))


def _backlash(runs: Runs) -> Columns:
    subject = runs.of("elastic")
    excitation = sine_from_rest(radians(_SWING), _FREQUENCY, _CYCLES / _FREQUENCY)
    return subject.run(excitation, _BACKLASH, ("fin_angle", "motor_angle")).finished()


def _slow(runs: Runs) -> str:
    gap = runs.of("elastic").values["drive_line.backlash"]
    return (f"{runs.values['friction.temperature']:g} °C · command: sine of {_SWING:g}° at {_FREQUENCY:g} Hz · load: "
            f"{_BACKLASH['friction.fin_coulomb']:g} N.m of friction at the fin (estimate) · actuator: elastic, with a "
            f"gap of {1e3 * gap:.3g} mm at the nut (estimate)")


def two_encoders(runs: Runs) -> Shown:
    """Show the fin angles from the encoders on fin and motor, and their difference (Figure 3.37)."""
    columns, p = _backlash(runs), runs.parameters.nested()
    time, direct = columns["time"], np.degrees(columns["fin_angle"])
    indirect = np.degrees(physics.fin_angle(ARRAYS, p, physics.lever_tangent(ARRAYS, p, columns["motor_angle"])))
    return Shown(_slow(runs), panels([
        Panel("fin angle [deg]", [Line(time, direct, "direct"), Line(time, indirect, "through the motor",
                                                                    {"linestyle": (0, (4, 2))})]),
        Panel("difference [deg]", [Line(time, direct - indirect)])], "time [s]"),
        "In either direction the direct angle lags the angle through the motor by half the gap and the twist of the "
        "drive line.",
        Table(("", "value"), (("difference, peak to peak [deg]", float(np.ptp((direct - indirect)[time > 1.0]))),)),
        "the motion and the load, which are estimates here. Counts of the encoders are left out.")


def backlash(runs: Runs) -> Shown:
    """Show the backlash that `emcas identify backlash` finds in the motion of Figure 3.37 (Figure 3.38)."""
    columns = _backlash(runs)
    with TemporaryDirectory() as folder:
        record = Path(folder) / "backlash.csv"
        np.savetxt(record, np.column_stack([columns[name] for name in ("time", "motor_angle", "fin_angle")]),
                   delimiter=",", header="time [s],motor_angle [rad],fin_angle [rad]", comments="")
        try:
            identified = identification.identify([record], runs.parameters)
        except EmcasError as error:  # without the folder, whose name is random
            raise EmcasError(str(error).replace(str(record), record.name)) from error
        drawing = next(iter(identified.drawings()))
    gap, p = identified[identification.GAP], runs.of("elastic").parameters.nested()
    play = degrees(p.drive_line.backlash / p.kinematics.moment_arm * np.cos(p.kinematics.initial_angle) ** 2)
    return Shown(_slow(runs), drawing.figure, drawing.caption,
                 Table(("", "value"), (("identified [deg]", gap.value), ("the gap itself, at fin angle 0 [deg]", play),
                                       ("required accuracy (Table 2) [deg]", 0.2))),
                 "the measured backlash. It was much smaller than the accuracy, and the thesis's model leaves it out.")


def encoder(runs: Runs) -> Shown:
    """Show the true fin angle, and the fin angle that the controllers read (Figure 5.15)."""
    run = runs.run(sine_from_rest(radians(0.05), 2.0, 1.0))
    p, time = runs.parameters.nested(), run.columns["time"]
    count = float(sensors.resolution(p))
    at_fin = count if p.encoder.on_fin else count * p.screw.lead / p.kinematics.moment_arm * np.cos(
        p.kinematics.initial_angle) ** 2
    rows = (("pulses a turn", float(p.encoder.pulses)), ("edge multiplier", float(p.encoder.multiplier)),
            ("a count [deg]", degrees(count)), ("a count at the fin, at fin angle 0 [deg]", degrees(float(at_fin))),
            ("a count each sample, as fin rate [deg/s]", degrees(float(at_fin)) / p.controller.sample_time))
    return Shown(runs.conditions("sine of 0.05° at 2 Hz"), panels([Panel("fin angle [deg]", [
        command_of(run), angle(run.columns, "true"),
        Line(time, np.degrees(run.columns["measured_fin_angle"]), "as read", {"drawstyle": "steps-post"})])],
        "time [s]", (0.0, 0.6)),
        "The encoder's whole counts, converted to fin angle.", Table(("", "value"), rows),
        "all readings: the thesis shows only the block that decodes the encoder.")
