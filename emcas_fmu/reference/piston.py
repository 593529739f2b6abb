"""Lever, cylinder and position loop of the hydraulic actuators.

The state begins with fin angle [rad], fin rate [rad/s] and the pressures of both chambers [Pa].
"""

from __future__ import annotations

import math
from abc import ABC
from collections.abc import Callable, Mapping
from operator import itemgetter
from typing import Any

from .actuator import ReferenceActuator
from .events import Body, StateVector
from .vehicle import Surroundings, clip, hinge_friction, hinge_moment, masses_of

FIN, RATE, ONE, TWO = range(4)


def lever(p: Mapping[str, float], angle: float) -> tuple[float, float, float]:
    """Return the piston's displacement x [m], dx/d(angle) [m/rad] and its derivative [m/rad2] at a fin angle [rad]."""
    arm, start = p["kinematics.moment_arm"], p["kinematics.initial_angle"]
    tangent = math.tan(angle + start)
    ratio = arm / math.cos(angle + start) ** 2
    return arm * (tangent - math.tan(start)), ratio, 2.0 * ratio * tangent


class Cylinder(ReferenceActuator, ABC):
    """Cylinder, lever and fin; a field `fin` of the mode is the fin's direction, 0 at rest."""

    def __init__(self, parameters: Mapping[str, float]):
        p = self.p = parameters
        self.inertia, self.masses = p["inertia.fin"] + p["inertia.shaft"] + p["inertia.fork"], masses_of(p)
        self.dry, self.viscous = hinge_friction(p)
        self.bodies = Body("fin", itemgetter(RATE), self._excess, {RATE: 0.0}, FIN, p["fin.stop_angle"]),

    def _moment(self, y: StateVector, ratio: float, around: Surroundings) -> float:
        """Return the moment [N.m] of pressures and loads at a ratio dx/d(angle) [m/rad]."""
        force = self.p["cylinder.area"] * (y[ONE] - y[TWO]) + self.p["cylinder.moving_mass"] * around.force[0]
        return ratio * force + hinge_moment(self.masses, self.inertia, y[FIN], around)

    def _dry(self, ratio: float) -> float:
        """Return the dry friction [N.m] about the hinge at a ratio dx/d(angle) [m/rad]."""
        return self.dry + ratio * self.p["cylinder.coulomb_friction"]

    def _excess(self, y: StateVector, _mode: Any, around: Surroundings, side: int) -> float:
        """Return the moment [N.m] on a resting fin towards `side` beyond stiction."""
        _, ratio, _ = lever(self.p, y[FIN])
        return side * self._moment(y, ratio, around) - self._dry(ratio)

    def turning(self, y: StateVector, way: int, around: Surroundings) -> float:
        """Return the acceleration [rad/s2] of a fin that slides in the direction `way`, 0 at rest."""
        if not way:
            return 0.0
        p, (_, ratio, bend) = self.p, lever(self.p, y[FIN])
        mass = p["cylinder.moving_mass"]
        viscous = p["cylinder.viscous_friction"] * ratio**2 + self.viscous
        net = (self._moment(y, ratio, around) - way * self._dry(ratio) - viscous * y[RATE]
               - mass * ratio * bend * y[RATE] ** 2)
        return net / (self.inertia + mass * ratio**2)

    def chambers(self, y: StateVector) -> tuple[float, float, float]:
        """Return the rate [m3/s] at which the first chamber grows and the second shrinks, and both volumes [m3]."""
        position, ratio, _ = lever(self.p, y[FIN])
        area, dead = self.p["cylinder.area"], self.p["cylinder.dead_volume"]
        return area * ratio * y[RATE], dead + area * position, dead - area * position


class PistonLoop:
    """PI controller of the piston position, which is computed from the transducer's fin angle.

    The speed reference is within +-`fastest` [m/s]. From this reference, the measured position [m] and the state,
    `inner` returns the output [V or 1] and the excess of its demand over its limits, 0 within them.
    """

    def __init__(self, p: Mapping[str, float], fastest: float,
                 inner: Callable[[float, float, StateVector], tuple[float, float]]):
        self.p, self.fastest, self.inner = p, fastest, inner
        self._reset(self.read(p["fin.start_angle"]))

    def _reset(self, piston: float) -> None:
        """Reset the loop to rest at a measured piston position [m]."""
        self.last_piston, self.integral = piston, self._resting(piston)  # m, m/s

    def _resting(self, piston: float) -> float:
        """Return the integral [m/s] at which the speed reference is 0 for rest at a piston position [m]."""
        return self.p["controller.position.kp"] * (1.0 - self.p["controller.position.setpoint_weight"]) * piston

    def read(self, angle: float) -> float:
        """Return the piston position [m] that the transducer measures at a fin angle [rad]."""
        step = self.p["transducer.resolution"]
        return lever(self.p, step * math.floor(angle / step + 0.5) if step else angle)[0]

    def sample(self, y: StateVector, command: float, enable: bool) -> float:
        """Return the output of `inner` at a state of the actuator under a command [rad]; 0 if disabled."""
        p, piston = self.p, self.read(y[FIN])
        if not enable:
            self._reset(piston)
            return 0.0
        target = lever(p, clip(command, p["command.limit"]))[0]
        weighted = p["controller.position.setpoint_weight"] * target - piston
        speed, error = p["controller.position.kp"] * weighted + self.integral, target - piston
        output, excess = self.inner(clip(speed, self.fastest), piston, y)
        if (abs(speed) > self.fastest and speed * error > 0.0) or excess * error > 0.0:
            self.integral += self._resting(piston - self.last_piston)  # at a limit the integral moves with the piston
        else:
            self.integral += p["controller.sample_time"] * p["controller.position.ki"] * error
        self.last_piston = piston
        return output
