"""Equation of motion (2.8)-(2.17), written for the motor angle.

With the motor angle theta and speed w, the fin angle delta, R = d(theta)/d(delta), R' = dR/d(delta), the fin rate
q = w/R and dq/dt = (dw/dt)/R - R' w^2/R^3, the hinge equation

    (J_ft + J_t R^2) dq/dt = R T_m - R^2 b_m q - J_t R R' q^2 - b_f q + T_f + l R P_n - T_C

divided by R becomes

    (J_t + J_ft/R^2) dw/dt = T_m - b_m w - b_f w/R^2 + T_f/R + l P_n - T_C/R + J_ft R'/R^4 w^2

with R' = 2 R tan(phi). The coefficients of this form hardly vary with the angle. T_f is the external moment about the
hinge, T_C the dry friction of motor and fin, referred to it, P_n the force on the nut. The vehicle's angular
acceleration A_x about the screw reduces the motor's torque by (J_motor + J_screw) A_x, since rotor and screw also turn
with the vehicle.
"""

from __future__ import annotations

from functools import reduce
from operator import add
from typing import Any, NamedTuple

from ..namespace import value_of, with_values
from ..ops.base import Ops, Value
from . import friction, kinematics, loads
from .loads import fin_inertia

HINGE_DRY = ("friction.fin_coulomb",)
"""Parameters [N.m] whose sum is the dry friction about the hinge; deviations and faults scale all of them."""
HINGE_VISCOUS = ("friction.fin_viscous",)
"""Parameters [N.m.s/rad] whose sum is the viscous coefficient about the hinge."""
_LEAST = 1e-12  # N.m, smallest g of bristles


class Mechanics(NamedTuple):
    """Coefficients of the equation of motion at one motor angle, all referred to the motor except `fin`.

    ``inertia`` [kg.m2], external ``load`` [N.m], positive along a positive motor angle, ``rotor`` [N.m], the part of
    the load that acts on rotor and screw directly, ``centrifugal`` [N.m.s2/rad2], the coefficient of w^2, ``ratio`` R
    [-], ``gain`` 1/R [-], ``fin`` angle [rad].
    """

    inertia: Value
    load: Value
    rotor: Value
    centrifugal: Value
    ratio: Value
    gain: Value
    fin: Value


def screw_inertia(p: Any) -> Value:
    """Return J_t [kg.m2] at the motor: motor, screw (2.8) and nut."""
    return p.inertia.motor + p.inertia.screw + p.mass.nut * p.screw.lead * p.screw.lead


def rotor_torque(p: Any, u: Any) -> Value:
    """Return the torque [N.m] on rotor and screw from the vehicle's angular acceleration about the screw.

    A positive motor angle is a right-handed turn about body +x; for a motor that turns in the other direction the
    torque has the opposite sign.
    """
    return -(p.inertia.motor + p.inertia.screw) * u.alpha_x


def external_moment(ops: Ops, p: Any, tangent: Value, u: Any) -> Value:
    """Return T_f [N.m], the external moment about the hinge at tan(phi) under the loads `u`."""
    return u.aero_torque + loads.hinge_moment(ops, p, tangent, u)


def coefficients(ops: Ops, p: Any, motor_angle: Value, u: Any = loads.NONE) -> Mechanics:
    """Return the coefficients of the equation at a motor angle [rad] under the loads.LOADS in `u`."""
    tangent = kinematics.lever_tangent(ops, p, motor_angle)
    ratio = kinematics.reduction_ratio(ops, p, tangent)
    gain = 1.0 / ratio  # one division for all: divisions are slow
    reflected = fin_inertia(p) * (gain * gain)
    moment, rotor = external_moment(ops, p, tangent, u), rotor_torque(p, u)
    return Mechanics(
        inertia=screw_inertia(p) + reflected,
        load=moment * gain + p.screw.lead * loads.nut_force(ops, p, u) + rotor,
        rotor=rotor,
        centrifugal=0.0 if p.structure.constant_ratio else 2.0 * tangent * reflected * gain,
        ratio=ratio,
        gain=gain,
        fin=kinematics.fin_angle(ops, p, tangent),
    )


class HingeFriction(NamedTuple):
    """Friction about the hinge: ``dry`` [N.m], and the coefficient ``viscous`` [N.m.s/rad]."""

    dry: Value
    viscous: Value


def hinge_friction(p: Any) -> HingeFriction:
    """Return the friction about the hinge, for all actuators."""
    return HingeFriction(*(reduce(add, (value_of(p, name) for name in names)) for names in (HINGE_DRY, HINGE_VISCOUS)))


def with_hinge_friction(p: Any, factor: Value) -> Any:
    """Return parameters with `factor` times the friction about the hinge."""
    return with_values(p, {name: factor * value_of(p, name) for name in (*HINGE_VISCOUS, *HINGE_DRY)})


def hinge_dry(p: Any, m: Mechanics) -> Value:
    """Return the dry friction [N.m] about the hinge, referred to the motor."""
    return hinge_friction(p).dry * m.gain


def hinge_damping(p: Any, m: Mechanics) -> Value:
    """Return the viscous coefficient [N.m.s/rad] about the hinge, referred to the motor (2.17)."""
    return hinge_friction(p).viscous * (m.gain * m.gain)


def breakaway(ops: Ops, p: Any, m: Mechanics, direction: Value, speed: Value = 0.0) -> Value:
    """Return T_C/R [N.m], the dry friction at the motor for motion along `direction`, at a motor speed [rad/s]."""
    return friction.coulomb(ops, p, direction, m.fin, speed) + hinge_dry(p, m)


def damping(ops: Ops, p: Any, m: Mechanics, direction: Value) -> Value:
    """Return the viscous coefficient [N.m.s/rad] at the motor, including that of the hinge (2.17)."""
    return friction.viscous(ops, p, direction) + hinge_damping(p, m)


def bristles(ops: Ops, p: Any, m: Mechanics, speed: Value) -> tuple[Value, Value]:
    """Return a = sigma_0 |w|/g [1/s] and sigma_1 [N.m.s/rad] of LuGre bristles at a motor speed w [rad/s].

    g is C_m, with its excess at low speed, plus the dry friction about the hinge, referred to the motor. sigma_1 falls
    with |w|, so that sigma_1 |w| < g.
    """
    bristle, turning = p.lugre, ops.fabs(speed)
    motor = (friction.coulomb(ops, p, speed, m.fin)
             * friction.stribeck(ops, bristle.static_ratio, bristle.stribeck_speed, turning))
    level = ops.maximum(motor + hinge_friction(p).dry / m.ratio, _LEAST)
    return bristle.stiffness * turning / level, bristle.damping / (1.0 + bristle.damping * turning / level)
