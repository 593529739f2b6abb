"""Variables, states and rules that the electromechanical actuators share, and how one is made from another."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import wraps
from itertools import pairwise
from math import degrees, radians
from typing import Any

from ...ops.base import Ops, Value
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
    without,
)
from .. import fin_port
from ..declaration import State, Supply
from .as_built import DEVIATIONS

# -- states ------------------------------------------------------------------------

MOTOR = (State("motor_angle", "rad"), State("motor_speed", "rad/s"))
DRIVE = (State("motor_current", "A"), State("drive_integral", "V", "integral of the current controller, xi"))
CONTROLLER = (State("integral", "rad/s", "integral of the position controller"),
              State("velocity_integral", "V", "integral of the velocity controller"),
              State("target", "rad", "motor angle asked for, lagged by the update time of the command"),
              State("momentum", "N.m.s", "of the load observer"),
              State("counts", "1", "counts of the encoder of position at the last sample"),
              State("motor_counts", "1", "counts of the motor's encoder at the last sample"))

# -- inputs and outputs ------------------------------------------------------------

SUPPLY_VOLTAGE = real_input("supply_voltage", "V", "bus voltage of the drive", minimum=0.0, maximum=1000.0,
                            nominal=30.0, start=None, key="drive.supply_voltage",
                            sheet="drive: supply (DC-link) voltage")
SUPPLY_POWER = real_output("supply_power", "W", "electrical power drawn by the motor; negative while regenerating",
                           1000.0)
OUTPUTS = (
    fin_port.FIN_ANGLE,
    fin_port.FIN_RATE,
    real_output("motor_angle", "rad", "motor angle", 10.0),
    real_output("motor_speed", "rad/s", "motor speed", 100.0, display="rpm"),
    real_output("motor_current", "A", "motor current", 30.0),
    real_output("motor_voltage", "V", "voltage the drive applies (back-EMF while disabled)", 30.0),
    real_output("motor_torque", "N.m", "motor torque", 3.0),
    real_output("drive_reference", "V", "analogue reference held by the controller's DAC", 10.0,
                limited_by=("drive.reference_limit",)),
    real_output("nut_position", "m", "nut displacement from the assembly position", 0.01),
    fin_port.HINGE_TORQUE,
    SUPPLY_POWER,
    fin_port.TRACKING_ERROR,
    *fin_port.described({
        "measured_fin_angle": "fin angle the controller reads from its encoder at the last sample",
        "saturated": "any limit active: command, speed, DAC, current or voltage",
    }, (fin_port.MEASURED_FIN_ANGLE, fin_port.SATURATED, fin_port.AT_STOP)),
    real_output("current_error", "A", "current reference within its limit minus motor current (0 while disabled)",
                10.0),
)
INPUT_DESCRIPTIONS = {
    "acceleration.x": "vehicle acceleration along body x (forward, along the screw), where mounting.station "
                      "counts from",
    "angular_acceleration.x":
        "vehicle angular acceleration about body x, d/dt of angular_rate.x; times inertia.motor + inertia.screw it "
        "takes from the motor's torque, whose positive angle is right-handed about body x",
    "enable": "false opens the drive's bridge: the fin is driven by loads and friction only",
}

_MOTOR = Terminal("motor", "motor and drive",
                  ("motor_angle", "motor_speed", "motor_current", "motor_voltage", "motor_torque", "drive_reference",
                   "nut_position", "current_error"))
TERMINALS = (_MOTOR,)

# -- without a current loop --------------------------------------------------------

LOOPLESS_OUTPUTS = without(OUTPUTS, "current_error")
LOOPLESS_TERMINALS = (replace(_MOTOR, members=tuple(m for m in _MOTOR.members if m != "current_error")),)

# -- parameters --------------------------------------------------------------------

_COULOMB = tuple(
    parameter(f"friction.coulomb.{direction}[{power}]", "N.m", -10.0, 10.0,
              f"Coulomb friction at the motor for {direction} motion: coefficient of (fin_angle/20 deg)^{power}",
              "bench: friction torque without load; a constant one is the first number, the others 0")
    for direction in ("positive", "negative") for power in range(7)
)
TABLE_POINTS = 5
_TABLE = tuple(
    parameter(f"friction.table.{quantity}[{i}]", unit, minimum, maximum, f"{description}, point {i + 1}")
    for quantity, unit, minimum, maximum, description in (
        ("temperature", "degC", -100.0, 200.0, "temperature of the table of friction, rising"),
        ("viscous", "1", 0.0, 100.0, "viscous friction there over that at 24 degC"),
        ("coulomb", "1", 0.0, 100.0, "Coulomb friction there over that at 24 degC"))
    for i in range(TABLE_POINTS))
PARAMETERS: tuple[Variable, ...] = (
    parameter("kinematics.moment_arm", "m", 1e-3, 1.0, "distance of the hinge from the screw axis, d",
              sheet="drawing: lever arm, from the hinge to the axis of screw or cylinder"),
    parameter("kinematics.initial_angle", "rad", radians(-60), radians(60),
              "assembly angle of the lever at fin_angle 0",
              sheet="drawing: angle of the lever at fin angle 0, from square to that axis"),
    parameter("screw.lead", "m/rad", 1e-6, 1e-1, "screw lead per radian", sheet="screw: lead"),
    parameter("inertia.motor", "kg.m2", 1e-9, 10.0, "rotor inertia",
              sheet="motor: rotor inertia (moment of inertia, J)"),
    parameter("inertia.screw", "kg.m2", 0.0, 10.0, "screw inertia about its axis",
              sheet="screw: inertia about its axis, with the coupling"),
    *fin_port.INERTIAS,
    parameter("mass.nut", "kg", 0.0, 1e3, "nut mass", sheet="screw: mass of the nut, with what moves along the screw"),
    *fin_port.MASSES,
    *fin_port.CENTERS,
    parameter("motor.torque_constant", "N.m/A", 1e-6, 100.0, "torque constant", sheet="motor: torque constant K_t"),
    parameter("motor.back_emf_constant", "V.s/rad", 0.0, 100.0, "back-EMF constant",
              sheet="motor: back-EMF or voltage constant K_e; 1 over the speed constant"),
    parameter("motor.resistance", "Ohm", 1e-6, 1e4, "winding resistance",
              sheet="motor: terminal resistance, line to line"),
    parameter("motor.inductance", "H", 1e-7, 10.0, "winding inductance",
              sheet="motor: terminal inductance, line to line"),
    parameter("drive.current_limit", "A", 1e-3, 1e4, "largest current reference",
              sheet="drive: peak current, or that of what it feeds where that is less"),
    parameter("drive.current_gain", "A/V", 1e-3, 1e4, "current demanded per volt of reference",
              sheet="drive: scale of the analogue command, A/V"),
    parameter("drive.current_offset", "A", -1e3, 1e3, "current demanded at zero reference"),
    parameter("drive.transport_delay", "s", 0.0, 0.1, "delay from DAC to current reference",
              sheet="drive: delay from a command to the current", display="ms"),
    parameter("drive.kp", "V/A", 1e-6, 1e4, "proportional gain of the current loop",
              sheet="drive: proportional gain of the current loop"),
    parameter("drive.ki", "V/(A.s)", 0.0, 1e6, "integral gain of the current loop",
              sheet="drive: integral gain of the current loop"),
    parameter("drive.reference_limit", "V", 1e-3, 1e3, "largest DAC output",
              sheet="drive: range of the analogue command"),
    fin_port.SAMPLE_TIME,
    tunable("controller.position.kp", "1/s", 0.0, 1e5, "proportional gain of the position loop",
            sheet="controller: position loop, proportional gain"),
    tunable("controller.position.ki", "1/s2", 0.0, 1e6, "integral gain of the position loop (0: P control)",
            sheet="controller: position loop, integral gain"),
    tunable("controller.position.setpoint_weight", "1", 0.0, 2.0,
            "weight of the command in the proportional part of the position loop (1: the thesis's PI)",
            sheet="controller: position loop, setpoint weight"),
    tunable("controller.position.velocity_feedforward", "1", 0.0, 10.0,
            "share of the command's rate that is added to the speed reference (0: none)"),
    tunable("controller.velocity.kp", "V.s/rad", 0.0, 1e4, "proportional gain of the velocity loop",
            sheet="controller: velocity loop, proportional gain"),
    tunable("controller.velocity.ki", "V/rad", 0.0, 1e6, "integral gain of the velocity loop (0: P control)",
            sheet="controller: velocity loop, integral gain"),
    tunable("controller.load_observer", "1/s", 0.0, 1e4, "bandwidth of the load observer (0: none)"),
    tunable("controller.antiwindup", "1/s", 0.0, 1e5,
            "back-calculation gain of the anti-windup where the speed reference is limited",
            sheet="controller: anti-windup gain"),
    tunable("controller.drive_antiwindup", "1/s", 0.0, 1e5,
            "back-calculation gain of the anti-windup where DAC or drive current are limited (0: none)"),
    parameter("controller.speed_limit", "rad/s", 1e-3, 1e5, "largest motor speed reference",
              sheet="controller: speed limit; not above the motor's permitted speed", display="rpm"),
    *fin_port.TRAVEL,
    parameter("friction.viscous.positive", "N.m.s/rad", 0.0, 10.0, "viscous friction at the motor, positive motion",
              sheet="bench: viscous friction without load"),
    parameter("friction.viscous.negative", "N.m.s/rad", 0.0, 10.0, "viscous friction at the motor, negative motion",
              sheet="bench: viscous friction without load"),
    *_COULOMB,
    *_TABLE,
    parameter("friction.identified_from", "degC", -100.0, 200.0, "coldest temperature at which friction was tested"),
    parameter("friction.identified_to", "degC", -100.0, 200.0, "warmest temperature at which friction was tested"),
    tunable("friction.temperature", "degC", -100.0, 200.0, "ambient temperature"),
    parameter("friction.fin_viscous", "N.m.s/rad", 0.0, 1e4, "viscous friction about the hinge"),
    parameter("friction.fin_coulomb", "N.m", 0.0, 1e4, "Coulomb friction about the hinge",
              sheet="bench: friction torque of the hinge's bearings and seals"),
    tunable("compensation.gain", "1", 0.0, 10.0, "share of the Coulomb friction fed forward (0: none)"),
    tunable("compensation.speed_band", "rad/s", 1e-6, 1e4, "speed reference at which compensation is full",
            display="rpm"),
    switch("encoder.enabled", "false feeds true angle and speed to the controllers"),
    integer_parameter("encoder.pulses", 1, 1_000_000, "pulses per revolution",
                      sheet="encoder: pulses (lines) per revolution"),
    integer_parameter("encoder.multiplier", 1, 4, "edge multiplier: 1, 2 or 4",
                      sheet="encoder: edges counted of a pulse, 4 in quadrature"),
    switch("encoder.on_fin", "true: the position comes from an encoder on the fin shaft; false: from the motor's, "
           "as the speed always does", sheet="encoder: whether there is one on the fin's shaft"),
    *fin_port.MOUNTING,
    *DEVIATIONS,
    *fin_port.BUS,
    fin_port.MAX_TICK,
    integer_parameter("motor.pole_pairs", 0, 1000, "pole pairs: the inductive voltage across the winding, pole pairs "
                      "times speed, inductance and current, takes its part of the supply (0: none is taken)",
                      sheet="motor: pole pairs, half the number of poles"),
)


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
RULES = (LEVER_RULE, *FRICTION_RULES, ENCODER_RULE, INERTIA_RULE, OBSERVER_RULE, *ANTIWINDUP_RULES, WEIGHT_RULE,
         *TEMPERATURE_RULES)

# -- one actuator from another -----------------------------------------------------


def with_parameters(equation: Callable[..., Any], change: Callable[[Ops, Any], Any]) -> Callable[..., Any]:
    """Return an actuator's equation with the parameters that `change` makes of those it is given."""
    @wraps(equation)
    def changed(ops: Ops, p: Any, *arguments: Value) -> Any:
        return equation(ops, change(ops, p), *arguments)

    return changed
