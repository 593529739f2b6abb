"""The figures of an analysis with their units, for JSON, and its page."""

from __future__ import annotations

from math import degrees, log10, pi
from pathlib import Path
from typing import Any

import numpy as np

from ... import __version__
from ...bench import writers
from ...bench.linear.frequency import continuous_poles
from ...bench.linear.systems import System
from ...figures import plots
from ...motions import RATED
from ...pages.page import write_page
from . import final_values
from .analyse import Analysis, ClosedLoop
from .modes import Modes
from .pictures import drawings, unseen
from .sweep import LIMITS


def figures_of(analysis: Analysis) -> dict[str, Any]:
    """Return all figures as nested dictionaries, units in the names; None if it does not exist or is unlimited."""
    actuator, thesis, locus = analysis.actuator, analysis.thesis, analysis.locus
    point = actuator.point
    plain: dict[str, Any] = writers.plain({
        "emcas": __version__,
        "model": actuator.actuator.name,
        "left_out": analysis.left_out,
        "operating_point": {
            "fin_angle_deg": degrees(point.fin_angle), "aero_torque_nm": point.aero_torque, "ratio": point.ratio,
            "motor_angle_rad": point.motor_angle, "current_a": point.current, "voltage_v": point.voltage,
            "drive_reference_v" if "drive" in actuator.reference_name else "reference": point.reference},
        "linear": _loop(analysis.linear) | {"transfer_function": _state_space(analysis.linear.system)},
        "thesis_linear": _loop(thesis) if thesis else None,
        "final_values": {
            "command_step_deg": final_values.COMMAND, "load_step_nm": RATED,
            **{row.name.lower().replace(" ", "_"): {
                "ki": row.ki, "stable": row.stable, "command_error_deg": row.command_error,
                "load_error_deg": row.load_error, "slowest_time_constant_s": row.slowest}
               for row in analysis.final_values}},
        "sweep": [{"amplitude_deg": degrees(s.amplitude), "bandwidth_3db_hz": s.response.bandwidth,
                   "bandwidth_90deg_hz": s.response.phase_bandwidth,
                   "limit_onset_hz": {name: s.onset(name) for name in LIMITS[:len(s.active)]},
                   "frequency_hz": s.response.frequency, "gain_db": s.response.gain_db,
                   "phase_deg": np.degrees(s.response.phase),
                   "limit_share": dict(zip(LIMITS, s.active))} for s in analysis.sweeps],
        "modes": _rod(*analysis.modes) if analysis.modes else None,
        "envelope": _envelope(analysis),
        "capability": _capability(analysis),
        "locus": {"parameter": locus.name, "unit": locus.unit, "value": locus.nominal,
                  "tried": [locus.values[0], locus.values[-1]], "stable": locus.stable_range},
        "steps": [{"step_deg": s.size, "largest_difference_percent": s.difference,
                   "rise_time_linear_s": s.metrics_linear["rise_time"],
                   "rise_time_nonlinear_s": s.metrics_nonlinear["rise_time"],
                   "overshoot_linear_percent": 100.0 * s.metrics_linear["overshoot"],
                   "overshoot_nonlinear_percent": 100.0 * s.metrics_nonlinear["overshoot"]} for s in analysis.steps],
    })
    return plain


def _loop(loop: ClosedLoop) -> dict[str, Any]:
    tables = {name: {"gain_margin_db": m.gain_db, "phase_margin_deg": degrees(m.phase), "delay_margin_s": m.delay,
                     "gain_crossover_hz": m.gain_crossover, "phase_crossover_hz": m.phase_crossover,
                     "gain_reduction_margin_db": 20.0 * log10(m.reduction) if m.reduction else None,
                     "modulus_margin": m.modulus} for name, m in loop.margins.items()}
    poles = sorted(continuous_poles(loop.system), key=abs)
    return {"bandwidth_3db_hz": loop.command.bandwidth, "bandwidth_90deg_hz": loop.command.phase_bandwidth,
            "peak_db": np.max(loop.command.gain_db),
            **{key: tables["reference"][key] for key in ("gain_margin_db", "phase_margin_deg", "delay_margin_s")},
            "loops": tables,
            "modes": [{"frequency_hz": abs(s) / (2.0 * pi), "damping_ratio": -s.real / abs(s)}
                      for s in poles if s.imag >= 0.0]}


def _state_space(system: System) -> dict[str, Any]:
    return {"inputs": system.input_labels, "outputs": system.output_labels, "sample_time_s": system.dt,
            "A": system.A, "B": system.B, "C": system.C, "D": system.D}


def _rod(here: Modes, thesis: Modes) -> dict[str, Any]:
    def common(modes: Modes) -> dict[str, float]:
        return {"axial_hz": modes.axial, "torsional_hz": modes.torsional,
                "axial_over_bandwidth": modes.ratios[0], "torsional_over_bandwidth": modes.ratios[1]}

    return {**common(here), "inertia_kgm2": here.inertia, "mass_kg": here.mass,
            "thesis": {**common(thesis), "axial_rad_per_s_over_hz": thesis.slipped[0],
                       "torsional_rad_per_s_over_hz": thesis.slipped[1], "bandwidth_hz": thesis.bandwidth}}


def _envelope(analysis: Analysis) -> dict[str, Any] | None:
    if (e := analysis.envelope) is None:
        return None
    return {"stall_torque_nm": e.stall_torque, "no_load_speed_rad_per_s": e.no_load_speed,
            "integral_time_s": e.integral_time, "speed_rad_per_s": e.speed, "torque_nm": e.highest,
            "prompt_torque_nm": e.prompt}


def _capability(analysis: Analysis) -> dict[str, Any] | None:
    """Return the capability in both directions: the smaller of the two."""
    if (c := analysis.capability) is None:
        return None
    moments = {"stall_torque_nm": c.stall, "held_torque_nm": c.held}
    rates = {"rate": c.rate, "rate_loaded": c.rate_loaded, "free_rate": c.free_rate,
             "free_rate_loaded": c.free_rate_loaded}
    return {"fin_angle_deg": np.degrees(c.fin_angle), "ratio": c.ratio, "load_nm": RATED,
            **{name: np.min(both, axis=0) for name, both in moments.items()},
            **{f"{name}_deg_per_s": np.degrees(np.min(both, axis=0)) for name, both in rates.items()}}


def write_report(analysis: Analysis, path: Path) -> None:
    """Write the page; the same analysis gives the same bytes."""
    f, reference = figures_of(analysis), analysis.actuator.reference_name
    margins = f["linear"]["loops"]
    named = {"reference": f"{reference} u", "position": "position", "velocity": "velocity (position loop open)",
             "current": "current (outer loops open)"}
    loops = [(label, margins[name]) for name, label in named.items() if name in margins]
    if f["thesis_linear"]:
        loops.append((f"{reference} u, thesis’s model", f["thesis_linear"]["loops"]["reference"]))
    finals = [(label, f["final_values"][name]) for name, label in (("p", "P"), ("pi", "PI"), ("as_set", "as set"))
              if name in f["final_values"]]
    write_page(path, "studies/analysis/page.html.j2", [analysis.parameters], f=f, loops=loops,
                       finals=finals, actuator=analysis.actuator.actuator, reference=reference,
                       small=unseen(analysis.actuator.actuator), pictures=plots.pictures(drawings(analysis)))
