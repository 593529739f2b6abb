"""The thesis's actuator between two discrete instants: equations of motion, smooth in each mode.

The state is (fin angle [rad], fin rate [rad/s], motor current [A], drive integral xi [V]). Dry friction, the voltage
limit and the mechanical stops make the right-hand side discontinuous; a `Mode` selects the smooth equations.
"""

from __future__ import annotations

from collections.abc import Mapping
from operator import itemgetter
from typing import NamedTuple

from .actuator import Sample
from .controllers import Controllers
from .drive import FREE, Driven
from .events import Accuracy, Body, Changes, Scalar, StateVector
from .screw import Screw
from .trajectory import Following
from .vehicle import Surroundings


class Mode(NamedTuple):
    """`motion` is the direction of sliding, or 0 while friction or a stop holds the fin; `drive` is the drive's mode.

    `fin` is the direction of the fin behind an elastic gear, `flank` the side on which the teeth of a gear press.
    """

    motion: int = 0
    drive: int = FREE
    fin: int = 0
    flank: int = 0


class Plant(Screw, Driven):
    """Mechanics, motor and current-mode drive of one actuator."""

    # The step stays below the time constant of the current loop, L/(R + Kp) = 0.11 ms, the model's shortest.
    accuracy = Accuracy(1e-11, (1e-2, 1.0, 1.0, 1.0), 1e-4)
    names = ("fin_angle", "fin_rate", "motor_current", "motor_voltage", "drive_reference")
    current = 2

    def __init__(self, parameters: Mapping[str, Scalar]):
        super().__init__(parameters)
        # At rest the inductive voltage n w L i vanishes at once, so the voltage limit jumps.
        rest: Changes = {1: 0.0, "drive": lambda y, around: self.drive_mode(self.motor(y, Mode(), around), around)}
        self.bodies = Body("motion", itemgetter(1), self.excess, rest, 0, self.stop),

    def start(self) -> tuple[StateVector, Mode]:
        return [self.p["fin.start_angle"], 0.0, 0.0, 0.0], Mode()

    def controller(self, nominal: Screw) -> Sample:
        """Return the position and velocity loops, with a trajectory generator before them if there is one."""
        loops = (Following if nominal.p.get("trajectory.natural_frequency") else Controllers)(self, nominal)
        return lambda y, command, enable: loops.sample(y[0], y[1], command, enable, y[2])

    def outputs(self, y: StateVector, around: Surroundings) -> tuple[float, ...]:
        return *y[:3], self.voltage(y, around)

    def speed(self, y: StateVector) -> float:
        return self.ratio(y[0]) * y[1]

    def acceleration(self, y: StateVector, mode: Mode, around: Surroundings) -> float:
        return self.ratio(y[0]) * (self.turning(y, mode, around) + self.bend(y[0]) * y[1] ** 2)

    def slope(self, y: StateVector, mode: Mode, around: Surroundings) -> tuple[float, ...]:
        return y[1], self.turning(y, mode, around), *self.electrical(self.motor(y, mode, around), mode.drive, around)

    def turning(self, y: StateVector, mode: Mode, around: Surroundings) -> float:
        """Return the acceleration of the fin [rad/s2]."""
        delta, omega, current, _ = y
        motion = mode.motion
        if not motion:
            return 0.0
        ratio = self.ratio(delta)
        ratio_slope = ratio * self.bend(delta)  # R' (2.7)
        moment = (  # (2.15 - 2.17)
            ratio * self.motor_torque(current)
            - (ratio * ratio * self.viscous[motion] + self.fin_viscous) * omega
            - self.motor_inertia * ratio * ratio_slope * omega * omega
            + self.loads(delta, around)
            - motion * self.coulomb(delta, motion)
        )
        inertia = self.fin_inertia + self.motor_inertia * ratio * ratio  # M = J_ft + J_t R^2
        return moment / inertia

    def excess(self, y: StateVector, _mode: Mode, around: Surroundings, side: int) -> float:
        """Return the moment [N.m] on a resting fin towards `side` beyond stiction."""
        moment = self.ratio(y[0]) * self.motor_torque(y[2]) + self.loads(y[0], around)
        return side * moment - self.coulomb(y[0], side)


class Geared(Plant):
    """Motor, drive and fin of the thesis's actuator, connected by a gear of constant ratio."""

    def __init__(self, parameters: Mapping[str, Scalar], turns: float, inertia: Scalar):
        self.turns = turns  # motor turns per fin turn
        super().__init__({**parameters, "kinematics.moment_arm": turns, "kinematics.initial_angle": 0.0,
                          "screw.lead": 1.0, "mass.nut": 0.0, "inertia.screw": inertia})

    def motor_angle(self, delta: float) -> float:
        return self.turns * delta

    def fin_angle(self, theta: float) -> float:
        return theta / self.turns

    def ratio(self, delta: float) -> float:
        """Return the gear ratio, motor turns per fin turn [-]."""
        return self.turns

    def bend(self, delta: float) -> float:
        """Return R'/R [-], 0 for a constant ratio."""
        return 0.0


simulate = Plant.simulate
