"""Loads of a vehicle in motion: gravity and acceleration, (2.27)-(2.45), and rotation.

Body axes are x forward (along the screw), y to the right and z down. The fin's frame is the body's, turned about x by
mounting.azimuth; its y axis is the hinge. The vehicle's motion (acceleration a, rate w) is that of a point on the
body's x axis; the hinge is at r = (mounting.station, 0, 0) from it:

    a_h = a + w' x r + w x (w x r)                             acceleration at the hinge
    g_b = g (-sin pitch, sin roll cos pitch, cos roll cos pitch)
    f = R_x(azimuth) (g_b - a_h)                               force per mass in the fin's frame
    W = R_x(azimuth) w        A = R_x(azimuth) w'              the vehicle's rotation in the fin's frame

f, gravity minus acceleration, is the opposite of the specific force that an accelerometer measures. The force on a mass
m at r from the hinge is m (f - A x r - W x (W x r) - 2 W x v). The first term acts at the centres of mass, turned by
the fin angle d. In the other terms the turning parts count as a plate through the hinge: a mass at s along the chord is
at r = (s cos d, 0, -s sin d), and with J = sum m s^2, the inertia about the hinge,

    -y . r x (W x (W x r)) = (W . r) (x W_z - z W_x) = s^2 ((W_x^2 - W_z^2) sin d cos d + W_x W_z cos 2d)
    -y . r x (A x r)       = -s^2 A_y
    -y . r x (W x v)       = 0                                 v = d' y x r is square to r and to y

    T_inertial = y . sum r_i x m_i f + J ((W_x^2 - W_z^2) sin d cos d + W_x W_z cos 2d - A_y)
    P_n = m_nut f_x

A steady roll thus turns the fin away from zero. Products of inertia with the coordinate y along the hinge, the parts'
thickness, and the nut's distance from the hinge are neglected. The largest neglected moment is m s y cos d A_x. For
the default fin (3 kg, s = -0.03 m) and an assumed y = 0.2 m it is -9 N.m at 500 rad/s2; a host may add it to
aero_torque. Rotor and screw turn about body x (:func:`emcas_fmu.physics.mechanics.rotor_torque`).
"""

from __future__ import annotations

from collections.abc import Callable
from functools import reduce
from operator import add
from typing import Any, NamedTuple

from ..namespace import Record
from ..ops.base import Ops, Value

GRAVITY = 9.80665  # m/s2, standard gravity (CGPM 1901)


class MotionLoads(NamedTuple):
    """Loads of the vehicle's motion on an actuator, in the fin's frame.

    ``f_x``, ``f_z`` [m/s2] gravity minus acceleration at the hinge; ``wx2_wz2`` = W_x^2 - W_z^2 and ``wx_wz`` = W_x W_z
    [rad2/s2]; ``alpha_x``, ``alpha_y`` [rad/s2] angular acceleration about the screw and about the hinge.
    """

    f_x: Value
    f_z: Value
    wx2_wz2: Value
    wx_wz: Value
    alpha_x: Value
    alpha_y: Value


LOADS = ("aero_torque", *MotionLoads._fields)
"""Names of the loads on the plant; in a tick its mean over the tick acts."""
NONE = Record(**dict.fromkeys(LOADS, 0.0))


def motion_loads(ops: Ops, p: Any, *motion: Value) -> MotionLoads:
    """Return the loads of a vehicle's motion, (2.27)-(2.33), (2.36).

    `motion` is the body's acceleration [m/s2], roll, pitch and yaw [rad], rates [rad/s] and angular acceleration
    [rad/s2], about or along x, y and z. Yaw has no effect: it is a turn about the direction of gravity.
    """
    a_x, a_y, a_z, roll, pitch, _, w_x, w_y, w_z, d_x, d_y, d_z = motion
    station, azimuth = p.mounting.station, p.mounting.azimuth
    g = ops.where(p.loads.gravity, GRAVITY, 0.0)
    f_x = -g * ops.sin(pitch) - (a_x - station * (w_y * w_y + w_z * w_z))
    f_y = g * ops.sin(roll) * ops.cos(pitch) - (a_y + station * (d_z + w_x * w_y))
    f_z = g * ops.cos(roll) * ops.cos(pitch) - (a_z + station * (w_x * w_z - d_y))
    cosine, sine = ops.cos(azimuth), ops.sin(azimuth)
    across = cosine * w_z - sine * w_y
    return MotionLoads(f_x, cosine * f_z - sine * f_y, w_x * w_x - across * across, w_x * across, d_x,
                   cosine * d_y + sine * d_z)


def level(ops: Ops, p: Any, aero_torque: Value = 0.0) -> Record:
    """Return the LOADS in a level vehicle at rest, under an aerodynamic moment about the hinge [N.m]."""
    return Record(aero_torque=aero_torque, **motion_loads(ops, p, *(0.0,) * 12)._asdict())


def fin_inertia(p: Any) -> Value:
    """Return J_ft [kg.m2] about the hinge, (2.13)."""
    return p.inertia.fork + p.inertia.shaft + p.inertia.fin


def hinge_moment(ops: Ops, p: Any, tangent: Value, u: Any) -> Value:
    """Return the hinge moment [N.m] of the motion loads `u` at tan(phi), (2.34), (2.35), (2.40), (2.41)."""
    # fin_angle = phi - initial_angle; the rotation by -initial_angle depends on parameters only.
    sin_0, cos_0 = ops.sin(p.kinematics.initial_angle), ops.cos(p.kinematics.initial_angle)

    def lever() -> tuple[Value, Value]:
        cosine = 1.0 / ops.sqrt(1.0 + tangent * tangent)
        return cosine, tangent * cosine

    def weight() -> Value:
        s_x, s_z = _first_moments(p)
        return _weight_moment((cos_0 * s_x - sin_0 * s_z, sin_0 * s_x + cos_0 * s_z), *lever(), u)

    def angle() -> tuple[Value, Value]:
        cosine, sine = lever()
        return cosine * cos_0 + sine * sin_0, sine * cos_0 - cosine * sin_0

    return _moment(ops, p, u, 0.0 * tangent, weight, angle)


def hinge_moment_at(ops: Ops, p: Any, fin_angle: Value, u: Any) -> Value:
    """Return the moment [N.m] of :func:`hinge_moment` at a fin angle [rad], for actuators without a lever."""
    def angle() -> tuple[Value, Value]:
        return ops.cos(fin_angle), ops.sin(fin_angle)

    return _moment(ops, p, u, 0.0 * fin_angle, lambda: _weight_moment(_first_moments(p), *angle(), u), angle)


def _moment(ops: Ops, p: Any, u: Any, nothing: Value, weight: Callable[[], Value],
            angle: Callable[[], tuple[Value, Value]]) -> Value:
    """Return the moment [N.m] of the masses, from `weight`, and of rotation; `angle` returns the fin's cosine and sine.

    If all these loads in `u` are 0, as without gravity and motion of the vehicle, the result is `nothing`, a zero.
    """
    def rotating() -> tuple[Value, ...]:
        cosine, sine = angle()
        swing = u.wx2_wz2 * (sine * cosine) + u.wx_wz * (cosine * cosine - sine * sine)
        return (weight() + fin_inertia(p) * (swing - u.alpha_y),)

    def steady() -> tuple[Value, ...]:
        return ops.branch(_zero(ops, u.f_x, u.f_z), lambda: (nothing,), lambda: (weight(),))

    return ops.branch(_zero(ops, u.wx2_wz2, u.wx_wz, u.alpha_y), steady, rotating)[0]


def _zero(ops: Ops, *values: Value) -> Value:
    """Return whether all values are zero, by a single comparison: every step computes this."""
    return ops.equal(reduce(add, map(ops.fabs, values)), 0.0)


def _first_moments(p: Any) -> tuple[Value, Value]:
    """Return sum m_i r_i [kg.m] along x and z at fin_angle 0."""
    centers, mass = p.center_of_mass, p.mass
    return (mass.fin * centers.fin.x + mass.shaft * centers.shaft.x + mass.fork * centers.fork.x,
            mass.fin * centers.fin.z + mass.shaft * centers.shaft.z + mass.fork * centers.fork.z)


def _weight_moment(moments: tuple[Value, Value], cosine: Value, sine: Value, u: Any) -> Value:
    """Return the y component of r x m f [N.m] of first moments [kg.m] turned about +y."""
    u_x, u_z = moments
    r_x, r_z = cosine * u_x + sine * u_z, cosine * u_z - sine * u_x
    return r_z * u.f_x - r_x * u.f_z


def nut_force(ops: Ops, p: Any, u: Any) -> Value:
    """Return P_n [N], the force of gravity and acceleration on the nut along +x, (2.42)-(2.45)."""
    return p.mass.nut * u.f_x
