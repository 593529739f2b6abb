"""Everything `emcas analyse` finds out about a parameter set, and its JSON."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from math import degrees, isfinite, pi
from pathlib import Path
from typing import Any

import numpy as np

from ... import __version__
from ...actuators import capabilities, get, parts
from ...bench.metrics import FrequencyResponse
from ...errors import EmcasError
from ...parameters import ParameterSet
from ...progress import Progress
from . import capability, final_values, frequency, locus, steps, sweep, thesis
from .linear import LinearActuator, System, sound
from .modes import Modes, load_rod, modes_at, thesis_modes

# Swept to this many times the linear bandwidth, to show what the gain does beyond it.
_BEYOND = 3.0
_STEPS = 7
# Of what not every actuator has: what it needs.
SECTIONS = {
    "thesis_linear": ("the thesis's linear model", (
        capabilities.CASCADE, capabilities.CURRENT_LOOP, capabilities.RIGID_DRIVE_LINE)),
    "modes": ("natural frequencies of the rod", (capabilities.SCREW_DRIVE,)),
    "limits": ("limits in the amplitude sweep", sweep.NEEDS),
    "capability": ("torque-speed capability", capability.NEEDS),
}


@dataclass(frozen=True)
class ClosedLoop:
    """A linear model: its closed loop, responses to command and load (None: the model has none), loops and margins."""

    system: System
    command: FrequencyResponse
    load: FrequencyResponse | None
    loops: Mapping[str, System]
    margins: Mapping[str, frequency.Margins]


@dataclass(frozen=True)
class Limits:
    """What motor and drive can do, and where the reference cases take them."""

    envelope: capability.Envelope
    cases: list[capability.CasePoints]
    fin: capability.Capability


@dataclass(frozen=True)
class Analysis:
    """The findings, each as its module gives it; ``left_out`` says of SECTIONS why there is none, the rest is None.

    ``thesis`` is None also where its model, at fin angle 0, is unstable. ``parameters`` are the sound actuator's.
    """

    parameters: ParameterSet
    actuator: LinearActuator
    linear: ClosedLoop
    left_out: Mapping[str, str]
    thesis: ClosedLoop | None
    final_values: list[final_values.FinalValues]
    sweeps: list[sweep.Sweep]
    modes: tuple[Modes, Modes] | None
    """With the parameter set's inertia, and with the thesis's."""
    capability: Limits | None
    locus: locus.Locus
    steps: list[steps.StepComparison]


def analyse(parameters: ParameterSet, fin_angle: float = 0.0, aero_torque: float = 0.0, rod: Path | None = None,
            locus_name: str | None = None, progress: Progress | None = None) -> Analysis:
    """Analyse a set at rest at `fin_angle` [rad] under `aero_torque` [N.m]; `rod` overrides models/rod.toml.

    Raises EmcasError for an actuator without a sampled position loop, an operating point that cannot be held, an
    unstable loop, a bad file or locus.
    """
    tell: Progress = progress or (lambda name, done, total: None)
    parameters = sound(parameters)
    values, model = parameters.values, parameters.model
    left_out = _left_out(model)
    tell("linear models", 0, _STEPS)
    beam = load_rod(rod)
    actuator = LinearActuator(values, fin_angle, aero_torque, model)
    if not actuator.stable:
        largest = float(np.max(np.abs(actuator.closed.poles())))
        where = f"the linearised loop at {degrees(fin_angle):g} deg"
        cascade = capabilities.CASCADE in actuator.actuator.provides
        if cascade and (values["controller.velocity.kp"] <= 0.0 or values["controller.position.kp"] <= 0.0):
            raise EmcasError(f"{where} does not hold the fin: controller.velocity.kp and controller.position.kp must "
                             "both be above 0")
        remedy = ("controller.velocity.kp, controller.position.kp or controller.position.ki, or shorten "
                  "drive.transport_delay" if cascade else "the gains of its controller")
        raise EmcasError(f"{where} is unstable (a mode grows by {100.0 * (largest - 1.0):.2g} % a sample): lower "
                         f"{remedy}")
    linear = _closed_loop(actuator)
    tell("root locus", 1, _STEPS)
    poles = locus.locus(parameters, locus_name, fin_angle, aero_torque)
    tell("final values", 2, _STEPS)
    finals = final_values.final_values(values, fin_angle, aero_torque, model)
    try:
        tell("capability", 3, _STEPS)
        limits = None if "capability" in left_out else Limits(
            capability.envelope(values, model), capability.case_points(parameters),
            capability.capability(values, model))
        tell("steps", 4, _STEPS)
        compared = steps.comparisons(values, actuator, "thesis_linear" not in left_out)
        crossings = [f for f in (linear.command.bandwidth, linear.command.phase_bandwidth) if isfinite(f)]
        highest = _BEYOND * max(crossings, default=linear.command.frequency[-1] / _BEYOND)
        swept = sweep.sweeps(values, highest, fin_angle, aero_torque, model=model,
                             progress=lambda name, done, total: tell(name, 5, _STEPS))
    except (ArithmeticError, ValueError) as error:
        raise EmcasError(f"the response cannot be computed: {error}") from error
    tell("thesis", 6, _STEPS)
    theirs = None if "thesis_linear" in left_out else _thesis(values)
    modes = None if "modes" in left_out else (modes_at(beam, values, fin_angle, model), thesis_modes(beam))
    return Analysis(parameters, actuator, linear, left_out, theirs, finals, swept, modes, limits, poles, compared)


def _left_out(model: str) -> dict[str, str]:
    actuator = get(model)
    told = {}
    for section, (title, needs) in SECTIONS.items():
        if missing := [need for need in needs if need not in actuator.provides]:
            told[section] = f"{title} left out: needs {missing[0]}, which {actuator.name} has not"
    for extension, why in (("heat", "of a motor at one temperature; emcas envelope has it with heat"),
                           ("efficiency", "of a screw without losses")):
        if extension in parts(model)[1]:
            told.setdefault("capability", f"{SECTIONS['capability'][0]} left out: it is {why}")
    return told


def _closed_loop(actuator: LinearActuator) -> ClosedLoop:
    loops = {name: actuator.loop(name) for name in actuator.loops}
    return ClosedLoop(actuator.closed, frequency.response(actuator.command_to_angle),
                      frequency.response(actuator.load_to_angle), loops,
                      {name: frequency.margins(loop) for name, loop in loops.items()})


def _thesis(values: Mapping[str, Any]) -> ClosedLoop | None:
    system = thesis.closed(values)
    if not np.max(np.abs(system.poles())) < 1.0:
        return None
    loop = thesis.reference_loop(values)
    return ClosedLoop(system, frequency.response(system), None, {"reference": loop},
                      {"reference": frequency.margins(loop)})


def figures(found: Analysis) -> dict[str, Any]:
    """All figures as nested dictionaries; units in the names, None for what does not exist or is unlimited."""
    point = found.actuator.point
    tree: dict[str, Any] = {
        "emcas": __version__,
        "model": found.actuator.actuator.name,
        "left_out": dict(found.left_out),
        "operating_point": {
            "fin_angle_deg": degrees(point.fin_angle), "aero_torque_nm": point.aero_torque, "ratio": point.ratio,
            "motor_angle_rad": point.motor_angle, "current_a": point.current, "voltage_v": point.voltage,
            "drive_reference_v": point.reference},
        "linear": _loop_figures(found.linear) | {"transfer_function": _state_space(found.linear.system)},
        "thesis_linear": _loop_figures(found.thesis) if found.thesis else None,
        "final_values": {
            "command_step_deg": final_values.COMMAND, "load_step_nm": final_values.TORQUE,
            **{row.name.lower().replace(" ", "_"): {
                "ki": row.ki, "stable": row.stable, "command_error_deg": row.command_error,
                "load_error_deg": row.load_error, "slowest_time_constant_s": row.slowest}
               for row in found.final_values}},
        "sweep": [{"amplitude_deg": degrees(s.amplitude), "bandwidth_3db_hz": s.response.bandwidth,
                   "bandwidth_90deg_hz": s.response.phase_bandwidth,
                   "limit_onset_hz": {name: s.onset(name) for name in sweep.LIMITS[:len(s.active)]},
                   "frequency_hz": s.response.frequency, "gain_db": s.response.gain_db,
                   "phase_deg": np.degrees(s.response.phase),
                   "limit_share": dict(zip(sweep.LIMITS, s.active))} for s in found.sweeps],
        "modes": _mode_figures(*found.modes) if found.modes else None,
        **_limit_figures(found.capability),
        "locus": {"parameter": found.locus.name, "unit": found.locus.unit, "value": found.locus.nominal,
                  "tried": [found.locus.values[0], found.locus.values[-1]], "stable": found.locus.stable_range},
        "steps": [{"step_deg": s.size, "largest_difference_percent": s.difference,
                   "rise_time_linear_s": s.metrics_linear.rise_time,
                   "rise_time_nonlinear_s": s.metrics_nonlinear.rise_time,
                   "overshoot_linear_percent": 100.0 * s.metrics_linear.overshoot,
                   "overshoot_nonlinear_percent": 100.0 * s.metrics_nonlinear.overshoot} for s in found.steps],
    }
    plain: dict[str, Any] = _plain(tree)
    return plain


def _mode_figures(own: Modes, theirs: Modes) -> dict[str, Any]:
    return {"axial_hz": own.axial, "torsional_hz": own.torsional, "inertia_kgm2": own.inertia, "mass_kg": own.mass,
            "axial_over_bandwidth": own.ratios[0], "torsional_over_bandwidth": own.ratios[1],
            "thesis": {"axial_hz": theirs.axial, "torsional_hz": theirs.torsional,
                       "axial_over_bandwidth": theirs.ratios[0], "torsional_over_bandwidth": theirs.ratios[1],
                       "axial_rad_per_s_over_hz": theirs.slipped[0],
                       "torsional_rad_per_s_over_hz": theirs.slipped[1], "bandwidth_hz": theirs.bandwidth}}


def _limit_figures(limits: Limits | None) -> dict[str, Any]:
    if limits is None:
        return {"envelope": None, "capability": None}
    env, cap = limits.envelope, limits.fin
    return {
        "envelope": {"stall_torque_nm": env.stall_torque, "no_load_speed_rad_per_s": env.no_load_speed,
                     "integral_time_s": env.integral_time, "speed_rad_per_s": env.speed, "torque_nm": env.highest,
                     "prompt_torque_nm": env.prompt},
        "capability": {"fin_angle_deg": np.degrees(cap.fin_angle), "ratio": cap.ratio,
                       "stall_torque_nm": np.min(cap.stall, axis=0), "held_torque_nm": np.min(cap.held, axis=0),
                       "rate_deg_per_s": np.degrees(np.min(cap.rate, axis=0)),
                       "rate_loaded_deg_per_s": np.degrees(np.min(cap.rate_loaded, axis=0)),
                       "free_rate_deg_per_s": np.degrees(np.min(cap.free_rate, axis=0)),
                       "free_rate_loaded_deg_per_s": np.degrees(np.min(cap.free_rate_loaded, axis=0)),
                       "load_nm": final_values.TORQUE}}


def _loop_figures(loop: ClosedLoop) -> dict[str, Any]:
    tables = {name: {"gain_margin_db": m.gain_db, "phase_margin_deg": degrees(m.phase), "delay_margin_s": m.delay,
                     "gain_crossover_hz": m.gain_crossover, "phase_crossover_hz": m.phase_crossover,
                     "gain_reduction_margin_db": 20.0 * np.log10(m.reduction) if m.reduction else None,
                     "modulus_margin": m.modulus} for name, m in loop.margins.items()}
    poles = np.log(loop.system.poles().astype(complex)[np.abs(loop.system.poles()) > 1e-9]) / float(loop.system.dt)
    slow = poles[np.argsort(np.abs(poles))]
    return {"bandwidth_3db_hz": loop.command.bandwidth, "bandwidth_90deg_hz": loop.command.phase_bandwidth,
            "peak_db": float(np.max(loop.command.gain_db)),
            **{key: tables["reference"][key] for key in ("gain_margin_db", "phase_margin_deg", "delay_margin_s")},
            "loops": tables,
            "modes": [{"frequency_hz": abs(s) / (2.0 * pi), "damping_ratio": -s.real / abs(s)}
                      for s in slow if s.imag >= 0.0]}


def _state_space(system: System) -> dict[str, Any]:
    return {"inputs": system.input_labels, "outputs": system.output_labels, "sample_time_s": system.dt,
            "A": system.A, "B": system.B, "C": system.C, "D": system.D}


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _plain(each) for key, each in value.items()}
    if isinstance(value, (list, tuple, np.ndarray)):
        return [_plain(each) for each in value]
    if isinstance(value, (bool, np.bool_, str)) or value is None:
        return bool(value) if isinstance(value, np.bool_) else value
    number = float(value) + 0.0  # no negative zero
    return number if isfinite(number) else None


def write_json(found: Analysis, path: Path) -> None:
    """Write `figures` to a file."""
    path.write_text(json.dumps(figures(found), indent=1, allow_nan=False) + "\n", encoding="utf-8")
