"""What electromechanical actuators are put together from: groups of parameters, rules and outputs.

An actuator is a tuple of groups (:class:`Parts`). A group has what goes together: parameters, the rules for them,
outputs with their equations. The order of groups is that of their rules; variables stand in the order of the interface
(:data:`PARAMETER_ORDER`, :data:`OUTPUT_ORDER`), those that are not in it behind, as the groups have them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property, wraps
from itertools import pairwise
from math import degrees, inf, radians
from typing import Any, NamedTuple

from ...namespace import Record, with_values
from ...ops.base import Ops, Value
from ...physics import drive, kinematics, mechanics
from ...physics.friction import coulomb_polynomial
from ...rules import ANGLE, SLACK, Rule, in_degrees, when
from ...variables import (
    Terminal,
    Variable,
    integer_parameter,
    parameter,
    real_input,
    real_output,
    switch,
    tunable,
)
from .. import fin_port
from ..declaration import Acting, State, Supply, Values
from . import as_built

# -- states ------------------------------------------------------------------------

MOTION = (State("motor_angle", "rad"), State("motor_speed", "rad/s"))
DRIVE = (State("motor_current", "A"), State("drive_integral", "V", "integral of the current controller, xi"))
CONTROLLER = (State("integral", "rad/s", "integral of the position controller"),
              State("velocity_integral", "V", "integral of the velocity controller"),
              State("target", "rad", "motor angle asked for, lagged by the update time of the command"),
              State("momentum", "N.m.s", "of the load observer"),
              State("counts", "1", "counts of the encoder of position at the last sample"),
              State("motor_counts", "1", "counts of the motor's encoder at the last sample"))

# -- supply ------------------------------------------------------------------------

SUPPLY_VOLTAGE = real_input("supply_voltage", "V", "bus voltage of the drive", minimum=0.0, maximum=1000.0,
                            nominal=30.0, start=None, key="drive.supply_voltage",
                            sheet="drive: supply (DC-link) voltage")
SUPPLY_POWER = real_output("supply_power", "W", "electrical power drawn by the motor; negative while regenerating",
                           1000.0)
INPUT_DESCRIPTIONS = {
    "acceleration.x": "vehicle acceleration along body x (forward, along the screw), where mounting.station "
                      "counts from",
    "angular_acceleration.x":
        "vehicle angular acceleration about body x, d/dt of angular_rate.x; times inertia.motor + inertia.screw it "
        "takes from the motor's torque, whose positive angle is right-handed about body x",
    "enable": "false opens the drive's bridge: the fin is driven by loads and friction only",
}

def _inverse_inductance(ops: Ops, p: Any) -> Value:
    return 1.0 / p.motor.inductance


def transport_delay(ops: Ops, p: Any) -> Value:
    """Return the time [s] from the DAC to the current reference."""
    return p.drive.transport_delay


# K_t i w = K_e w i: the power that leaves the circuit and the one on the shaft.
EQUAL = (("motor.torque_constant", "motor.back_emf_constant"),)
SUPPLY = Supply(SUPPLY_VOLTAGE, SUPPLY_POWER, _inverse_inductance)
TICK_REMEDY = "raise solver.max_tick or motor.inductance, or lower drive.ki"

# -- rules -------------------------------------------------------------------------

TABLE_POINTS = 5
# The lever's tangent grows without bound towards 90 deg.
LARGEST_LEVER_ANGLE = radians(85.0)


def _lever(ops: Ops, p: Any, _: Value) -> tuple[Value, ...]:
    nominal, off = p.kinematics.initial_angle, p.deviation.kinematics.initial_angle
    initial = ops.maximum(ops.fabs(nominal), ops.fabs(nominal + off))
    stop = p.fin.stop_angle
    return (when(ops, initial + stop >= LARGEST_LEVER_ANGLE * (1.0 - SLACK)), initial, in_degrees(initial),
            stop, in_degrees(stop), initial + stop, in_degrees(initial + stop))


def _friction(direction: str) -> Rule:
    def check(ops: Ops, p: Any, share: Value) -> tuple[Value, ...]:
        coefficients, stop = getattr(p.friction.coulomb, direction), p.fin.stop_angle
        angle = stop * share
        value = coulomb_polynomial(coefficients, angle)
        largest = coulomb_polynomial([ops.fabs(c) for c in coefficients], stop)
        below = -value - SLACK * largest
        return below, *coefficients, value, angle, in_degrees(angle), stop, in_degrees(stop)

    return Rule(check, f"friction.coulomb.{direction} = [{', '.join(['%.6g'] * 7)}] N.m gives a friction of %.6g N.m "
                       f"at fin_angle = {ANGLE}; it must not be below 0 within +-fin.stop_angle = {ANGLE}", True)


def _multiplier(ops: Ops, p: Any, _: Value) -> tuple[Value, ...]:
    value = p.encoder.multiplier
    known = ops.either(ops.equal(value, 1.0), ops.either(ops.equal(value, 2.0), ops.equal(value, 4.0)))
    return when(ops, ops.negate(known)), value


def _inertia(ops: Ops, p: Any, _: Value) -> tuple[Value, ...]:
    parts = p.inertia
    total = parts.motor + parts.screw + parts.fin + parts.shaft + parts.fork
    return when(ops, total <= 0.0), total


def _stable(name: str, share: float) -> Rule:
    """Check that what a gain [1/s] takes off in a sample is no more than there is."""
    def check(ops: Ops, p: Any, _: Value) -> tuple[Value, ...]:
        gain, fastest = getattr(p.controller, name), share / p.controller.sample_time
        return when(ops, gain > fastest * (1.0 + SLACK)), gain, fastest

    return Rule(check, f"controller.{name} = %.6g 1/s must be at most {share:g}/controller.sample_time = %.6g 1/s")


def _rising(ops: Ops, p: Any, _: Value) -> tuple[Value, ...]:
    points = p.friction.table.temperature
    falls: Value = False
    for low, high in pairwise(points):
        falls = ops.either(falls, low >= high)
    return when(ops, falls), *points


def _identified(ops: Ops, p: Any, _: Value) -> tuple[Value, ...]:
    low, now, high = p.friction.identified_from, p.friction.temperature, p.friction.identified_to
    return when(ops, ops.either(now < low, now > high)), now, low, high


def _identified_range(ops: Ops, p: Any, _: Value) -> tuple[Value, ...]:
    low, high = p.friction.identified_from, p.friction.identified_to
    return when(ops, low > high), low, high


def _weight(ops: Ops, p: Any, _: Value) -> tuple[Value, ...]:
    position = p.controller.position
    short = ops.both(ops.equal(position.ki, 0.0), ops.negate(ops.equal(position.setpoint_weight, 1.0)))
    return when(ops, short), position.setpoint_weight, position.ki


def inertias(p: Any, viscous: Value) -> tuple[Value, Value]:
    """Return inertias at the motor [kg.m2]: of nut and hinge, and of motor and screw, with the ratio d/l.

    `viscous` [kg.m2] counts beside the hinge's.
    """
    lead, lever = p.screw.lead, p.screw.lead / p.kinematics.moment_arm
    fin = p.inertia.fork + p.inertia.shaft + p.inertia.fin + viscous
    return p.mass.nut * lead * lead + lever * lever * fin, p.inertia.motor + p.inertia.screw


# Of the rotor's inertia, that of the load side times minus the backward efficiency: the rest is left to accelerate.
MOST_JAMMING = 0.9


def jams(ops: Ops, p: Any, backward: Value, tick: Value) -> tuple[Value, ...]:
    """Return how far J_r + e J_l > 0 is broken within ticks [s], and `backward`, J_r and J_l [kg.m2].

    With the hinge's viscous friction in the midpoint rule; R >= d/l.
    """
    load, rotor = inertias(p, 0.5 * tick * p.friction.fin_viscous)
    return when(ops, -backward * load > MOST_JAMMING * rotor), backward, rotor, load


LEVER_RULE = Rule(
    _lever, f"|kinematics.initial_angle| = {ANGLE}, nominal or as built, and fin.stop_angle = {ANGLE} add up to "
            f"{ANGLE}; the sum must be below {LARGEST_LEVER_ANGLE:.6g} rad ({degrees(LARGEST_LEVER_ANGLE):.6g} deg)")
FRICTION_RULES = (_friction("positive"), _friction("negative"))
OBSERVER_RULE = _stable("load_observer", 1.0)
# The drive's unwinds two integrals at once.
ANTIWINDUP_RULES = (_stable("antiwindup", 1.0), _stable("drive_antiwindup", 0.5))
WEIGHT_RULE = Rule(
    _weight, "controller.position.setpoint_weight = %.6g with controller.position.ki = %.6g 1/s2: without an integral "
             "the fin stops short of its command; set the weight to 1", warning=True)
ENCODER_RULE = Rule(_multiplier, "encoder.multiplier = %.6g must be 1, 2 or 4")
INERTIA_RULE = Rule(_inertia, "inertia.motor + inertia.screw + inertia.fin + inertia.shaft + inertia.fork = %.6g kg.m2 "
                              "must be above 0")
TEMPERATURE_RULES = (
    Rule(_rising, f"friction.table.temperature = [{', '.join(['%.6g'] * TABLE_POINTS)}] degC must rise from point to "
                  "point"),
    Rule(_identified_range, "friction.identified_from = %.6g degC must be at most friction.identified_to = %.6g degC"),
    Rule(_identified, "friction.temperature = %.6g degC is outside friction.identified_from = %.6g to "
                      "friction.identified_to = %.6g degC, where friction was tested: friction.table is an estimate "
                      "there", warning=True),
)
# -- groups ------------------------------------------------------------------------


class Output(NamedTuple):
    """An output, and its equation of a moment (:func:`moment`); None of one that the actuator gives itself."""

    variable: Variable
    value: Callable[[Ops, Any, Record], Value] | None = None


@dataclass(frozen=True, eq=False)
class Group:
    """Parameters, rules and outputs that an actuator has together.

    `absent` are the values of its parameters with which equations are those of an actuator without the group.
    `wired` says whether its outputs are of the motor's terminal.
    """

    parameters: tuple[Variable, ...] = ()
    outputs: tuple[Output, ...] = ()
    rules: tuple[Rule, ...] = ()
    absent: Mapping[str, Any] = field(default_factory=dict)
    wired: bool = True


PARAMETER_ORDER = (
    "worm.", "inertia.worm", "kinematics.", "screw.", "inertia.motor", "inertia.screw", "inertia.", "mass.nut",
    "mass.", "center_of_mass.", "motor.torque_constant", "motor.back_emf_constant", "motor.resistance",
    "motor.inductance", "drive.current_limit", "drive.current_gain", "drive.current_offset",
    "drive.transport_delay", "drive.kp", "drive.ki", "drive.reference_limit", "controller.sample_time",
    "controller.position.", "controller.velocity.", "controller.load_observer", "controller.antiwindup",
    "controller.drive_antiwindup", "controller.speed_limit", "command.limit", "fin.", "friction.viscous.",
    "friction.coulomb.", "friction.table.temperature", "friction.table.viscous", "friction.table.coulomb",
    "friction.identified_", "friction.temperature", "friction.fin_viscous", "friction.fin_coulomb",
    "compensation.", "encoder.", "loads.", "mounting.", "deviation.kinematics.", "deviation.screw.",
    "deviation.motor.", "deviation.mass.", "deviation.friction.coulomb", "deviation.friction.viscous",
    "command.", "solver.")
OUTPUT_ORDER = (
    "fin_angle", "fin_rate", "motor_angle", "screw_angle", "screw_speed", "motor_speed", "motor_current",
    "motor_voltage", "motor_torque", "drive_reference", "nut_position", "hinge_torque", "supply_power",
    "braking_power", "tracking_error", "measured_fin_angle", "saturated", "at_stop")


def _place(name: str, order: tuple[str, ...]) -> int:
    return next((i for i, prefix in enumerate(order) if name.startswith(prefix)), len(order))


@dataclass(frozen=True, eq=False)
class Parts:
    """The groups of an actuator."""

    groups: tuple[Group, ...]

    @cached_property
    def parameters(self) -> tuple[Variable, ...]:
        """The parameters in the interface's order."""
        return tuple(sorted((v for group in self.groups for v in group.parameters),
                            key=lambda v: _place(v.name, PARAMETER_ORDER)))

    @cached_property
    def _outputs(self) -> tuple[Output, ...]:
        return tuple(sorted((out for group in self.groups for out in group.outputs),
                            key=lambda out: _place(out.variable.name, OUTPUT_ORDER)))

    @property
    def outputs(self) -> tuple[Variable, ...]:
        """The outputs in the interface's order."""
        return tuple(out.variable for out in self._outputs)

    @property
    def rules(self) -> tuple[Rule, ...]:
        """The rules, group by group."""
        return tuple(rule for group in self.groups for rule in group.rules)

    def terminals(self, description: str = "motor and drive") -> tuple[Terminal, ...]:
        """Return the terminal of the motor's side."""
        wired = {out.variable for group in self.groups if group.wired for out in group.outputs}
        return (Terminal("motor", description, tuple(v.name for v in self.outputs if v in wired)),)

    def shown(self, ops: Ops, p: Any, s: Record) -> Values:
        """Return the outputs that have an equation, at a moment `s`."""
        return {out.variable.name: out.value(ops, p, s) for out in self._outputs if out.value is not None}

    def completed(self, p: Any, optional: tuple[Group, ...] = ()) -> Any:
        """Return parameters with the absent values of those that only `optional` groups, or :data:`OPTIONAL`, have."""
        there = {v.name.partition("[")[0] for v in self.parameters}
        return with_values(p, {name: value for group in optional or OPTIONAL for name, value in group.absent.items()
                               if name not in there})


def moment(ops: Ops, p: Any, x: Record, u: Acting, angle: Value, speed: Value, **further: Value) -> Record:
    """Return what outputs follow from: states `x`, what acts `u`, and of the fin, whose `angle` [rad] and `speed`
    [rad/s] are those referred to the motor, tan(phi) and angle.

    Besides, `nut` [rad] is the angle of the screw at the nut, `current` [A] and `voltage` [V] are the motor's, and
    `saturated()` says whether a limit is met; an actuator gives what its outputs ask for.
    """
    tangent = kinematics.lever_tangent(ops, p, angle)
    return Record(x=x, u=u, speed=speed, tangent=tangent, fin=kinematics.fin_angle(ops, p, tangent), **further)


# -- hinge, lever and screw --------------------------------------------------------


def _error(ops: Ops, p: Any, s: Record) -> Value:
    error = drive.current_reference(ops, p, s.u.reference) - s.current
    return ops.where(s.u.enabled, error, 0.0)


def hinge(fork: str = "fork", **descriptions: str) -> Group:
    """Return the fin on its shaft, with what turns it there; `descriptions` are those of outputs by name."""
    equations: dict[str, Callable[[Ops, Any, Record], Value]] = {
        "fin_angle": lambda ops, p, s: s.fin,
        "fin_rate": lambda ops, p, s: s.speed / kinematics.reduction_ratio(ops, p, s.tangent),
        "hinge_torque": lambda ops, p, s: mechanics.external_moment(ops, p, s.tangent, s.u),
        "tracking_error": lambda ops, p, s: fin_port.clipped_command(ops, p, s.u.command) - s.fin,
        "measured_fin_angle": lambda ops, p, s: s.u.measured_fin_angle,
        "saturated": lambda ops, p, s: s.saturated(),
        "at_stop": lambda ops, p, s: ops.fabs(s.fin) >= s.stop,
    }
    outputs = fin_port.described({
        "measured_fin_angle": "fin angle the controller reads from its encoder at the last sample",
        "saturated": "any limit active: command, speed, DAC, current or voltage", **descriptions})
    return Group((*fin_port.turning(fork), fin_port.SAMPLE_TIME, *fin_port.TRAVEL, *fin_port.MOUNTING, *fin_port.BUS,
                  fin_port.MAX_TICK, *as_built.FIN,
                  parameter("friction.fin_viscous", "N.m.s/rad", 0.0, 1e4, "viscous friction about the hinge")),
                 tuple(Output(v, equations[v.name]) for v in outputs), wired=False)


HINGE = hinge()
HINGE_FRICTION = Group((
    parameter("friction.fin_coulomb", "N.m", 0.0, 1e4, "Coulomb friction about the hinge",
              sheet="bench: friction torque of the hinge's bearings and seals"),), absent={"friction.fin_coulomb": 0.0})
LEVER = Group((
    parameter("kinematics.moment_arm", "m", 1e-3, 1.0, "distance of the hinge from the screw axis, d",
              sheet="drawing: lever arm, from the hinge to the axis of screw or cylinder"),
    parameter("kinematics.initial_angle", "rad", radians(-60), radians(60),
              "assembly angle of the lever at fin_angle 0",
              sheet="drawing: angle of the lever at fin angle 0, from square to that axis"), *as_built.LEVER),
    rules=(LEVER_RULE,), absent={"kinematics.initial_angle": 0.0, **as_built.nominal(*as_built.LEVER)})


def screw(nut_position: str = "nut displacement from the assembly position") -> Group:
    """Return screw and nut, with a description of the output."""
    return Group((
        parameter("screw.lead", "m/rad", 1e-6, 1e-1, "screw lead per radian", sheet="screw: lead"),
        parameter("inertia.screw", "kg.m2", 0.0, 10.0, "screw inertia about its axis",
                  sheet="screw: inertia about its axis, with the coupling"),
        parameter("mass.nut", "kg", 0.0, 1e3, "nut mass",
                  sheet="screw: mass of the nut, with what moves along the screw"), *as_built.SCREW),
        (Output(real_output("nut_position", "m", nut_position, 0.01),
                lambda ops, p, s: kinematics.nut_position(ops, p, s.nut)),),
        (INERTIA_RULE,), {"mass.nut": 0.0, **as_built.nominal(*as_built.SCREW)})


SCREW = screw()

# -- friction ----------------------------------------------------------------------

def _table(quantity: str, unit: str, minimum: float, maximum: float, description: str) -> tuple[Variable, ...]:
    return tuple(parameter(f"friction.table.{quantity}[{i}]", unit, minimum, maximum, f"{description}, point {i + 1}")
                 for i in range(TABLE_POINTS))


def viscous(at: str = "motor") -> Group:
    """Return viscous friction at a shaft of this name, and temperature."""
    return Group((
        *(parameter(f"friction.viscous.{way}", "N.m.s/rad", 0.0, 10.0, f"viscous friction at the {at}, {way} motion",
                    sheet="bench: viscous friction without load") for way in ("positive", "negative")),
        *_table("temperature", "degC", -100.0, 200.0, "temperature of the table of friction, rising"),
        *_table("viscous", "1", 0.0, 100.0, "viscous friction there over that at 24 degC"),
        parameter("friction.identified_from", "degC", -100.0, 200.0,
                  "coldest temperature at which friction was tested"),
        parameter("friction.identified_to", "degC", -100.0, 200.0, "warmest temperature at which friction was tested"),
        tunable("friction.temperature", "degC", -100.0, 200.0, "ambient temperature"), *as_built.VISCOUS),
        rules=TEMPERATURE_RULES)


def coulomb(at: str = "motor") -> Group:
    """Return Coulomb friction at a shaft of this name."""
    return Group((
        *(parameter(f"friction.coulomb.{way}[{power}]", "N.m", -10.0, 10.0,
                    f"Coulomb friction at the {at} for {way} motion: coefficient of (fin_angle/20 deg)^{power}",
                    "bench: friction torque without load; a constant one is the first number, the others 0")
          for way in ("positive", "negative") for power in range(7)),
        *_table("coulomb", "1", 0.0, 100.0, "Coulomb friction there over that at 24 degC"), *as_built.COULOMB),
        rules=FRICTION_RULES, absent={
            "friction.coulomb.positive": (0.0,) * 7, "friction.coulomb.negative": (0.0,) * 7,
            "friction.table.coulomb": (1.0,) * TABLE_POINTS, **as_built.nominal(*as_built.COULOMB)})


VISCOUS, COULOMB = viscous(), coulomb()

# -- motor and drive ---------------------------------------------------------------

MOTOR = Group((
    parameter("inertia.motor", "kg.m2", 1e-9, 10.0, "rotor inertia",
              sheet="motor: rotor inertia (moment of inertia, J)"),
    parameter("motor.torque_constant", "N.m/A", 1e-6, 100.0, "torque constant", sheet="motor: torque constant K_t"),
    parameter("motor.back_emf_constant", "V.s/rad", 0.0, 100.0, "back-EMF constant",
              sheet="motor: back-EMF or voltage constant K_e; 1 over the speed constant"),
    parameter("motor.resistance", "Ohm", 1e-6, 1e4, "winding resistance",
              sheet="motor: terminal resistance, line to line"), *as_built.MOTOR), (
    Output(real_output("motor_speed", "rad/s", "motor speed", 100.0, display="rpm"), lambda ops, p, s: s.x.motor_speed),
    Output(real_output("motor_torque", "N.m", "motor torque", 3.0), lambda ops, p, s: drive.torque(p, s.current))))


def shaft(motor_angle: str = "motor angle") -> Group:
    """Return the motor's angle, with a description."""
    return Group(outputs=(Output(real_output("motor_angle", "rad", motor_angle, 10.0),
                                 lambda ops, p, s: s.x.motor_angle),))


def current(motor_current: str = "motor current") -> Group:
    """Return the current of a motor in both directions and its voltage, with a description of the current."""
    return Group(outputs=(
        Output(real_output("motor_current", "A", motor_current, 30.0), lambda ops, p, s: s.current),
        Output(real_output("motor_voltage", "V", "voltage the drive applies (back-EMF while disabled)", 30.0),
               lambda ops, p, s: s.voltage)))


SHAFT, CURRENT = shaft(), current()
POWER = Group(outputs=(Output(SUPPLY_POWER, lambda ops, p, s: s.voltage * s.current),), wired=False)
INDUCTANCE = Group((parameter("motor.inductance", "H", 1e-7, 10.0, "winding inductance",
                              sheet="motor: terminal inductance, line to line"),))
POLE_PAIRS = Group((
    integer_parameter("motor.pole_pairs", 0, 1000, "pole pairs: the inductive voltage across the winding, pole pairs "
                      "times speed, inductance and current, takes its part of the supply (0: none is taken)",
                      sheet="motor: pole pairs, half the number of poles"),), absent={"motor.pole_pairs": 0})


def delay(what: str = "delay from DAC to current reference",
          drive_reference: str = "analogue reference held by the controller's DAC") -> Group:
    """Return the DAC and the delay behind it, with descriptions of delay and output."""
    return Group((parameter("drive.transport_delay", "s", 0.0, 0.1, what,
                            sheet="drive: delay from a command to the current", display="ms"),),
                 (Output(real_output("drive_reference", "V", drive_reference, 10.0,
                                     limited_by=("drive.reference_limit",)), lambda ops, p, s: s.u.sampled_reference),))


DELAY = delay()
CURRENT_GAIN = Group((
    parameter("drive.current_gain", "A/V", 1e-3, 1e4, "current demanded per volt of reference",
              sheet="drive: scale of the analogue command, A/V"),))
CURRENT_LIMIT = Group((
    parameter("drive.current_limit", "A", 1e-3, 1e4, "largest current reference",
              sheet="drive: peak current, or that of what it feeds where that is less"),
    parameter("drive.current_offset", "A", -1e3, 1e3, "current demanded at zero reference")),
    absent={"drive.current_limit": inf, "drive.current_offset": 0.0})
KP = parameter("drive.kp", "V/A", 1e-6, 1e4, "proportional gain of the current loop",
               sheet="drive: proportional gain of the current loop")
CURRENT_LOOP = Group((
    KP,
    parameter("drive.ki", "V/(A.s)", 0.0, 1e6, "integral gain of the current loop",
              sheet="drive: integral gain of the current loop")),
    (Output(real_output("current_error", "A",
                        "current reference within its limit minus motor current (0 while disabled)", 10.0), _error),))

# -- controllers -------------------------------------------------------------------

POSITION_LOOP = Group((
    tunable("controller.position.kp", "1/s", 0.0, 1e5, "proportional gain of the position loop",
            sheet="controller: position loop, proportional gain"),
    tunable("controller.position.ki", "1/s2", 0.0, 1e6, "integral gain of the position loop (0: P control)",
            sheet="controller: position loop, integral gain"),
    tunable("controller.position.setpoint_weight", "1", 0.0, 2.0,
            "weight of the command in the proportional part of the position loop (1: the thesis's PI)",
            sheet="controller: position loop, setpoint weight"),
    tunable("controller.position.velocity_feedforward", "1", 0.0, 10.0,
            "share of the command's rate that is added to the speed reference (0: none)")), rules=(WEIGHT_RULE,))
VELOCITY_LOOP = Group((
    tunable("controller.velocity.kp", "V.s/rad", 0.0, 1e4, "proportional gain of the velocity loop",
            sheet="controller: velocity loop, proportional gain"),
    tunable("controller.velocity.ki", "V/rad", 0.0, 1e6, "integral gain of the velocity loop (0: P control)",
            sheet="controller: velocity loop, integral gain"),
    tunable("controller.load_observer", "1/s", 0.0, 1e4, "bandwidth of the load observer (0: none)")),
    rules=(OBSERVER_RULE,))
LIMITS = Group((
    parameter("drive.reference_limit", "V", 1e-3, 1e3, "largest DAC output",
              sheet="drive: range of the analogue command"),
    tunable("controller.antiwindup", "1/s", 0.0, 1e5,
            "back-calculation gain of the anti-windup where the speed reference is limited",
            sheet="controller: anti-windup gain"),
    tunable("controller.drive_antiwindup", "1/s", 0.0, 1e5,
            "back-calculation gain of the anti-windup where DAC or drive current are limited (0: none)"),
    parameter("controller.speed_limit", "rad/s", 1e-3, 1e5, "largest motor speed reference",
              sheet="controller: speed limit; not above the motor's permitted speed", display="rpm")),
    rules=ANTIWINDUP_RULES, absent={
        "drive.reference_limit": inf, "controller.speed_limit": inf, "controller.antiwindup": 0.0,
        "controller.drive_antiwindup": 0.0})
COMPENSATION = Group((
    tunable("compensation.gain", "1", 0.0, 10.0, "share of the Coulomb friction fed forward (0: none)"),
    tunable("compensation.speed_band", "rad/s", 1e-6, 1e4, "speed reference at which compensation is full",
            display="rpm")), absent={"compensation.gain": 0.0, "compensation.speed_band": 1.0})


def encoder(of: str = "motor") -> Group:
    """Return the encoder, which is that of a shaft of this name where there is none on the fin."""
    return Group((
        switch("encoder.enabled", "false feeds true angle and speed to the controllers"),
        integer_parameter("encoder.pulses", 1, 1_000_000, "pulses per revolution",
                          sheet="encoder: pulses (lines) per revolution"),
        integer_parameter("encoder.multiplier", 1, 4, "edge multiplier: 1, 2 or 4",
                          sheet="encoder: edges counted of a pulse, 4 in quadrature"),
        switch("encoder.on_fin", f"true: the position comes from an encoder on the fin shaft; false: from the {of}'s, "
               "as the speed always does", sheet="encoder: whether there is one on the fin's shaft")),
        rules=(ENCODER_RULE,), absent={"encoder.enabled": False, "encoder.on_fin": False, "encoder.pulses": 1,
                                       "encoder.multiplier": 1})


ENCODER = encoder()
OPTIONAL = (LEVER, SCREW, COULOMB, HINGE_FRICTION, COMPENSATION, ENCODER, CURRENT_LIMIT, LIMITS, POLE_PAIRS)
LOOPS = (VELOCITY_LOOP, LIMITS, POSITION_LOOP)
SERVO = (MOTOR, CURRENT, POWER, INDUCTANCE, DELAY, CURRENT_GAIN, CURRENT_LIMIT, CURRENT_LOOP, COMPENSATION, POLE_PAIRS)


def lever_and_screw(screw: Group) -> tuple[Group, ...]:
    """Return the groups from the motor's shaft to the fin, with its loops and encoder."""
    return LEVER, COULOMB, ENCODER, screw, *LOOPS, VISCOUS, HINGE, HINGE_FRICTION



# -- one actuator from another -----------------------------------------------------


def with_parameters(equation: Callable[..., Any], change: Callable[[Ops, Any], Any]) -> Callable[..., Any]:
    """Return an actuator's equation with the parameters that `change` makes of those it is given."""
    @wraps(equation)
    def changed(ops: Ops, p: Any, *arguments: Value) -> Any:
        return equation(ops, change(ops, p), *arguments)

    return changed
