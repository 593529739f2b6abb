"""Hydraulic cylinder with equal areas on the lever of the fin.

    x  = d (tan(theta + theta_0) - tan theta_0)        piston; theta fin angle, R = dx/dtheta, R' = dR/dtheta
    V1 = V0 + A x        V2 = V0 - A x
    p1' = beta/V1 (Q1 - A R w - C_ip (p1 - p2))        p2' = beta/V2 (Q2 + A R w - C_ip (p2 - p1))
    (J + m R^2) w' = R (A (p1 - p2) - b_p R w + m f_x) + T - b_f w - m R R' w^2 - (C_f + R C_p) sgn w

w is the fin's rate, A the piston's area, V0 the volume of a chamber at x = 0, Q the flow into a chamber, C_ip the
internal leakage, m the mass that moves with the piston, f_x the motion load on it per mass
(:mod:`emcas_fmu.physics.loads`), T the moment of the other loads about the hinge; b and C are viscous and dry friction
of piston (p) and fin (f). Merritt, "Hydraulic Control Systems" (1967), chapters 5 and 6. Dry friction is set-valued at
rest (:mod:`emcas_fmu.physics.stick`).
"""

from __future__ import annotations

from typing import Any, NamedTuple

from ..namespace import with_values
from ..ops.base import Ops, Value
from . import kinematics, loads, mechanics


class Linkage(NamedTuple):
    """The cylinder on the lever at one fin angle.

    ``ratio`` R [m/rad] and its ``slope`` R' [m/rad2], the volumes of both chambers [m3], ``inertia`` about the hinge
    [kg.m2], ``dry`` friction [N.m], and ``load``, the moment [N.m] on the fin without pressures and friction.
    """

    ratio: Value
    slope: Value
    volume_1: Value
    volume_2: Value
    inertia: Value
    dry: Value
    load: Value


def _piston(p: Any) -> Any:
    """Return parameters with a screw lead of 1 m/rad, with which the motor angle is the piston's displacement."""
    return with_values(p, {"screw.lead": 1.0})


def piston_position(ops: Ops, p: Any, fin_angle: Value) -> Value:
    """Return the piston's displacement x [m] at a fin angle [rad]; x is 0 at a fin angle of 0."""
    return kinematics.motor_angle(ops, _piston(p), fin_angle)


def linkage(ops: Ops, p: Any, fin_angle: Value, u: Any) -> Linkage:
    """Return the cylinder at a fin angle [rad] under the loads in `u`."""
    tangent = ops.tan(fin_angle + p.kinematics.initial_angle)
    ratio = kinematics.reduction_ratio(ops, _piston(p), tangent)
    swept = p.cylinder.area * p.kinematics.moment_arm * (tangent - ops.tan(p.kinematics.initial_angle))
    mass = p.cylinder.moving_mass
    moment = mechanics.external_moment(ops, p, tangent, u) + ratio * mass * u.f_x
    return Linkage(ratio, 2.0 * ratio * tangent, p.cylinder.dead_volume + swept, p.cylinder.dead_volume - swept,
                   loads.fin_inertia(p) + mass * ratio * ratio, dry(p, ratio), moment)


def dry(p: Any, ratio: Value) -> Value:
    """Return the dry friction [N.m] of fin and piston about the hinge at a lever's `ratio` R [m/rad]."""
    return mechanics.hinge_friction(p).dry + ratio * p.cylinder.coulomb_friction


def dry_drop(ops: Ops, p: Any, fin_angle: Value) -> Value:
    """Return the pressure difference [Pa] that overcomes the dry friction of fin and piston at a fin angle [rad]."""
    ratio = kinematics.reduction_ratio(ops, _piston(p), ops.tan(fin_angle + p.kinematics.initial_angle))
    return dry(p, ratio) / (ratio * p.cylinder.area)


def pressing(p: Any, c: Linkage, pressure_1: Value, pressure_2: Value) -> Value:
    """Return the moment [N.m] about the hinge of chamber pressures [Pa] and loads, without friction."""
    return c.ratio * p.cylinder.area * (pressure_1 - pressure_2) + c.load


def acceleration(p: Any, c: Linkage, fin_rate: Value, pressure_1: Value, pressure_2: Value, dry: Value) -> Value:
    """Return the fin's acceleration [rad/s2] under dry friction [N.m], positive against positive motion."""
    viscous = p.cylinder.viscous_friction * c.ratio * c.ratio + mechanics.hinge_friction(p).viscous
    swing = p.cylinder.moving_mass * c.ratio * c.slope * fin_rate
    return (pressing(p, c, pressure_1, pressure_2) - dry - (viscous + swing) * fin_rate) / c.inertia


def pressure_rates(p: Any, c: Linkage, fin_rate: Value, pressure_1: Value, pressure_2: Value, flow_1: Value,
                   flow_2: Value) -> tuple[Value, Value]:
    """Return d/dt of both pressures [Pa/s] under flows [m3/s] into the chambers."""
    swept = p.cylinder.area * c.ratio * fin_rate + p.cylinder.internal_leakage * (pressure_1 - pressure_2)
    return (p.oil.bulk_modulus / c.volume_1 * (flow_1 - swept), p.oil.bulk_modulus / c.volume_2 * (flow_2 + swept))


def makeup(ops: Ops, p: Any, pressure: Value, refill: Value, open_: Value) -> Value:
    """Return the flow [m3/s] into a chamber at `pressure` through a check valve, `open_` below `refill` [Pa]."""
    return ops.where(open_, p.check_valve.conductance * (refill - pressure), 0.0)
