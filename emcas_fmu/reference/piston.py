"""Lever and position loop of the hydraulic actuators: the loop controls the piston by the fin's transducer."""

from __future__ import annotations

import math
from collections.abc import Mapping


def lever(p: Mapping[str, float], angle: float) -> tuple[float, float, float]:
    """Return the piston's displacement x [m], dx/d(angle) [m/rad] and its derivative [m/rad2] at a fin angle [rad]."""
    arm, start = p["kinematics.moment_arm"], p["kinematics.initial_angle"]
    tangent = math.tan(angle + start)
    ratio = arm / math.cos(angle + start) ** 2
    return arm * (tangent - math.tan(start)), ratio, 2.0 * ratio * tangent


class PistonLoop:
    """The nominal lever, its transducer, and the integral of a PI position loop at rest and where it is held."""

    def __init__(self, p: Mapping[str, float], angle: float):
        self.p = p
        self.reset(self.read(angle))

    def reset(self, piston: float) -> None:
        """Start at rest at a measured piston position [m]."""
        self.before, self.integral = piston, self.resting(piston)  # m, m/s

    def hold(self, piston: float) -> None:
        """Move the integral of a loop at a limit with the piston [m]."""
        self.integral += self.resting(piston - self.before)

    def piston(self, angle: float) -> float:
        """Return the piston position [m] at a fin angle [rad]."""
        return lever(self.p, angle)[0]

    def read(self, angle: float) -> float:
        """Return the piston position [m] that the transducer measures at a fin angle [rad]."""
        step = self.p["transducer.resolution"]
        return self.piston(step * math.floor(angle / step + 0.5) if step else angle)

    def resting(self, piston: float) -> float:
        """Return the integral [m/s] with which the speed reference at a piston position [m] is 0."""
        return self.p["controller.position.kp"] * (1.0 - self.p["controller.position.setpoint_weight"]) * piston
