"""A hobby servo's motor and gear, referred to its output shaft.

    T_m = T_s (V/V_n - w/w_0)          i = T_s w_0/V_n (V/V_n - w/w_0)
    T   = k a' + b_g da/dt             a = motor angle/N - fin angle, a' the part of a beyond the play
    C   = (C_0 + T_l (m + c min(T_l/T_s, 1))) (1 + s exp(-|w|/w_s))          T_l = (|T_m| + |T|)/2

T_s and w_0 are the stall torque and the no-load speed of the output at the voltage V_n without the gear's friction: a
DC motor without inductance, whose constants and resistance follow from them (K_t = K_e = V_n/w_0, R = V_n^2/(T_s w_0)).
The damping b_g acts only in contact. A `motor.asymmetry` above 0 is the share of T_m that is lost under negative
voltage, one below 0 that under positive voltage, since brushes are off their neutral position. While the motor brakes,
i lacks the same share, or energy would be created.

C is the dry friction of the gear at a motor speed w, referred to the output. It grows with T_l, the mean of the torques
at motor and output; m is the share of T_l that is lost under a small torque, m + c the share under the stall torque and
above. Duclusaud et al., "Extended friction models for the physics simulation of servo actuators" (2024), have friction
that depends on load, with a Stribeck curve, but with coefficients for each end of the gear and another quadratic term.
"""

from __future__ import annotations

from typing import Any

from ..namespace import Record
from ..ops.base import Ops, Value


def output_speed(p: Any, x: Record) -> Value:
    """Return the motor's speed [rad/s] at the output shaft."""
    return x.motor_speed / p.gear.ratio


def _excess(ops: Ops, p: Any, x: Record, u: Record) -> Value:
    """Return the ratio [-] of voltage minus back-EMF to the nominal voltage; 0 with an open bridge."""
    return ops.where(u.enabled, u.reference * u.supply / p.motor.nominal_voltage
                     - output_speed(p, x) / p.motor.no_load_speed, 0.0)


def _share(ops: Ops, p: Any, u: Record) -> Value:
    """Return the share [-] of the torque that is left in the present direction of the voltage."""
    return ops.where(p.motor.asymmetry * u.reference < 0.0, 1.0 - ops.fabs(p.motor.asymmetry), 1.0)


def current(ops: Ops, p: Any, x: Record, u: Record) -> Value:
    """Return the motor current [A]."""
    excess = _excess(ops, p, x, u)
    share = ops.where(excess * u.reference < 0.0, _share(ops, p, u), 1.0)
    return share * p.motor.stall_torque * p.motor.no_load_speed / p.motor.nominal_voltage * excess


def conductance(p: Any) -> Value:
    """Return the motor's 1/R [1/Ohm]."""
    return p.motor.stall_torque * p.motor.no_load_speed / (p.motor.nominal_voltage * p.motor.nominal_voltage)


def voltage(ops: Ops, p: Any, x: Record, u: Record) -> Value:
    """Return the mean voltage [V] at the motor: that of the bridge or, while the bridge is open, the back-EMF."""
    emf = p.motor.nominal_voltage * output_speed(p, x) / p.motor.no_load_speed
    return ops.where(u.enabled, u.reference * u.supply, emf)


def motor_torque(ops: Ops, p: Any, x: Record, u: Record) -> Value:
    """Return the motor's torque [N.m] at the output shaft; `u.reference` is the duty cycle."""
    return p.motor.stall_torque * _excess(ops, p, x, u) * _share(ops, p, u)


def windup(ops: Ops, p: Any, x: Record, u: Record) -> Value:
    """Return the motor's angle at the output shaft minus the fin's [rad]: play and wind-up."""
    return x.motor_angle / p.gear.ratio - x.fin_angle


def half_play(ops: Ops, p: Any, x: Record, u: Record) -> Value:
    """Return half the play [rad] of the gear at the output shaft."""
    return 0.5 * p.gear.backlash


def gear_torque(ops: Ops, p: Any, x: Record, u: Record) -> Value:
    """Return the torque [N.m] that the gear transmits to the fin; `u.mesh` [rad] is the wind-up beyond the play."""
    return p.gear.stiffness * u.mesh + p.gear.damping * u.mesh_closed * (output_speed(p, x) - x.fin_rate)


def gear_friction(ops: Ops, p: Any, x: Record, u: Record) -> Value:
    """Return the dry friction [N.m] of the gear at the output shaft."""
    f = p.friction
    load = 0.5 * (ops.fabs(motor_torque(ops, p, x, u)) + ops.fabs(gear_torque(ops, p, x, u)))
    dry = f.gear + load * (f.gear_load + f.gear_load_rise * ops.minimum(load / p.motor.stall_torque, 1.0))
    return dry * (1.0 + f.stribeck_share * ops.exp(-ops.fabs(output_speed(p, x)) / f.stribeck_speed))
