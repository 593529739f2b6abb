"""Gravity and acceleration loads, (2.27)-(2.45).

    g_b = g (-sin pitch, sin roll cos pitch, cos roll cos pitch)
    f = R_x(azimuth) (g_b - a_b)                               specific force in the fin's frame
    T_inertial = y . sum r_i x m_i f        P_n = m_nut f_x    r_i turned by fin_angle about +y

Body axes x forward (along the screw), y along the hinge, z down.
"""

from __future__ import annotations

from typing import Any

from ..ops.base import Ops, Value

GRAVITY = 9.80665  # m/s2, standard gravity (CGPM 1901)


def specific_force(ops: Ops, p: Any, acceleration: tuple[Value, Value, Value],
                   roll: Value, pitch: Value) -> tuple[Value, Value]:
    """Return x and z components [m/s2] of g_b - a_b in the fin's frame, (2.27)-(2.33), (2.36).

    Body acceleration [m/s2], roll and pitch [rad]; yaw turns about the direction of
    gravity. The fin's frame is the body's turned about x by mounting.azimuth.
    """
    a_x, a_y, a_z = acceleration
    g = ops.where(p.loads.gravity, GRAVITY, 0.0)
    f_x = -g * ops.sin(pitch) - a_x
    f_y = g * ops.sin(roll) * ops.cos(pitch) - a_y
    f_z = g * ops.cos(roll) * ops.cos(pitch) - a_z
    azimuth = p.mounting.azimuth
    return f_x, ops.cos(azimuth) * f_z - ops.sin(azimuth) * f_y


def hinge_moment(ops: Ops, p: Any, tangent: Value, f_x: Value, f_z: Value) -> Value:
    """Return moment [N.m] of gravity and inertia about the hinge at tan(phi), (2.34), (2.35), (2.40), (2.41).

    A right-handed turn of the centres of mass about +y by the fin angle, and the y
    component of r x m f.
    """
    return ops.branch(ops.both(ops.equal(f_x, 0.0), ops.equal(f_z, 0.0)),  # most hosts leave both alone
                      lambda: (0.0 * tangent,), lambda: (_moment(ops, p, tangent, f_x, f_z),))[0]


def hinge_moment_at(ops: Ops, p: Any, fin_angle: Value, f_x: Value, f_z: Value) -> Value:
    """Return the same at a fin angle [rad], for actuators without a lever."""
    def moment() -> tuple[Value, ...]:
        return (_turned(_first_moments(p), ops.cos(fin_angle), ops.sin(fin_angle), f_x, f_z),)

    return ops.branch(ops.both(ops.equal(f_x, 0.0), ops.equal(f_z, 0.0)), lambda: (0.0 * fin_angle,), moment)[0]


def _first_moments(p: Any) -> tuple[Value, Value]:
    """Return sum m_i r_i [kg.m] along x and z at fin_angle 0."""
    centers, mass = p.center_of_mass, p.mass
    return (mass.fin * centers.fin.x + mass.shaft * centers.shaft.x + mass.fork * centers.fork.x,
            mass.fin * centers.fin.z + mass.shaft * centers.shaft.z + mass.fork * centers.fork.z)


def _moment(ops: Ops, p: Any, tangent: Value, f_x: Value, f_z: Value) -> Value:
    s_x, s_z = _first_moments(p)
    # fin_angle = phi - initial_angle; the turn by -initial_angle depends on parameters only.
    sin_0, cos_0 = ops.sin(p.kinematics.initial_angle), ops.cos(p.kinematics.initial_angle)
    at_lever = cos_0 * s_x - sin_0 * s_z, sin_0 * s_x + cos_0 * s_z
    cos_phi = 1.0 / ops.sqrt(1.0 + tangent * tangent)
    return _turned(at_lever, cos_phi, tangent * cos_phi, f_x, f_z)


def _turned(moments: tuple[Value, Value], cosine: Value, sine: Value, f_x: Value, f_z: Value) -> Value:
    """Return the y component of r x m f [N.m] of first moments [kg.m] turned about +y."""
    u_x, u_z = moments
    r_x, r_z = cosine * u_x + sine * u_z, cosine * u_z - sine * u_x
    return r_z * f_x - r_x * f_z


def nut_force(ops: Ops, p: Any, f_x: Value) -> Value:
    """Return axial body force P_n [N] on the nut along +x, (2.42)-(2.45)."""
    return p.mass.nut * f_x
