"""Runs of the table of trajectories: every actuator and extension under one varied history, in Python."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from functools import cache
from math import fsum, radians, sin
from typing import Any

import numpy as np

from emcas_fmu.actuators import EXTENSIONS, NAMES, NONLINEAR, get
from emcas_fmu.errors import EmcasError
from emcas_fmu.extensions import fault_list
from emcas_fmu.parameters import ParameterSet, load_parameters
from emcas_fmu.simulation import InputSignal, simulate, simulate_fins

Marks = dict[str, float]
STOP = 0.52  # s, the end of the history

# Parameters whose shipped values remove a term from the equations, with values that include it.
OTHER: Mapping[str, Any] = {
    "center_of_mass.fin.z": 0.011, "center_of_mass.shaft.x": 0.004, "center_of_mass.shaft.z": 0.003,
    "center_of_mass.fork.x": 0.002, "center_of_mass.fork.z": 0.005, "controller.position.velocity_feedforward": 0.3,
    "controller.velocity.ki": 0.4, "controller.load_observer": 60.0, "fin.start_angle": 0.03,
    "friction.fin_viscous": 2.0, "friction.fin_coulomb": 5.0, "encoder.on_fin": True, "loads.gravity": True,
    "mounting.azimuth": 0.7, "mounting.station": 0.5, "command.latency": 2e-3, "command.resolution": 1e-3,
    "command.update_time": 2e-3, "motor.pole_pairs": 5, "motor.back_emf_constant": 0.05,
    "drive.transport_delay": 2.3e-3, "controller.drive_antiwindup": 40.0, "load.torsion_bar": 30.0,
    "drive_line.fork_stiffness": 4e4, "drive_line.shaft_stiffness": 3e4, "drive_line.structure_stiffness": 5e4,
    "drive_line.hinge_damping": 3.0, "worm.starts": 2, "worm.teeth": 50, "drive.current_offset": 0.01,
    "clutch.temperature_coefficient": -2e-3, "efficiency.backward": 0.3, "bypass_valve.opening": 0.1,
    "bypass_valve.opens_disabled": True, "oil.cavitation_pressure": 2e4, "valve.null_shift": 0.02,
    "heat.winding_start_rise": 60.0, "heat.case_start_rise": 40.0, "heat.winding_limit": 105.0, "heat.peak_time": 0.1,
    "mass.shaft": 1.0, "mass.fork": 0.8, "inertia.shaft": 0.004, "inertia.fork": 0.006,  # the default actuator's
    "trajectory.natural_frequency": 120.0, "trajectory.rate_limit": 3.0, "trajectory.acceleration_limit": 150.0,
    "trajectory.jerk_limit": 4e4, "trajectory.tracking_limit": 0.02,
    "motor.asymmetry": 0.1, "controller.ki": 3.0, "controller.dead_band": 2.0, "pwm.limit": 900.0,
    "homing.required": False, "homing.positive_first": False, "supply.one_way": False,
    "sensor.current.offset": 0.7, "sensor.current.gain_error": 0.04, "sensor.encoder.once": 4e-3,
    "sensor.encoder.once_phase": 0.5, "sensor.encoder.twice": 3e-3, "sensor.encoder.twice_phase": 1.2,
    "sensor.encoder.noise": 5e-4, "uneven.load_share": 0.03, "uneven.ripple": 0.2, "uneven.phase": 0.5,
    "inverter.dead_time": 2e-6, "inverter.pole_pairs": 4,
    **{f"deviation.{name}": value for name, value in {
        "kinematics.moment_arm": 0.03, "kinematics.initial_angle": 0.01, "screw.lead": -0.02,
        "motor.torque_constant": 0.04, "mass.fin": 0.2, "friction.coulomb": 0.3, "friction.viscous": 0.4,
        "worm.friction": 0.2, "valve.rated_flow": -0.05}.items()},
    **{f"friction.coulomb.{side}[{k}]": sign * value * 1e-3 for side, sign in (("positive", 1.0), ("negative", -1.2))
       for k, value in ((1, 7.0), (2, 3.0), (3, 2.0), (4, 1.5), (5, 1.0), (6, 0.5))},
}
# No encoder; a cold actuator that soon gets warm.
SWIFT: Mapping[str, Any] = {
    "encoder.enabled": False, "homing.required": False, "heat.continuous_current": 4.0, "friction.temperature": -6.0,
    "command.update_time": 3.4e-3}
# The stops are near, so that homing ends soon.
HOMING: Mapping[str, Any] = {
    "fin.stop_angle": radians(6.0), "command.limit": radians(5.0), "homing.speed": radians(100.0),
    "homing.reference_limit": 5.0, "homing.stall_time": 0.02, "homing.travel_tolerance": radians(1.5),
    "homing.return_tolerance": radians(1.0), "homing.timeout": 0.75}
SETTINGS: Mapping[str, tuple[Mapping[str, Any], float]] = {  # with the communication step [s]
    "shipped": ({}, 1e-3), "other": (OTHER, 0.65e-3), "swift": (SWIFT, 1.3e-3)}
# One actuator for each combination of drive line and states.
KINDS = ("nonlinear", "linear", "second-order", "ristanovic", "elastic", "worm-gear", "clutch", "series-clutch",
         "servo", "electrohydrostatic", "electrohydraulic")
# Limits with which the monitors trip and clear within the history, for models with faults.
WATCHED: Mapping[str, Any] = {
    "monitor.persistence": 3e-3, "monitor.tracking_limit": radians(0.4), "monitor.response": 90.0,
    "monitor.rate": radians(150.0), "monitor.stall_share": 0.3, "monitor.stall_rate": radians(20.0),
    "monitor.current_limit": 2.0, "fault.command_delay.time": 7e-3}
LINE = {"bus.source_resistance": 0.08, "line.accumulator_volume": 2e-4}


def fullest(name: str) -> str:
    """Return an actuator with as many extensions as it may have together."""
    for extension in EXTENSIONS[:-1]:
        try:
            get(f"{name}+{extension}")
        except EmcasError:
            continue
        name += f"+{extension}"
    return name


def models() -> list[str]:
    """Return every actuator, the default one with each extension, and one of each kind with faults and the others."""
    return list(dict.fromkeys([*NAMES, *(f"{NONLINEAR}+{extension}" for extension in EXTENSIONS), "elastic+homing",
                               "elastic+efficiency",
                               *(f"{name}+faults" for name in KINDS), *map(fullest, KINDS)]))


def mark(column: Any) -> float:
    """Return a weighted mean of a column, in which every row has another weight."""
    values = np.asarray(column, dtype=float).tolist()
    return fsum(x * (1.0 + k / len(values)) for k, x in enumerate(values)) / len(values)


def _within(time: float, *spans: tuple[float, float, float]) -> float:
    return next((value for begin, end, value in spans if begin <= time < end), 0.0)


@cache
def command(time: float) -> float:
    """Return the command [rad] of the history: steps, a slew beyond the limit and back, small motion about rest."""
    return radians(_within(time, (0.02, 0.1, 3.0), (0.1, 0.16, -2.0), (0.16, 0.27, 24.0), (0.27, 0.45, -19.0),
                           (0.45, 1.0, 0.3 * sin(120.0 * time))))


@cache
def load(time: float) -> float:
    """Return the load [N.m] in both directions; while the drive is disabled it moves the fin to its stop."""
    return _within(time, (0.05, 0.09, 60.0), (0.11, 0.15, -45.0), (0.19, 0.21, -90.0), (0.32, 0.37, -900.0),
                   (0.37, 0.4, 500.0), (0.48, 0.5, 20.0))


@cache
def supply(time: float) -> float:
    """Return the supply as a share of its start value: it falls, rises and fails for a while."""
    return 1.0 + _within(time, (0.18, 0.21, -0.45), (0.21, 0.24, 0.25), (0.41, 0.425, -0.8), (0.425, 0.43, -1.0))


def history(p: ParameterSet) -> dict[str, InputSignal]:
    """Return the inputs of an actuator through the history."""
    actuator = p.actuator
    inputs: dict[str, InputSignal] = {
        "fin_command": command, "aero_torque": load, "enable": lambda t: not 0.31 <= t < 0.395}
    motion = {"acceleration": (25.0, -14.0, 90.0), "attitude": (0.5, 0.2, -0.3), "angular_rate": (7.0, -4.0, 3.0),
              "angular_acceleration": (150.0, 80.0, -60.0)}
    for group, amounts in motion.items():
        names = ("roll", "pitch", "yaw") if group == "attitude" else ("x", "y", "z")
        inputs |= {f"{group}.{name}": _from(0.06, amount) for name, amount in zip(names, amounts)}
    if actuator.supply is not None:
        start = actuator.supply.input.initial(p.values)
        inputs[actuator.supply.input.name] = lambda t: start * supply(t)
    return inputs | {v.name: _from(0.01, 1.0) for v in actuator.further_inputs}


def _from(begin: float, amount: float) -> Callable[[float], float]:
    return lambda time: amount * (time > begin)


def run(p: ParameterSet, stop: float, step: float, **inputs: InputSignal) -> Marks:
    """Return the mark of each output under inputs, up to `stop` [s] in communication steps of `step` [s]."""
    return _marks(simulate(p.values, stop // step * step, step, "python", p.model, **inputs))


def _marks(columns: Mapping[str, Any]) -> Marks:
    return {name: mark(column) for name, column in columns.items() if name != "time"}


def through(model: str) -> Iterator[tuple[str, Marks]]:
    """Yield the name and marks of each run of a model."""
    p = load_parameters(model=model)
    _, *extensions = model.split("+")
    for setting, (values, step) in SETTINGS.items():
        if extensions != ["faults"] and (setting != "shipped" or len(extensions) < 2):
            chosen = p.with_values(p.having(values))
            yield setting, run(chosen, STOP, step, **history(chosen))
    if extensions == ["homing"]:
        for setting, further in (("homing", {}), ("unverified", {"homing.verify": False}),
                                 ("other way", {"homing.positive_first": False})):
            chosen = p.with_values({**HOMING, **further})
            yield setting, run(chosen, 0.8, 1e-3, fin_command=0.03, home=lambda t: t > 0.01)
        lasting = p.with_values({**HOMING, "homing.required": False})
        yield "obstacle", run(lasting, 0.5, 1e-3, home=lambda t: t > 0.01, aero_torque=lambda t: -400.0 * (t > 0.06))
    if extensions == ["faults"]:
        for index, fault in enumerate(fault_list.possible(get(model.removesuffix("+faults")))):
            scheduled = {f"fault.{fault.name}.begin": 0.065, f"fault.{fault.name}.end": 0.17}
            chosen = p.with_values({**p.having({**OTHER, **WATCHED, "encoder.on_fin": index % 2 == 1}), **scheduled})
            yield fault.name, run(chosen, 0.2, 1e-3, **history(chosen))
    if extensions in ([], ["supply"]):
        yield "three fins", several(p)


def several(p: ParameterSet) -> Marks:
    """Return the marks of three fins with different mountings, on one weak supply line, also with mixed commands."""
    sets = [p.with_values({"mounting.azimuth": azimuth, "loads.gravity": True}) for azimuth in (0.3, 2.2, -1.8)]
    line = {} if p.actuator.supply is None else {v.name: LINE[v.name] for v in p.actuator.supply.line.parameters
                                                 if v.name in LINE}
    mixing: dict[str, InputSignal] = {f"{axis}_command": _from(0.04, amount)
                                      for axis, amount in (("roll", 0.02), ("pitch", -0.03), ("yaw", 0.05))}
    return _marks(simulate_fins([each.values for each in sets], 0.14, 0.7e-3, p.model, line, **history(p), **mixing))
