"""Lever, screw and fin of the thesis's actuator: kinematics, friction and loads."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from .events import Scalar
from .vehicle import Surroundings, hinge_friction, hinge_moment, masses_of

POLYNOMIAL_ANGLE = math.radians(20.0)  # rad, the angle that scales the Coulomb polynomials
_SIGNS = {1: "positive", -1: "negative"}


def over_temperature(p: Mapping[str, Scalar], kind: str) -> float:
    """Return the ratio of friction at friction.temperature to that at 24 degC; `kind` is viscous or coulomb.

    It is linear between the points of the table and constant outside them.
    """
    at, ratio = ([p[f"friction.table.{column}[{i}]"] for i in range(5)] for column in ("temperature", kind))
    return float(np.interp(p["friction.temperature"], at, ratio))


class Screw:
    """Lever, screw and fin: kinematics, friction and loads, positive along +delta."""

    def __init__(self, parameters: Mapping[str, Scalar]):
        p: Mapping[str, float] = {name: float(value) for name, value in parameters.items()}
        self.p = p
        self.arm, self.lead = p["kinematics.moment_arm"], p["screw.lead"]  # m; m/rad
        self.assembly = p["kinematics.initial_angle"]
        self.stop = p["fin.stop_angle"]
        # Inertias J_t = J_mt + m_n l^2 about the motor and J_ft about the hinge (2.8), (2.13).
        self.motor_inertia = p["inertia.motor"] + p["inertia.screw"] + p["mass.nut"] * self.lead**2
        self.fin_inertia = p["inertia.fin"] + p["inertia.shaft"] + p["inertia.fork"]
        self.masses = masses_of(p)
        self.fin_coulomb, self.fin_viscous = hinge_friction(p)
        viscous_factor = over_temperature(p, "viscous")
        self.coulomb_factor = over_temperature(p, "coulomb")
        self.viscous = {s: p[f"friction.viscous.{n}"] * viscous_factor for s, n in _SIGNS.items()}
        self.polynomial = {s: [p[f"friction.coulomb.{n}[{order}]"] for order in range(7)] for s, n in _SIGNS.items()}

    def motor_angle(self, delta: float) -> float:
        """Return the motor angle [rad] at fin angle `delta` [rad] (2.1 - 2.5)."""
        return self.arm * (math.tan(delta + self.assembly) - math.tan(self.assembly)) / self.lead

    def fin_angle(self, theta: float) -> float:
        """Return the fin angle [rad] at motor angle `theta` [rad], the inverse of (2.5)."""
        return math.atan(self.lead * theta / self.arm + math.tan(self.assembly)) - self.assembly

    def ratio(self, delta: float) -> float:
        """Return the reduction ratio R = dtheta_m/ddelta [-] (2.6)."""
        return self.arm / self.lead * (1.0 + math.tan(delta + self.assembly) ** 2)

    def bend(self, delta: float) -> float:
        """Return R'/R [-] at fin angle `delta` [rad] (2.7)."""
        return 2.0 * math.tan(delta + self.assembly)

    def motor_coulomb(self, delta: float, direction: int) -> float:
        """Return the Coulomb torque at the motor [N.m] at 24 degC, a polynomial in delta / 20 deg, at least 0."""
        x, total = delta / POLYNOMIAL_ANGLE, 0.0
        for coefficient in reversed(self.polynomial[direction]):
            total = total * x + coefficient
        return max(total, 0.0)

    def coulomb(self, delta: float, direction: int) -> float:
        """Return the Coulomb moment at the fin T_c = R C_m + C_f [N.m]."""
        return self.ratio(delta) * self.motor_coulomb(delta, direction) * self.coulomb_factor + self.fin_coulomb

    def loads(self, delta: float, around: Surroundings) -> float:
        """Return the external moment T_f + l R P_n at the fin [N.m], with the rotor's share (2.27 - 2.45)."""
        moment, ratio = hinge_moment(self.masses, self.fin_inertia, delta, around), self.ratio(delta)
        # The rotor turns with the vehicle about its own axis; the ratio refers its torque to the hinge.
        moment -= ratio * (self.p["inertia.motor"] + self.p["inertia.screw"]) * around.faster[0]
        # l R = d / cos^2 phi is the lever of the screw; P_n = m_n f_x (2.10 - 2.12).
        return moment + self.lead * ratio * self.p["mass.nut"] * around.force[0]
