"""The variable table: the one home of names, units, limits and descriptions.

Model description, parameter files, kernels and documentation are generated from
it. Values of parameters live in ``models/emcas.toml``, each with its source.
Names are a contract: one that has shipped is never renamed.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, radians
from typing import Literal

Kind = Literal["Real", "Integer", "Boolean", "Enumeration"]
Causality = Literal["input", "output", "parameter"]
Variability = Literal["continuous", "discrete", "fixed", "tunable"]


@dataclass(frozen=True)
class Variable:
    """One scalar of the interface, in the unit named (see :mod:`emcas_fmu.units`).

    ``minimum``/``maximum`` are inclusive; infinite where physics knows no limit.
    ``start`` is given for inputs only: a parameter's comes from its file.
    ``key`` names the parameter-file entry a start value is taken from, where the
    variable itself is no parameter. ``items`` are an enumeration's from 1 on, each with what it means.
    """

    name: str
    kind: Kind
    causality: Causality
    variability: Variability
    unit: str
    description: str
    minimum: float = -inf
    maximum: float = inf
    nominal: float | None = None
    start: float | bool | None = None
    key: str | None = None
    items: tuple[tuple[str, str], ...] = ()


def _input(name: str, unit: str, description: str, **more: object) -> Variable:
    return Variable(name, "Real", "input", "continuous", unit, description, **{"start": 0.0, **more})  # type: ignore[arg-type]


def _output(name: str, unit: str, description: str, nominal: float) -> Variable:
    return Variable(name, "Real", "output", "continuous", unit, description, nominal=nominal)


def _flag(name: str, description: str) -> Variable:
    return Variable(name, "Boolean", "output", "discrete", "", description)


def _fixed(name: str, unit: str, minimum: float, maximum: float, description: str) -> Variable:
    return Variable(name, "Real", "parameter", "fixed", unit, description, minimum, maximum)


def _tunable(name: str, unit: str, minimum: float, maximum: float, description: str) -> Variable:
    return Variable(name, "Real", "parameter", "tunable", unit, description, minimum, maximum)


def _switch(name: str, description: str) -> Variable:
    return Variable(name, "Boolean", "parameter", "fixed", "", description)


INPUTS: tuple[Variable, ...] = (
    _input("fin_command", "rad", "commanded fin angle; clipped to +-command.limit", nominal=0.1),
    _input("aero_torque", "N.m", "aerodynamic hinge moment on the fin, positive along positive fin_angle "
           "(a restoring moment is negative at positive angle)", nominal=100.0),
    _input("acceleration.x", "m/s2", "vehicle acceleration along body x (forward, along the screw)", nominal=10.0),
    _input("acceleration.y", "m/s2", "vehicle acceleration along body y", nominal=10.0),
    _input("acceleration.z", "m/s2", "vehicle acceleration along body z (down)", nominal=10.0),
    _input("attitude.roll", "rad", "vehicle roll angle, for gravity"),
    _input("attitude.pitch", "rad", "vehicle pitch angle, for gravity"),
    _input("attitude.yaw", "rad", "vehicle yaw angle (gravity does not depend on it)"),
    _input("supply_voltage", "V", "bus voltage of the drive", minimum=0.0, maximum=1000.0, nominal=10.0,
           start=None, key="drive.supply_voltage"),
    Variable("enable", "Boolean", "input", "discrete", "",
             "false opens the drive's bridge: the fin is driven by loads and friction only", start=True),
)

OUTPUTS: tuple[Variable, ...] = (
    _output("fin_angle", "rad", "fin angle", 0.1),
    _output("fin_rate", "rad/s", "fin angular rate", 1.0),
    _output("motor_angle", "rad", "motor angle", 10.0),
    _output("motor_speed", "rad/s", "motor speed", 100.0),
    _output("motor_current", "A", "motor current", 10.0),
    _output("motor_voltage", "V", "voltage the drive applies (back-EMF while disabled)", 10.0),
    _output("motor_torque", "N.m", "motor torque", 1.0),
    _output("drive_reference", "V", "analogue reference held by the controller's DAC", 1.0),
    _output("nut_position", "m", "nut displacement from the assembly position", 0.01),
    _output("hinge_torque", "N.m", "total external moment about the hinge (aerodynamic + gravity + inertial)", 100.0),
    _output("supply_power", "W", "electrical power drawn by the motor; negative while regenerating", 100.0),
    _output("tracking_error", "rad", "clipped command minus fin angle", 0.01),
    _output("measured_fin_angle", "rad", "fin angle the controller reads from its encoder at the last sample", 0.1),
    _flag("saturated", "any limit active: command, speed, DAC, current or voltage"),
    _flag("at_stop", "the fin rests against a mechanical stop"),
)

_COULOMB = tuple(
    _fixed(f"friction.coulomb.{direction}[{power}]", "N.m", -10.0, 10.0,
           f"Coulomb friction at the motor for {direction} motion: coefficient of (fin_angle/20 deg)^{power}")
    for direction in ("positive", "negative") for power in range(7)
)
_CENTERS = tuple(
    _fixed(f"center_of_mass.{part}.{axis}", "m", -5.0, 5.0,
           f"centre of mass of the {part} from the hinge at fin_angle 0, along {axis}")
    for part in ("fin", "shaft", "fork") for axis in ("x", "z")
)

PARAMETERS: tuple[Variable, ...] = (
    _fixed("kinematics.moment_arm", "m", 1e-3, 1.0, "distance of the hinge from the screw axis, d"),
    _fixed("kinematics.initial_angle", "rad", radians(-60), radians(60), "assembly angle of the lever at fin_angle 0"),
    _fixed("screw.lead", "m/rad", 1e-6, 1e-1, "screw lead per radian"),
    _fixed("inertia.motor", "kg.m2", 1e-9, 10.0, "rotor inertia"),
    _fixed("inertia.screw", "kg.m2", 0.0, 10.0, "screw inertia about its axis"),
    _fixed("inertia.fin", "kg.m2", 1e-9, 1e3, "fin inertia about the hinge"),
    _fixed("inertia.shaft", "kg.m2", 0.0, 1e3, "fin shaft inertia about the hinge"),
    _fixed("inertia.fork", "kg.m2", 0.0, 1e3, "fork inertia about the hinge"),
    _fixed("mass.nut", "kg", 0.0, 1e3, "nut mass"),
    _fixed("mass.fin", "kg", 0.0, 1e3, "fin mass"),
    _fixed("mass.shaft", "kg", 0.0, 1e3, "fin shaft mass"),
    _fixed("mass.fork", "kg", 0.0, 1e3, "fork mass"),
    *_CENTERS,
    _fixed("motor.torque_constant", "N.m/A", 1e-6, 100.0, "torque constant"),
    _fixed("motor.back_emf_constant", "V.s/rad", 0.0, 100.0, "back-EMF constant"),
    _fixed("motor.resistance", "Ohm", 1e-6, 1e4, "winding resistance"),
    _fixed("motor.inductance", "H", 1e-7, 10.0, "winding inductance"),
    _fixed("drive.current_limit", "A", 1e-3, 1e4, "largest current reference"),
    _fixed("drive.current_gain", "A/V", 1e-3, 1e4, "current demanded per volt of reference"),
    _fixed("drive.current_offset", "A", -1e3, 1e3, "current demanded at zero reference"),
    _fixed("drive.transport_delay", "s", 0.0, 0.1, "delay from DAC to current reference"),
    _fixed("drive.kp", "V/A", 1e-6, 1e4, "proportional gain of the current loop"),
    _fixed("drive.ki", "V/(A.s)", 0.0, 1e6, "integral gain of the current loop"),
    _fixed("drive.reference_limit", "V", 1e-3, 1e3, "largest DAC output"),
    _fixed("controller.sample_time", "s", 5e-5, 0.1, "sample time of the digital controllers"),
    _tunable("controller.position.kp", "1/s", 0.0, 1e5, "proportional gain of the position loop"),
    _tunable("controller.position.ki", "1/s2", 0.0, 1e6, "integral gain of the position loop (0: P control)"),
    _tunable("controller.velocity.kp", "V.s/rad", 0.0, 1e4, "proportional gain of the velocity loop"),
    _tunable("controller.antiwindup", "1/s", 0.0, 1e5, "back-calculation gain of the anti-windup"),
    _fixed("controller.speed_limit", "rad/s", 1e-3, 1e5, "largest motor speed reference"),
    _fixed("command.limit", "rad", radians(0.1), radians(80), "largest fin command"),
    _fixed("fin.stop_angle", "rad", radians(0.1), radians(80), "mechanical stop, both sides, inelastic"),
    _fixed("fin.start_angle", "rad", radians(-80), radians(80), "fin angle at the start, at rest"),
    _fixed("friction.viscous.positive", "N.m.s/rad", 0.0, 10.0, "viscous friction at the motor, positive motion"),
    _fixed("friction.viscous.negative", "N.m.s/rad", 0.0, 10.0, "viscous friction at the motor, negative motion"),
    *_COULOMB,
    _fixed("friction.cold_viscous_ratio", "1", 0.0, 100.0, "viscous friction at -6 degC over that at 24 degC"),
    _fixed("friction.cold_coulomb_ratio", "1", 0.0, 100.0, "Coulomb friction at -6 degC over that at 24 degC"),
    _tunable("friction.temperature", "degC", -100.0, 200.0, "ambient temperature; held outside -6..24 degC"),
    _fixed("friction.fin_viscous", "N.m.s/rad", 0.0, 1e4, "viscous friction about the hinge"),
    _fixed("friction.fin_coulomb", "N.m", 0.0, 1e4, "Coulomb friction about the hinge"),
    _tunable("compensation.gain", "1", 0.0, 10.0, "share of the Coulomb friction fed forward (0: none)"),
    _tunable("compensation.speed_band", "rad/s", 1e-6, 1e4, "speed reference at which compensation is full"),
    _switch("encoder.enabled", "false feeds true angle and speed to the controllers"),
    Variable("encoder.pulses", "Integer", "parameter", "fixed", "1", "pulses per revolution", 1, 1_000_000),
    Variable("encoder.multiplier", "Integer", "parameter", "fixed", "1", "edge multiplier: 1, 2 or 4", 1, 4),
    _switch("encoder.on_fin", "true: the encoder sits on the fin shaft; false: on the motor"),
    _switch("loads.gravity", "true: gravity acts on fin, shaft, fork and nut (wire the attitude inputs)"),
    _fixed("mounting.azimuth", "rad", radians(-360), radians(360), "roll of the fin's frame about body x"),
    _fixed("solver.max_tick", "s", 1e-7, 1e-3, "longest internal tick"),
)

VARIABLES: tuple[Variable, ...] = INPUTS + OUTPUTS + PARAMETERS

# Entries of a parameter file that are no parameter of the FMU: the start of an input.
START_ENTRIES: tuple[Variable, ...] = tuple(
    Variable(v.key, v.kind, "parameter", "fixed", v.unit, f"start value of {v.name}", v.minimum, v.maximum)
    for v in INPUTS if v.key is not None
)
FILE_ENTRIES: tuple[Variable, ...] = PARAMETERS + START_ENTRIES
