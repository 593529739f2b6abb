"""What the loops of both hydraulic references work on: the piston that the fin's transducer stands for."""

from __future__ import annotations

import math
from collections.abc import Mapping


class PistonLoop:
    """The nominal lever, its transducer, and the integral of a PI position loop at rest and where it is held."""

    def __init__(self, p: Mapping[str, float], angle: float):
        self.p = p
        self.reset(self.read(angle))

    def reset(self, piston: float) -> None:
        """Start at rest at a piston position [m] as it was read."""
        self.before, self.integral = piston, self.resting(piston)  # m, m/s

    def hold(self, piston: float) -> None:
        """Let the integral of a loop at a limit follow the piston [m]."""
        self.integral += self.resting(piston - self.before)

    def piston(self, angle: float) -> float:
        """Return the piston [m] at a fin angle [rad]."""
        arm, start = self.p["kinematics.moment_arm"], self.p["kinematics.initial_angle"]
        return arm * (math.tan(angle + start) - math.tan(start))

    def read(self, angle: float) -> float:
        """Return the piston [m] that the transducer reads at a fin angle [rad]."""
        step = self.p["transducer.resolution"]
        return self.piston(step * math.floor(angle / step + 0.5) if step else angle)

    def resting(self, piston: float) -> float:
        """Return the integral [m/s] that asks for no speed at a piston position [m]."""
        return self.p["controller.position.kp"] * (1.0 - self.p["controller.position.setpoint_weight"]) * piston
