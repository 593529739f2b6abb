"""Elastic drive line with a gap: what acts between the rotor and the fin.

The fin's angle is told at the motor: phi = theta(fin_angle) of (2.5), so that phi = motor angle where nothing
yields. Twist of the shaft, stretch of the screw with nut and thrust bearing, and the give of the flanks of nut and
fork lie in series under one torque T at the motor (force T/l in the screw):

    s = theta_m - phi                                        deflection at the motor [rad]; l lead per radian
    C_s = c_t + c_x/l^2        C = C_s + 1/(l^2 k_c)         compliances [rad/(N.m)], the contact's only with a gap
    K = 1/C        D = sum D_i (C_i/C)^2                     each damping at its share of the rate of deflection
    f = K (s -+ g/2) + D ds/dt        T = f >= 0 on the flank s >= g/2, f <= 0 on s <= -g/2, else 0

with g = gap/l. A flank presses and never pulls. Without a gap the nut is preloaded and T = K s + D ds/dt. Without
compliance and gap the line is rigid.

    J_t dw/dt = K_t i + T_rotor - b_m w - C_m sgn w + l P_n - T
    (J_ft/R^2) du/dt = T + T_f/R - b_f u/R^2 - (C_f/R) sgn u + J_ft R'/R^4 u^2        w = dtheta_m/dt, u = dphi/dt

The sum of both at w = u is the equation of :mod:`emcas_fmu.physics.mechanics`.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from ..namespace import with_values
from ..ops.base import Ops, Value
from . import mechanics
from .loads import NONE

# A flank counts as met this close to it: both angles are rounded.
MET = 1e-9  # rad at the motor, 1e-12 m: far above the rounding of its angle
_NO_ROTOR = {"inertia.motor": 0.0, "inertia.screw": 0.0, "mass.nut": 0.0}


class Line(NamedTuple):
    """A drive line at the motor: K [N.m/rad], D [N.m.s/rad], g/2 [rad], C_s/C [-]; whether it has a gap."""

    stiffness: Value
    damping: Value
    half_gap: Value
    structure: Value
    loose: Value


def structure_compliance(p: Any) -> Value:
    """Return C_s [rad/(N.m)] of shaft and screw at the motor."""
    line, lead = p.drive_line, p.screw.lead
    return line.torsional_compliance + line.axial_compliance / (lead * lead)


def rigid(ops: Ops, p: Any) -> Value:
    """Return whether nothing in the line yields or is loose."""
    return ops.both(ops.equal(structure_compliance(p), 0.0), ops.equal(p.drive_line.backlash, 0.0))


def line(ops: Ops, p: Any) -> Line:
    """Return the drive line of a parameter set; that of a rigid one must not be used."""
    parts, square = p.drive_line, p.screw.lead * p.screw.lead
    structure = structure_compliance(p)
    loose = parts.backlash > 0.0
    contact = ops.where(loose, 1.0 / (parts.contact_stiffness * square), 0.0)
    total = structure + contact
    stiffness = 1.0 / ops.where(total > 0.0, total, 1.0)
    torsional, axial = parts.torsional_compliance * stiffness, parts.axial_compliance / square * stiffness
    contact_share = contact * stiffness
    damping = (parts.torsional_damping * torsional * torsional + parts.axial_damping * square * axial * axial
               + parts.contact_damping * square * contact_share * contact_share)
    return Line(stiffness, damping, 0.5 * parts.backlash / p.screw.lead, structure * stiffness, loose)


def pressed(ops: Ops, c: Line, deflection: Value, rate: Value) -> tuple[Value, Value]:
    """Return whether the line is under load, and the deflection [rad] from which it is: +-g/2, or 0 where preloaded."""
    def on(side: float) -> Value:
        beyond = side * deflection - c.half_gap
        pushing = c.stiffness * beyond + c.damping * side * rate > least(c)
        # A flank without damping has no force yet when it is met.
        return ops.both(beyond >= -MET, ops.either(pushing, side * rate > 0.0))

    upper, lower = on(1.0), on(-1.0)
    flank = ops.where(upper, c.half_gap, ops.where(lower, -c.half_gap, 0.0))
    return ops.either(ops.negate(c.loose), ops.either(upper, lower)), flank


def least(c: Line) -> Value:
    """Return torque [N.m] below which a flank counts as left: what it has where it counts as met."""
    return c.stiffness * MET


def torque(c: Line, deflection: Value, rate: Value, flank: Value) -> Value:
    """Return f [N.m at the motor] of a pressed line, from rotor to fin."""
    return c.stiffness * (deflection - flank) + c.damping * rate


def nut_lag(ops: Ops, c: Line, deflection: Value) -> Value:
    """Return share of the deflection [rad at the motor] that lies before the nut: shaft and screw."""
    beyond = deflection - ops.clip(deflection, -c.half_gap, c.half_gap)
    return c.structure * beyond


def fin_side(ops: Ops, p: Any, angle: Value, u: Any = NONE) -> mechanics.Mechanics:
    """Return the coefficients at the motor of the fin side alone: those of an actuator without rotor and nut."""
    return mechanics.coefficients(ops, with_values(p, _NO_ROTOR), angle, u)
