"""The JSON figures, the tables and the page of an analysis."""

from __future__ import annotations

from math import degrees, pi
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ... import __version__
from ...bench import writers
from ...bench.linear.frequency import continuous_poles
from ...motions import RATED
from ...pages.numbers import number
from ...pages.page import write_page
from ...plotting import plots
from . import final_values
from .analyse import Analysis, ClosedLoop
from .pictures import drawings, neglected
from .sweep import LIMITS


def figures_of(analysis: Analysis) -> dict[str, Any]:
    """Return all figures in nested dictionaries with units in the keys; None for a missing or infinite figure."""
    actuator, thesis, locus = analysis.actuator, analysis.thesis, analysis.locus
    point, system = actuator.point, analysis.linear.system
    return dict(writers.plain({
        "emcas": __version__,
        "model": actuator.actuator.name,
        "left_out": analysis.left_out,
        "operating_point": {
            "fin_angle_deg": degrees(point.fin_angle), "aero_torque_nm": point.aero_torque, "ratio": point.ratio,
            "motor_angle_rad": point.motor_angle, "current_a": point.current, "voltage_v": point.voltage,
            "drive_reference_v" if "drive" in actuator.reference_name else "reference": point.reference},
        "linear": _loop(analysis.linear) | {"transfer_function": {
            "inputs": system.input_labels, "outputs": system.output_labels, "sample_time_s": system.dt,
            "A": system.A, "B": system.B, "C": system.C, "D": system.D}},
        "thesis_linear": _loop(thesis) if thesis else None,
        "final_values": {
            "command_step_deg": final_values.COMMAND, "load_step_nm": analysis.load,
            **analysis.final_values},
        "sweep": [{"amplitude_deg": degrees(s.amplitude), "bandwidth_3db_hz": s.response.bandwidth,
                   "bandwidth_90deg_hz": s.response.phase_bandwidth, "bandwidths": s.response.stated,
                   "limit_onset_hz": {name: s.onset(name) for name in LIMITS[:len(s.active)]},
                   "frequency_hz": s.response.frequency, "gain_db": s.response.gain_db,
                   "phase_deg": np.degrees(s.response.phase),
                   "limit_share": dict(zip(LIMITS, s.active))} for s in analysis.sweeps],
        "modes": analysis.modes,
        "envelope": analysis.envelope,
        "capability": _capability(analysis),
        "locus": {"parameter": locus.name, "unit": locus.unit, "value": locus.nominal,
                  "tried": [locus.values[0], locus.values[-1]], "stable": locus.stable_range},
        "steps": [{"step_deg": s.size, "largest_difference_percent": s.difference,
                   "rise_time_linear_s": s.metrics_linear["rise_time"],
                   "rise_time_nonlinear_s": s.metrics_nonlinear["rise_time"],
                   "overshoot_linear_percent": 100.0 * s.metrics_linear["overshoot"],
                   "overshoot_nonlinear_percent": 100.0 * s.metrics_nonlinear["overshoot"]} for s in analysis.steps],
    }))


def _loop(loop: ClosedLoop) -> dict[str, Any]:
    tables = {name: {"gain_margin_db": m.gain_db, "phase_margin_deg": degrees(m.phase), "delay_margin_s": m.delay,
                     "gain_margin_up_db": m.up_db, "phase_crossover_hz": m.phase_crossover,
                     "gain_margin_down_db": m.down_db, "reduction_crossover_hz": m.reduction_crossover,
                     "gain_crossover_hz": m.gain_crossover, "modulus_margin": m.modulus}
              for name, m in loop.margins.items()}
    poles = sorted(continuous_poles(loop.system), key=abs)
    return {"bandwidth_3db_hz": loop.command.bandwidth, "bandwidth_90deg_hz": loop.command.phase_bandwidth,
            "bandwidths": loop.command.stated, "peak_db": np.max(loop.command.gain_db),
            **{key: tables["reference"][key] for key in (
                "gain_margin_db", "gain_margin_up_db", "gain_margin_down_db", "phase_margin_deg", "delay_margin_s")},
            "loops": tables,
            "modes": [{"frequency_hz": abs(s) / (2.0 * pi), "damping_ratio": -s.real / abs(s)}
                      for s in poles if s.imag >= 0.0]}


def _capability(analysis: Analysis) -> dict[str, Any] | None:
    """Return the smaller capability of both directions; None if it is left out."""
    if (c := analysis.capability) is None:
        return None
    moments, rates = ("stall", "held"), ("rate", "rate_loaded", "free_rate", "free_rate_loaded")
    smaller = {name: np.min(getattr(c, name), axis=0) for name in (*moments, *rates)}
    return {"fin_angle_deg": np.degrees(c.fin_angle), "ratio": c.ratio, "load_nm": RATED,
            **{f"{name}_torque_nm": smaller[name] for name in moments},
            **{f"{name}_deg_per_s": np.degrees(smaller[name]) for name in rates}}


class Rows(NamedTuple):
    """A table for page and terminal; columns whose names begin with ">" are aligned as numbers, None is no value."""

    caption: str
    columns: list[str]
    rows: list[list[Any]]


def tables(f: dict[str, Any], reference: str) -> dict[str, Rows]:
    """Return the tables of the figures `f` by section; `reference` names the controllers' output."""
    here, thesis, compared = f["linear"], f["thesis_linear"], "thesis_linear" not in f["left_out"]
    sections = {"linear": Rows("Bandwidth and peak of the linear models", [
        "", ">linearised here", *[">thesis’s model"] * compared], [
            [label, here_value, *[thesis_value if thesis else "unstable"] * compared]
            for label, here_value, thesis_value in zip(
                ("bandwidth, -3 dB [Hz]", "bandwidth, -90 deg [Hz]", "largest closed-loop gain [dB]"),
                *([*loop["bandwidths"], loop["peak_db"]] for loop in (here, thesis or here)), strict=True)])}
    labels = {"reference": f"{reference} u", "position": "position", "velocity": "velocity (position loop open)",
              "current": "current (outer loops open)"}
    loops = {label: here["loops"][name] for name, label in labels.items() if name in here["loops"]}
    if thesis:
        loops[f"{reference} u, thesis’s model"] = thesis["loops"]["reference"]
    rows = (("gain margin up [dB]", "gain_margin_up_db"), ("at [Hz]", "phase_crossover_hz"),
            ("gain margin down [dB]", "gain_margin_down_db"), ("at [Hz]", "reduction_crossover_hz"),
            ("phase margin [deg]", "phase_margin_deg"), ("at [Hz]", "gain_crossover_hz"),
            ("delay margin [ms]", "delay_margin_s"), ("smallest |1 + L|", "modulus_margin"))
    sections["margins"] = Rows("Stability margins, loop by loop", [
        "loop broken at", *(f">{label}" for label in loops)], [
            [label, *(x[key] and (1e3 if "[ms]" in label else 1.0) * x[key] for x in loops.values())]
            for label, key in rows])
    finals = f["final_values"]
    sections["finals"] = Rows("Errors that remain after steps of command and load", [
        "position controller", f">after a command of {finals['command_step_deg']:g} deg [deg]",
        f">after a load of {finals['load_step_nm']:g} N.m [deg]", ">simulated with this load [deg]",
        ">slowest time constant [s]"], [
            [label.format(number(x["ki"])) + ("" if x["stable"] else " (unstable)"), x["command_error_deg"],
             x["load_error_deg"], x["simulated_load_error_deg"], x["slowest_time_constant_s"]] for key, label in (
                ("p", "P"), ("pi", "PI, ki = {} 1/s2"), ("as_set", "as set")) if (x := finals.get(key))])
    if rod := f["modes"]:
        sections["modes"] = Rows("Natural frequencies of motor shaft and screw", [
            "motor shaft and screw as a rod", ">axial [Hz]", ">torsional [Hz]",
            ">over the bandwidth"], [
                [label, x["axial_hz"], x["torsional_hz"], f"{number(x['axial_over_bandwidth'])} and "
                 f"{number(x['torsional_over_bandwidth'])} × {x['bandwidth_hz']:g} Hz"] for label, x in (
                    (f"inertia of this parameter set, {rod['inertia_kgm2']:.3g} kg.m2", rod),
                    ("Table 1 of the thesis", rod["thesis"]))])
    limits = () if "limits" in f["left_out"] else ("rate limited", "current", "voltage", "analogue reference")
    sections["sweep"] = Rows(f"Bandwidth{' and first limit' * bool(limits)} against amplitude", [
        ">amplitude [deg]", ">-3 dB [Hz]", ">-90 deg [Hz]", *(f">{limit} from [Hz]" for limit in limits)], [
            [s["amplitude_deg"], *s["bandwidths"], *s["limit_onset_hz"].values()] for s in f["sweep"]])
    return sections


def write_report(analysis: Analysis, path: Path) -> None:
    """Write the page. The same analysis, command and date give the same bytes."""
    f, actuator = figures_of(analysis), analysis.actuator
    write_page(path, "studies/analysis/page.html.j2", [analysis.parameters], f=f,
               tables=tables(f, actuator.reference_name), actuator=actuator.actuator, reference=actuator.reference_name,
               small=neglected(actuator.actuator, analysis.parameters.values),
               pictures=plots.pictures(drawings(analysis)))
