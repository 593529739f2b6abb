"""The groups from which electromechanical actuators are composed: parameters, rules, outputs and capabilities."""

from __future__ import annotations

from dataclasses import replace
from math import radians

from ...physics import drive, kinematics
from ...variables import array, integer_parameter, parameter, real_output, switch, tunable
from .. import as_built, capabilities, fin_port
from ..composition import Group, Output, port
from ..shared import TABLE_POINTS
from . import rules
from .interface import SUPPLY_POWER

# -- hinge, lever and screw --------------------------------------------------------

HINGE = replace(
    port((*fin_port.PARAMETERS,
          parameter("friction.fin_viscous", "N.m.s/rad", 0.0, 1e4, "viscous friction about the hinge")),
         lambda ops, p, m: m.speed / kinematics.reduction_ratio(ops, p, m.tangent),
         measured_fin_angle="fin angle that the controllers read from the encoder at the last sample",
         saturated="a limit is active: command, speed, DAC, current or voltage"),
    provides=(capabilities.SCREW_DRIVE,), deviations=(as_built.FIN,))
HINGE_FRICTION = Group((
    parameter("friction.fin_coulomb", "N.m", 0.0, 1e4, "Coulomb friction about the hinge",
              sheet="bench: friction torque of the hinge's bearings and seals"),))
LEVER = Group((
    parameter("kinematics.moment_arm", "m", 1e-3, 1.0, "distance of the hinge from the screw axis, d",
              sheet="drawing: lever arm, from the hinge to the axis of screw or cylinder"),
    parameter("kinematics.initial_angle", "rad", radians(-60), radians(60),
              "assembly angle of the lever at fin_angle 0",
              sheet="drawing: angle of the lever at fin angle 0, from the perpendicular to the axis")),
    rules=(rules.lever_angle,), deviations=(as_built.MOMENT_ARM, as_built.INITIAL_ANGLE))
SCREW = Group((
    parameter("screw.lead", "m/rad", 1e-6, 1e-1, "screw lead per radian", sheet="screw: lead"),
    parameter("inertia.screw", "kg.m2", 0.0, 10.0, "screw inertia about its axis",
              sheet="screw: inertia about its axis, with the coupling"),
    parameter("mass.nut", "kg", 0.0, 1e3, "nut mass",
              sheet="screw: mass of the nut and of parts that move along with it")),
    (Output(real_output("nut_position", "m", "nut displacement from the assembly position", 0.01),
            lambda ops, p, m: kinematics.nut_position(ops, p, m.nut)),),
    provides=(capabilities.SCREW_AND_LEVER,), deviations=(as_built.LEAD,))
# The screw transmits the whole load of the nut to the motor; extensions may add losses.
LOSSLESS = Group(provides=(capabilities.SCREW_LOAD,))
EFFICIENCY = Group((
    parameter("efficiency.forward", "1", 0.01, 1.0, "efficiency of the screw when the motor drives the load",
              sheet="screw: efficiency, torque into thrust"),
    parameter("efficiency.backward", "1", -10.0, 1.0,
              "efficiency of the screw when the load drives the motor (0 or less: the load cannot)",
              sheet="screw: efficiency, thrust into torque")))

# -- friction ----------------------------------------------------------------------

VISCOUS = Group((
    *(parameter(f"friction.viscous.{way}", "N.m.s/rad", 0.0, 10.0, f"viscous friction at the motor, {way} motion",
                sheet="bench: viscous friction without load") for way in ("positive", "negative")),
    *array("friction.table.temperature", TABLE_POINTS, "degC", -100.0, 200.0,
           "temperature of the friction table (rising)"),
    *array("friction.table.viscous", TABLE_POINTS, "1", 0.0, 100.0,
           "ratio of the viscous friction at this temperature to that at 24 degC"),
    parameter("friction.identified_from", "degC", -100.0, 200.0, "lowest temperature at which friction was measured"),
    parameter("friction.identified_to", "degC", -100.0, 200.0, "highest temperature at which friction was measured"),
    tunable("friction.temperature", "degC", -100.0, 200.0, "ambient temperature")),
    rules=rules.TEMPERATURE_RULES, provides=(capabilities.AMBIENT_TEMPERATURE,), deviations=(as_built.VISCOUS,))
COULOMB = Group((
    *(parameter(f"friction.coulomb.{way}[{power}]", "N.m", -10.0, 10.0,
                f"Coulomb friction at the motor for {way} motion: coefficient of (fin_angle/20 deg)^{power}",
                "bench: friction torque without load; a constant one is the first number, the others 0")
      for way in ("positive", "negative") for power in range(7)),
    *array("friction.table.coulomb", TABLE_POINTS, "1", 0.0, 100.0,
           "ratio of the Coulomb friction at this temperature to that at 24 degC")),
    rules=rules.FRICTION_RULES, provides=(capabilities.COULOMB_FRICTION, capabilities.DRY_FRICTION),
    deviations=(as_built.COULOMB,))

# -- motor and drive ---------------------------------------------------------------

MOTOR = Group((
    parameter("inertia.motor", "kg.m2", 1e-9, 10.0, "rotor inertia",
              sheet="motor: rotor inertia (moment of inertia, J)"),
    parameter("motor.torque_constant", "N.m/A", 1e-6, 100.0, "torque constant", sheet="motor: torque constant K_t"),
    parameter("motor.back_emf_constant", "V.s/rad", 0.0, 100.0, "back-EMF constant",
              sheet="motor: back-EMF or voltage constant K_e; 1 over the speed constant"),
    parameter("motor.resistance", "Ohm", 1e-4, 1e4, "winding resistance",
              sheet="motor: terminal resistance, line to line")), (
    Output(real_output("motor_speed", "rad/s", "motor speed", 100.0, display="rpm")),
    Output(real_output("motor_torque", "N.m", "motor torque", 3.0),
           lambda ops, p, m: drive.torque(p, m.motor_current))),
    deviations=(as_built.FLUX,))
# In a rigid drive line the fin's angle follows from the motor's.
SHAFT = Group(outputs=(Output(real_output("motor_angle", "rad", "motor angle", 10.0)),),
              provides=(capabilities.RIGID_DRIVE_LINE, capabilities.MOTOR_SHAFT))
CURRENT = Group(outputs=(
    Output(real_output("motor_current", "A", "motor current", 30.0)),
    Output(real_output("motor_voltage", "V", "voltage applied by the drive (back-EMF while disabled)", 30.0))),
    provides=(capabilities.MOTOR_CURRENT, capabilities.PROPORTIONAL_TORQUE, capabilities.DRIVE_STEP))
POWER = Group(outputs=(Output(SUPPLY_POWER, lambda ops, p, m: m.motor_voltage * m.motor_current),), terminal="",
              provides=(capabilities.SUPPLY_VOLTAGE, capabilities.RETURNS_POWER))
VOLTAGE_LIMIT = Group(provides=(capabilities.VOLTAGE_LIMIT,))
INDUCTANCE = Group((parameter("motor.inductance", "H", 1e-7, 10.0, "winding inductance",
                              sheet="motor: terminal inductance, line to line"),))
POLE_PAIRS = Group((
    integer_parameter("motor.pole_pairs", 0, 1000, "pole pairs; the inductive voltage, pole pairs times speed, "
                      "inductance and current, lowers the voltage limit (0: it does not)",
                      sheet="motor: pole pairs, half the number of poles"),))
# A brushless motor: `enable` switches its bridge and nothing else, and its rotor angle is a state.
PHASES = Group(provides=(capabilities.PHASES,))
DELAY = Group((parameter("drive.transport_delay", "s", 0.0, 0.1, "delay from DAC to current reference",
                        sheet="drive: delay from a command to the current", display="ms"),),
             (Output(real_output("drive_reference", "V", "analogue reference held by the controller's DAC", 10.0,
                                 limited_by=("drive.reference_limit",)), lambda ops, p, m: m.u.sampled_reference),))
CURRENT_GAIN = Group((
    parameter("drive.current_gain", "A/V", 1e-3, 1e4, "current demanded per volt of reference",
              sheet="drive: scale of the analogue command, A/V"),))
CURRENT_LIMIT = Group((
    parameter("drive.current_limit", "A", 1e-3, 1e4, "largest current reference",
              sheet="drive: peak current, or that of the motor if it is less"),
    parameter("drive.current_offset", "A", -1e3, 1e3, "current demanded at zero reference")),
    provides=(capabilities.CURRENT_LIMIT,), imperfections={as_built.OFFSET: {"drive.current_offset": 0.0}})
KP = parameter("drive.kp", "V/A", 1e-6, 1e4, "proportional gain of the current loop",
               sheet="drive: proportional gain of the current loop")
CURRENT_LOOP = Group((
    KP,
    parameter("drive.ki", "V/(A.s)", 0.0, 1e6, "integral gain of the current loop",
              sheet="drive: integral gain of the current loop")),
    (Output(real_output("current_error", "A",
                        "current reference within its limit minus motor current (0 while disabled)", 10.0),
            lambda ops, p, m: ops.where(
                m.u.enabled, drive.current_reference(ops, p, m.u.reference) - m.motor_current, 0.0)),),
    provides=(capabilities.CURRENT_LOOP,))

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
            "share of the command's rate that is added to the speed reference (0: none)")),
    rules=(rules.setpoint_weight,), provides=(capabilities.POSITION_LOOP,))
VELOCITY_LOOP = Group((
    tunable("controller.velocity.kp", "V.s/rad", 0.0, 1e4, "proportional gain of the velocity loop",
            sheet="controller: velocity loop, proportional gain"),
    tunable("controller.velocity.ki", "V/rad", 0.0, 1e6, "integral gain of the velocity loop (0: P control)",
            sheet="controller: velocity loop, integral gain"),
    tunable("controller.load_observer", "1/s", 0.0, 1e4, "bandwidth of the load observer (0: none)")),
    rules=(rules.OBSERVER_RULE,), provides=(capabilities.CASCADE, capabilities.SCREW_EQUATIONS))
LIMITS = Group((
    parameter("drive.reference_limit", "V", 1e-3, 1e3, "largest DAC output",
              sheet="drive: range of the analogue command"),
    tunable("controller.antiwindup", "1/s", 0.0, 1e5,
            "back-calculation gain of the anti-windup while the speed reference is limited",
            sheet="controller: anti-windup gain"),
    tunable("controller.drive_antiwindup", "1/s", 0.0, 1e5,
            "back-calculation gain of the anti-windup while DAC or drive current is limited (0: none)"),
    parameter("controller.speed_limit", "rad/s", 1e-3, 1e5, "largest motor speed reference",
              sheet="controller: speed limit; not above the motor's permitted speed", display="rpm")),
    rules=rules.ANTIWINDUP_RULES, provides=(capabilities.REFERENCE_LIMIT,))
COMPENSATION = Group((
    tunable("compensation.gain", "1", 0.0, 10.0, "share of the Coulomb friction that is fed forward (0: none)"),
    tunable("compensation.speed_band", "rad/s", 1e-6, 1e4, "speed reference from which the compensation is full",
            display="rpm")))
ENCODER = Group((
    switch("encoder.enabled", "false: the controllers get the true angle and speed"),
    integer_parameter("encoder.pulses", 1, 1_000_000, "pulses per revolution",
                      sheet="encoder: pulses (lines) per revolution"),
    integer_parameter("encoder.multiplier", 1, 4, "edge multiplier: 1, 2 or 4",
                      sheet="encoder: edges counted per pulse, 4 in quadrature"),
    switch("encoder.on_fin", "true: the position comes from an encoder on the fin shaft; false: from the motor's, "
           "as the speed always does", sheet="encoder: whether one is on the fin shaft")),
    rules=(rules.encoder_multiplier,), provides=(capabilities.ENCODER,),
    imperfections={as_built.ENCODER: {"encoder.enabled": False}})
OPTIONAL = (LEVER, SCREW, COULOMB, HINGE_FRICTION, COMPENSATION, ENCODER, CURRENT_LIMIT, LIMITS, POLE_PAIRS)
LOOPS = (VELOCITY_LOOP, LIMITS, POSITION_LOOP)
SERVO = (MOTOR, CURRENT, POWER, VOLTAGE_LIMIT, INDUCTANCE, DELAY, CURRENT_GAIN, CURRENT_LIMIT, CURRENT_LOOP,
         COMPENSATION, POLE_PAIRS, PHASES)


def with_screw(screw: Group, hinge: Group = HINGE) -> tuple[Group, ...]:
    """Return the groups of a screw with lever, of friction and hinge, and of loops and encoder."""
    return LEVER, COULOMB, ENCODER, screw, *LOOPS, VISCOUS, hinge, HINGE_FRICTION


def with_gear(gear: Group, fork: str, shaft: Group = SHAFT) -> tuple[Group, ...]:
    """Return the groups of motor, drive, loops, encoder and fin with a `gear` instead of screw and lever.

    `fork` is the name of the part that turns the fin's shaft, for descriptions.
    """
    return COULOMB, ENCODER, *LOOPS, VISCOUS, HINGE.reworded({"fork": fork}), HINGE_FRICTION, shaft, *SERVO, gear
