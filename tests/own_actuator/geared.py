"""A test actuator with its own equations: a motor with an encoder on a strain-wave gear.

    (J_m + J/N^2) dw/dt = K_t i - b w + T/N        i = k u        delta = theta/N

The encoder is on the motor. A PI controller with damping by the measured speed commands the current:

    u = k_p (delta_c - delta) + I - k_d d(delta)/dt          dI/dt = k_i (delta_c - delta)

The reference u is clipped at drive.reference_limit; during clipping the integral is constant.
"""

from __future__ import annotations

from math import pi
from typing import Any

from emcas_fmu.actuators import capabilities, fin_port
from emcas_fmu.actuators.declaration import Actuator, State
from emcas_fmu.variables import integer_parameter, parameter, real_output, switch, tunable

PARAMETERS = (
    *fin_port.PARAMETERS,
    parameter("gear.ratio", "1", 30.0, 320.0, "turns of the motor in one of the fin, N"),
    parameter("inertia.motor", "kg.m2", 1e-9, 10.0, "inertia of rotor and wave generator, J_m"),
    parameter("friction.motor", "N.m.s/rad", 0.0, 1.0, "viscous friction at the motor, b"),
    parameter("motor.torque_constant", "N.m/A", 1e-6, 1e3, "torque constant, K_t"),
    parameter("motor.back_emf_constant", "V.s/rad", 0.0, 1e3, "back-EMF constant"),
    parameter("motor.resistance", "Ohm", 1e-6, 1e4, "winding resistance"),
    parameter("drive.gain", "A/V", 1e-6, 1e3, "current for a volt of reference, k"),
    parameter("drive.reference_limit", "V", 1e-3, 1e3, "largest reference"),
    integer_parameter("encoder.pulses", 1, 1_000_000, "pulses per revolution of the motor"),
    integer_parameter("encoder.multiplier", 1, 4, "edges counted of a pulse"),
    switch("encoder.enabled", "false feeds the true angle to the controllers"),
    tunable("controller.kp", "V/rad", 0.0, 1e6, "proportional gain, k_p"),
    tunable("controller.ki", "V/(rad.s)", 0.0, 1e7, "integral gain, k_i"),
    tunable("controller.kd", "V.s/rad", 0.0, 1e5, "damping gain, k_d"),
)


def counted(ops: Any, p: Any, angle: Any) -> Any:
    """Return the motor's angle [counts], whole if the encoder is enabled."""
    counts = angle * (p.encoder.pulses * p.encoder.multiplier / (2.0 * pi))
    return ops.where(p.encoder.enabled, ops.floor(counts), counts)


def at_fin(p: Any, counts: Any) -> Any:
    """Return the fin angle [rad] at a motor angle [counts]."""
    return counts * (2.0 * pi / (p.encoder.pulses * p.encoder.multiplier)) / p.gear.ratio


def initial(ops: Any, p: Any, start: Any) -> Any:
    """Return states at rest at the start angle, as the encoder measures it."""
    angle = p.gear.ratio * start.fin_angle
    now = counted(ops, p, angle)
    counts = now if start.encoder_offset is None else now + start.encoder_offset
    return {"motor_angle": angle, "counts": counts, "before": now, "measured_fin_angle": at_fin(p, counts)}


def sample(ops: Any, p: Any, x: Any, inputs: Any) -> Any:
    """Return the reference [V] of the controller, and its states."""
    c, limit = p.controller, p.drive.reference_limit
    now = counted(ops, p, inputs.position)
    counts = now if inputs.encoder_offset is None else now + inputs.encoder_offset
    error = fin_port.clipped_command(ops, p, inputs.command) - at_fin(p, counts)
    demand = c.kp * error + x.integral - c.kd * at_fin(p, now - x.before) / c.sample_time
    clipped = ops.fabs(demand) > limit
    moved = x.integral + ops.where(clipped, 0.0, c.sample_time * c.ki * error)
    return {"reference": ops.where(inputs.enable, ops.clip(demand, -limit, limit), 0.0),
            "integral": ops.where(inputs.enable, moved, 0.0), "counts": counts, "before": now,
            "measured_fin_angle": at_fin(p, counts), "limited": ops.where(clipped, 1.0, 0.0)}


def current(ops: Any, p: Any, u: Any) -> Any:
    """Return the motor current [A], which is 0 while disabled."""
    return ops.where(u.enabled, p.drive.gain * u.reference, 0.0)


def derivatives(ops: Any, p: Any, x: Any, u: Any) -> Any:
    """Return d/dt of the states."""
    load = fin_port.hinge_torque(ops, p, x.motor_angle / p.gear.ratio, u) / p.gear.ratio
    torque = p.motor.torque_constant * current(ops, p, u) - p.friction.motor * x.motor_speed + load
    inertia = p.inertia.motor + fin_port.hinge_inertia(p) / (p.gear.ratio * p.gear.ratio)
    return {"motor_angle": x.motor_speed, "motor_speed": torque / inertia}


def step(ops: Any, p: Any, x: Any, u: Any, h: Any) -> Any:
    """Step by the mid-point rule, up to a stop."""
    first = derivatives(ops, p, x, u)
    middle = x.replace(motor_angle=x.motor_angle + 0.5 * h * x.motor_speed,
                       motor_speed=x.motor_speed + 0.5 * h * first["motor_speed"])
    speed = x.motor_speed + h * derivatives(ops, p, middle, u)["motor_speed"]
    angle, stop = x.motor_angle + h * middle.motor_speed, p.gear.ratio * p.fin.stop_angle
    against = ops.either(ops.both(angle > stop, speed > 0.0), ops.both(angle < -stop, speed < 0.0))
    return {"motor_angle": ops.clip(angle, -stop, stop), "motor_speed": ops.where(against, 0.0, speed)}, h


def output_values(ops: Any, p: Any, x: Any, u: Any) -> Any:
    """Return every output."""
    fin = x.motor_angle / p.gear.ratio
    return {"fin_angle": fin, "fin_rate": x.motor_speed / p.gear.ratio,
            "hinge_torque": fin_port.hinge_torque(ops, p, fin, u),
            "tracking_error": fin_port.clipped_command(ops, p, u.command) - fin,
            "measured_fin_angle": u.measured_fin_angle, "saturated": u.limited > 0.0,
            "at_stop": ops.fabs(fin) >= fin_port.stop_edge(p), "motor_current": current(ops, p, u)}


ACTUATOR = Actuator(
    name="geared", title="motor with an encoder on a strain-wave gear",
    states=(State("motor_angle", "rad"), State("motor_speed", "rad/s")), encoder=("motor_angle", "motor_speed"),
    controller_states=(State("integral", "V"), State("counts"), State("before")),
    parameters=PARAMETERS, outputs=(*fin_port.OUTPUTS, real_output("motor_current", "A", "motor current", 10.0)),
    provides=frozenset({capabilities.POSITION_LOOP, capabilities.MOTOR_CURRENT, capabilities.ENCODER,
                        capabilities.REFERENCE_LIMIT}),
    initial=initial, sample=sample, derivatives=derivatives, step=step, output_values=output_values)
