"""Elastic drive line with a gap: the torque between rotor and fin.

The fin's angle is referred to the motor: phi = theta(fin_angle) of (2.5), so that phi is the motor angle for a rigid
line. Under one torque T at the motor (force T/l in the screw, moment T R about the hinge) these deflect in series: the
shaft by twist; screw, nut and thrust bearing along the axis; the flanks of nut and fork; and fork, fin shaft and
structure about the hinge.

    s = theta_m - phi                                        deflection at the motor [rad]
    C_s = c_t + c_x/l^2        C_h = R^2 sum 1/k_j           compliances [rad/(N.m)] before and behind the flanks
    C = C_s + 1/(l^2 k_c) + C_h                              second term, of the contact, only with a gap
    K = 1/C        D = sum D_i (C_i/C)^2                     each damping D_i at its share of the rate of deflection
    f = K (s -+ g/2) + D ds/dt        T = f >= 0 on the flank s >= g/2, f <= 0 on s <= -g/2, else 0

with g = gap/l, l the lead per radian, and R the ratio at the fin's angle. A flank presses and never pulls. Without a
gap the nut is preloaded and T = K s + D ds/dt. Without compliance and gap the line is rigid. The change of the lever's
ratio by the deflection is neglected: at a lever angle phi_l the relative error of T is tan(phi_l) times the deflection
about the hinge.

    J_t dw/dt = K_t i + T_rotor - b_m w - C_m sgn w + l P_n - T
    (J_ft/R^2) du/dt = T + T_f/R - b_f u/R^2 - (C_f/R) sgn u + J_ft R'/R^4 u^2        w = dtheta_m/dt, u = dphi/dt

The sum of both equations at w = u is the equation of :mod:`emcas_fmu.physics.mechanics`.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from ..namespace import with_values
from ..ops.base import Ops, Value
from . import kinematics, mechanics
from .loads import NONE

# A flank counts as met within this distance, far above the rounding of both angles.
MET = 1e-9  # rad at the motor, 1e-12 m at the nut
_NO_ROTOR = {"inertia.motor": 0.0, "inertia.screw": 0.0, "mass.nut": 0.0}


class DriveLine(NamedTuple):
    """A drive line at the motor: K [N.m/rad], D [N.m.s/rad], g/2 [rad], C_s/C [-], and whether it has a gap."""

    stiffness: Value
    damping: Value
    half_gap: Value
    structure: Value
    loose: Value


def structure_compliance(p: Any) -> Value:
    """Return C_s [rad/(N.m)] of shaft and screw at the motor."""
    line, lead = p.drive_line, p.screw.lead
    return line.torsional_compliance + line.axial_compliance / (lead * lead)


def hinge_compliance(ops: Ops, p: Any) -> Value:
    """Return the compliance [rad/(N.m)] of fork, fin shaft and structure about the hinge; stiffness 0 means rigid."""
    line, total = p.drive_line, 0.0
    for stiffness in (line.fork_stiffness, line.shaft_stiffness, line.structure_stiffness):
        yields = stiffness > 0.0
        total = total + ops.where(yields, 1.0 / ops.where(yields, stiffness, 1.0), 0.0)
    return total


def rigid(ops: Ops, p: Any) -> Value:
    """Return whether the line has neither compliance nor backlash."""
    stiff = ops.both(ops.equal(structure_compliance(p), 0.0), ops.equal(hinge_compliance(ops, p), 0.0))
    return ops.both(stiff, ops.equal(p.drive_line.backlash, 0.0))


def line(ops: Ops, p: Any, angle: Value) -> DriveLine:
    """Return the drive line at a fin angle referred to the motor [rad]; not valid for a rigid line."""
    parts, square = p.drive_line, p.screw.lead * p.screw.lead
    structure = structure_compliance(p)
    loose = parts.backlash > 0.0
    contact = ops.where(loose, 1.0 / (parts.contact_stiffness * square), 0.0)
    square_ratio = kinematics.reduction_ratio(ops, p, kinematics.lever_tangent(ops, p, angle))
    square_ratio = square_ratio * square_ratio
    hinge = hinge_compliance(ops, p) * square_ratio
    total = structure + contact + hinge
    stiffness = 1.0 / ops.where(total > 0.0, total, 1.0)
    torsional, axial = parts.torsional_compliance * stiffness, parts.axial_compliance / square * stiffness
    contact_share, hinge_share = contact * stiffness, hinge * stiffness
    damping = (parts.torsional_damping * torsional * torsional + parts.axial_damping * square * axial * axial
               + parts.contact_damping * square * contact_share * contact_share
               + parts.hinge_damping / square_ratio * hinge_share * hinge_share)
    return DriveLine(stiffness, damping, 0.5 * parts.backlash / p.screw.lead, structure * stiffness, loose)


def pressed(ops: Ops, c: DriveLine, deflection: Value, rate: Value) -> tuple[Value, Value]:
    """Return whether a flank presses, and the deflection [rad] at which it begins to press: +-g/2, 0 if preloaded."""
    def on(side: float) -> Value:
        beyond = side * deflection - c.half_gap
        pushing = c.stiffness * beyond + c.damping * side * rate > least(c)
        # A flank without damping has no force yet when it is met.
        return ops.both(beyond >= -MET, ops.either(pushing, side * rate > 0.0))

    upper, lower = on(1.0), on(-1.0)
    flank = ops.where(upper, c.half_gap, ops.where(lower, -c.half_gap, 0.0))
    return ops.either(ops.negate(c.loose), ops.either(upper, lower)), flank


def least(c: DriveLine) -> Value:
    """Return the torque [N.m] below which a flank counts as separated: that of the deflection MET."""
    return c.stiffness * MET


def torque(c: DriveLine, deflection: Value, rate: Value, flank: Value) -> Value:
    """Return the torque f [N.m, at the motor] from rotor to fin while a flank presses."""
    return c.stiffness * (deflection - flank) + c.damping * rate


def nut_lag(ops: Ops, c: DriveLine, deflection: Value) -> Value:
    """Return the part of the deflection [rad at the motor] before the nut: that of shaft and screw."""
    beyond = deflection - ops.clip(deflection, -c.half_gap, c.half_gap)
    return c.structure * beyond


def fin_side(ops: Ops, p: Any, angle: Value, u: Any = NONE) -> mechanics.Mechanics:
    """Return the coefficients at the motor of the fin side alone, without rotor, screw and nut, under loads `u`, at
    a fin angle referred to the motor [rad]."""
    return mechanics.coefficients(ops, with_values(p, _NO_ROTOR), angle, u)
