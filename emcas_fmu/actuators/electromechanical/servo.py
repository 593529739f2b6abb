"""A digital hobby servo: firmware, PWM, DC motor, gear with friction, play and wind-up, fin on its output shaft.

    J N (d(w_m)/dt + alpha_y) = T_m - T - C - b w          w = w_m/N
    J_f d2(delta)/dt2 = T + T_h - C_f - b_f d(delta)/dt

w_m is the motor's speed, delta the fin angle, N the gear ratio; J is the inertia of rotor and gear, J_f that about the
hinge. T_m is the torque of the motor, T that of the gear on the fin, T_h the external moment about the hinge, alpha_y
the vehicle's angular acceleration about it, C dry and b viscous friction of the gear, C_f and b_f that of the hinge.
Torques of motor and gear: :mod:`emcas_fmu.physics.servo`, firmware: :mod:`emcas_fmu.control.firmware`. Parameters are
values of the servo's or motor's data sheet; torques, friction and stiffness refer to the output shaft, where the
encoder is, the inertia of the rotor to the motor. Without `enable` the bridge is open.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from math import pi
from typing import Any

from ...control import firmware
from ...control.trajectory import Ahead, Motion
from ...namespace import Record
from ...ops.base import Ops, Value
from ...physics import mechanics, servo
from ...rules import at_most
from ...steppers import discontinuities
from ...steppers.discontinuities import Backlash, Coulomb
from ...variables import integer_parameter, only, parameter, real_output, switch, tunable
from .. import as_built, capabilities, fin_port
from ..composition import Composition, Group, Output, port
from ..declaration import FIN, Actuator, PlantFault, PlantInputs, SampleInputs, State, Supply, Values
from . import groups, interface

# A servo may turn further than a fin: on a bench, or with a linkage.
_TURNS = ("command.limit", "fin.stop_angle", "fin.start_angle")
_PORT = port((
    *(replace(v, minimum=-pi if v.minimum < 0.0 else v.minimum, maximum=pi) if v.name in _TURNS else v
      for v in fin_port.described({"controller.sample_time": "frame time of the firmware"}, fin_port.PARAMETERS)),
    *only(groups.HINGE.parameters, "friction.fin_viscous")),
    measured_fin_angle="fin angle that the firmware read from its encoder at the last frame",
    saturated="a limit is active: command or PWM")
_PORT = replace(_PORT, outputs=tuple(
    out._replace(variable=replace(out.variable, nominal=10.0)) if out.variable.name == "fin_rate" else out
    for out in _PORT.outputs))  # an unloaded servo turns at about 10 rad/s


_FIRMWARE = Group((
    switch("encoder.enabled", "false: the firmware gets the true angle"),
    integer_parameter("encoder.counts", 2, 100_000_000, "counts per turn of the output shaft",
                      sheet="servo: resolution, counts (pulses) per turn"),
    parameter("pwm.full", "1", 1.0, 1e9, "counts of PWM at a duty cycle of 1", sheet="servo: PWM value of 100 %"),
    parameter("pwm.limit", "1", 0.0, 1e9, "largest counts of PWM", sheet="servo: PWM limit"),
    parameter("controller.dead_band", "1", 0.0, 1e6, "error, in counts, below which the firmware treats it as 0",
              sheet="servo: dead band, in counts"),
    tunable("controller.kp", "1", 0.0, 1e6, "proportional gain, counts of PWM per count of error",
            sheet="servo: position P gain, over its divisor"),
    tunable("controller.ki", "1/s", 0.0, 1e6, "integral gain, counts of PWM per count of error and second",
            sheet="servo: position I gain, over its divisor and its frame time"),
    tunable("controller.kd", "s", 0.0, 1e6, "derivative gain of the measured angle, counts of PWM per count/s",
            sheet="servo: position D gain, over its divisor, times its frame time"),
    parameter("drive.transport_delay", "s", 0.0, 0.1, "delay from a frame to the PWM", display="ms")),
    (Output(real_output("duty", "1", "duty cycle of the PWM, negative for negative voltage", 1.0, minimum=-1.0,
                        maximum=1.0), lambda ops, p, m: m.u.sampled_reference),),
    (at_most("pwm.limit", "pwm.full", "counts"),), (capabilities.POSITION_LOOP, capabilities.DUTY_REFERENCE),
    imperfections={as_built.ENCODER: {"encoder.enabled": False}, "dead band": {"controller.dead_band": 0.0}})
_MOTOR = Group((
    parameter("motor.nominal_voltage", "V", 0.1, 1000.0, "voltage of stall torque and no-load speed, V_n",
              sheet="servo: voltage at which torque and speed are rated"),
    parameter("motor.stall_torque", "N.m", 1e-6, 1e5, "stall torque at the output without the gear's friction, T_s",
              sheet="servo: rated stall torque, which is net of gear friction, plus that friction"),
    parameter("motor.no_load_speed", "rad/s", 1e-3, 1e5, "no-load speed of the output without friction, w_0",
              sheet="servo: no-load speed; 60 deg divided by the transit time", display="deg/s"),
    parameter("motor.asymmetry", "1", -0.9, 0.9, "share of the torque that is lost under negative voltage because the "
              "brushes are not in the neutral position (negative: lost under positive voltage)"),
    parameter("inertia.motor", "kg.m2", 1e-9, 10.0, "rotor inertia, with that of the gear",
              sheet="motor: rotor inertia (moment of inertia, J)")), (
    Output(real_output("motor_angle", "rad", "motor angle", 100.0)),
    Output(real_output("motor_speed", "rad/s", "motor speed", 1000.0, display="rpm")),
    Output(real_output("motor_current", "A", "motor current", 3.0), lambda ops, p, m: servo.current(ops, p, m.x, m.u)),
    Output(real_output("motor_voltage", "V", "mean voltage at the motor (back-EMF while disabled)", 10.0),
           lambda ops, p, m: servo.voltage(ops, p, m.x, m.u))))
_GEAR = Group((
    parameter("gear.ratio", "1", 1.0, 1e5, "turns of the motor per turn of the output, N", sheet="servo: gear ratio"),
    parameter("gear.stiffness", "N.m/rad", 1e-3, 1e7, "stiffness of the gear at the output, k"),
    parameter("gear.damping", "N.m.s/rad", 0.0, 1e5, "damping of the gear's wind-up, b"),
    parameter("gear.backlash", "rad", 0.0, 0.5, "whole play of the gear at the output",
              sheet="servo: backlash (play) of the output"),
    parameter("friction.gear", "N.m", 0.0, 1e4, "dry friction of the gear at the output without load, C_0"),
    parameter("friction.gear_load", "1", 0.0, 1.0, "ratio of load-dependent dry friction to the mean torque of motor "
              "and output, at small torque, m"),
    parameter("friction.gear_load_rise", "1", 0.0, 2.0, "rise of the ratio m from small to stall torque, c"),
    parameter("friction.gear_viscous", "N.m.s/rad", 0.0, 1e4, "viscous friction of the gear at the output"),
    parameter("friction.stribeck_share", "1", 0.0, 10.0,
              "excess of dry friction at rest, as a share of that in fast motion, s"),
    parameter("friction.stribeck_speed", "rad/s", 1e-4, 1e4,
              "speed of the output at which 37 % of the excess is left, w_s"),
    *groups.HINGE_FRICTION.parameters), (
    Output(real_output("gear_torque", "N.m", "torque from the gear to the fin", 10.0),
           lambda ops, p, m: servo.gear_torque(ops, p, m.x, m.u)),),
    imperfections={as_built.BACKLASH: {"gear.backlash": 0.0}, as_built.COMPLIANCE: {"gear.stiffness": 1e5}})
_POWER = Group(outputs=(Output(interface.SUPPLY_POWER, lambda ops, p, m: servo.current(ops, p, m.x, m.u)
                               * servo.voltage(ops, p, m.x, m.u)),), terminal="",
               provides=(capabilities.SUPPLY_VOLTAGE,))
FAULTS = (
    PlantFault("stripped_gear", "the gear's teeth are stripped: it transmits nothing",
               lambda ops, p, amounts: {"gear.stiffness": 0.0, "gear.damping": 0.0}, lasting=True),
    PlantFault("worn_gear", "the gear's play grows by wear",
               lambda ops, p, amounts: {"gear.backlash": p.gear.backlash + amounts.angle},
               (tunable("angle", "rad", 0.0, 0.5, "growth of the whole play"),), lasting=True, grows=True),
    PlantFault("demagnetised", "the magnets have permanently lost a share of their flux", lambda ops, p, amounts: {
        "motor.stall_torque": amounts.share * p.motor.stall_torque,
        "motor.no_load_speed": p.motor.no_load_speed / amounts.share}, (
            tunable("share", "1", 0.01, 1.0, "share of the flux that is left"),), lasting=True),
    PlantFault.scaling("dry_gear", "the gear runs without grease",
                       tunable("factor", "1", 1.0, 100.0, "factor by which the gear's dry friction rises"),
                       "friction.gear", "friction.gear_load", "friction.gear_load_rise"),
)


def initial(ops: Ops, p: Any, start: Record) -> Values:
    """Return the states at rest at a fin angle, the gear in the middle of its play."""
    return {"motor_angle": p.gear.ratio * start.fin_angle, "counts": firmware.counts(ops, p, start.fin_angle)}


def sample(ops: Ops, p: Any, x: Record, inputs: SampleInputs) -> Values:
    """Return the duty cycle and the firmware's states; a disabled firmware resets its integral."""
    out = firmware.sample(ops, p, x.integral, x.counts, inputs.position, inputs.command, inputs.ahead)
    enabled = {"reference": out.duty, "limited": out.limited, "integral": out.integral}
    return {**{name: ops.where(inputs.enable, value, 0.0) for name, value in enabled.items()}, "counts": out.counts,
            "measured_fin_angle": out.counts * firmware.count(p)}


def feed_forward(ops: Ops, p: Any, motion: Motion, memory: Value) -> tuple[Ahead, Value, Value]:
    """Return the feed-forward of a motion of the fin, the unchanged memory, and the transport delay [s].

    Its `speed` [rad/s] is the fin's mean rate in the sample time; its `reference` [counts of PWM] turns a stiff gear at
    the nominal voltage.
    """
    speed = 0.5 * (motion.rate + motion.next_rate)
    inertia = p.inertia.motor * p.gear.ratio * p.gear.ratio + fin_port.hinge_inertia(p)
    torque = inertia * motion.acceleration + (p.friction.gear_viscous + mechanics.hinge_friction(p).viscous) * speed
    damped = p.controller.kd * speed / firmware.count(p) / p.pwm.full  # compensates the firmware's derivative term
    duty = torque / p.motor.stall_torque + speed / p.motor.no_load_speed + damped
    return Ahead(speed, p.pwm.full * duty), memory, p.drive.transport_delay


def derivatives(ops: Ops, p: Any, x: Record, u: PlantInputs) -> Values:
    """Return d/dt of the states of motor and fin."""
    torque = servo.gear_torque(ops, p, x, u)
    motor = (servo.motor_torque(ops, p, x, u) - torque - u.gear_friction
             - p.friction.gear_viscous * servo.output_speed(p, x))
    fin = (torque + fin_port.hinge_torque(ops, p, x.fin_angle, u) - u.hinge_friction
           - mechanics.hinge_friction(p).viscous * x.fin_rate)
    return {"fin_angle": x.fin_rate, "fin_rate": fin / fin_port.hinge_inertia(p), "motor_angle": x.motor_speed,
            "motor_speed": motor / (p.inertia.motor * p.gear.ratio) - u.alpha_y}


def moment(ops: Ops, p: Any, x: Record, u: PlantInputs) -> tuple[Any, Record]:
    """Return the parameters, and the values from which the outputs follow."""
    return p, fin_port.at_fin(ops, p, x, u, u.limited > 0.0)


COMPOSITION = Composition((_PORT, _FIRMWARE, _MOTOR, _GEAR, _POWER), moment)
ACTUATOR = Actuator(
    **COMPOSITION.declared(motor="motor and gear"),
    name="servo",
    title="digital hobby servo: firmware, PWM, DC motor, gear with load-dependent friction and play",
    origin="The thesis of Yerlikaya (2016) has no servo of this kind.",
    controllers_read=(),
    reference_output="duty",
    states=(*FIN, State("motor_angle", "rad"), State("motor_speed", "rad/s")),
    controller_states=(State("integral", "1", "integral of the firmware, counts of PWM"),
                       State("counts", "1", "counts of the encoder at the last frame")),
    supply=Supply(interface.SUPPLY_VOLTAGE, interface.SUPPLY_POWER,
                  lambda ops, p, interval: servo.conductance(p) / interval),
    descriptions={"enable": "false opens the servo's bridge: only loads and friction act on the fin",
                  "supply_voltage": "voltage that feeds the servo"},
    initial=initial,
    sample=sample,
    feed_forward=feed_forward,
    derivatives=derivatives,
    discontinuities=(
        Backlash("mesh", servo.windup, servo.half_play),
        Coulomb("gear_friction", "motor_speed", servo.gear_friction),
        Coulomb("hinge_friction", "fin_rate", "friction.fin_coulomb")),
    transport_delay=fin_port.transport_delay,
    faults=FAULTS,
    reference="emcas_fmu.reference.servo",
    modules=(sys.modules[__name__], servo, firmware, discontinuities),
)
