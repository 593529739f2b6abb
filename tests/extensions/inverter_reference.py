"""An independent integration of three motor phases on the diodes of an open bridge with a stiff supply."""

from __future__ import annotations

from typing import Any

import numpy as np

V, R, L, K = 39.0, 0.25, 0.6e-3, 0.11  # V, Ohm, H, V.s/rad line to line, of the default motor and supply
PHASE = 2.0 * np.pi / 3.0 * np.arange(3.0)[:, None]


class Phases:
    """Currents [A] of three phases in star, for `count` motors, and the rail on which each phase conducts.

    The rail is 1 for the lower one, with a current into the motor, -1 for the upper one, and 0 without a current.
    """

    def __init__(self, count: int) -> None:
        self.current, self.rail = np.zeros((3, count)), np.zeros((3, count))

    def step(self, angle: Any, speed: Any, pairs: Any, h: float) -> tuple[Any, Any]:
        """Step by `h` [s] at motor angle [rad] and speed [rad/s]; return torque [N.m] and power into the supply [W]."""
        shape = np.cos(pairs * angle - PHASE)
        emf = K / np.sqrt(3.0) * speed * shape
        open_ = np.count_nonzero(self.rail, axis=0) < 2
        self.rail[:, open_] = self.current[:, open_] = 0.0
        begins = open_ & (emf.max(axis=0) - emf.min(axis=0) > V)  # two phases begin to conduct
        self.rail += np.where(begins & (emf == emf.max(axis=0)), -1.0, 0.0)
        self.rail += np.where(begins & (emf == emf.min(axis=0)), 1.0, 0.0)
        two = np.count_nonzero(self.rail, axis=0) == 2
        floating = self._star(emf) + emf  # potential of a phase without current
        third = two & (self.rail == 0.0)
        self.rail = np.where(third & (np.abs(floating) > V / 2.0), -np.sign(floating), self.rail)

        on = self.rail != 0.0
        rise = (-V / 2.0 * self.rail - emf - self._star(emf) - R / 2.0 * self.current) / (L / 2.0)
        self.current += np.where(on, h * rise, 0.0)
        self.rail = np.where(self.current * self.rail < 0.0, 0.0, self.rail)  # a diode blocks
        self.current = np.where(self.rail == 0.0, 0.0, self.current)
        on = self.rail != 0.0
        self.current -= np.where(on, self.current.sum(axis=0) / np.maximum(on.sum(axis=0), 1), 0.0)
        return K / np.sqrt(3.0) * (shape * self.current).sum(axis=0), V / 2.0 * (self.rail * self.current).sum(axis=0)

    def _star(self, emf: Any) -> Any:
        """Return the potential [V] of the star point, from the phases that conduct."""
        on = self.rail != 0.0
        return np.where(on, -V / 2.0 * self.rail - emf, 0.0).sum(axis=0) / np.maximum(on.sum(axis=0), 1)


def braking_current(pairs: Any, speed: Any) -> tuple[Any, Any]:
    """Return the mean braking current [A], torque over K, and the mean power into the supply [W] at steady speeds."""
    phases, steps, turns = Phases(len(speed)), 1000, 6
    sums = np.zeros((2, len(speed)))
    for k in range(turns * steps):
        electrical_angle = 2.0 * np.pi * k / steps
        torque, power = phases.step(electrical_angle / pairs, speed, pairs, 2.0 * np.pi / (steps * pairs * speed))
        if k >= (turns - 1) * steps:
            sums += torque, power
    return -sums[0] / steps / K, sums[1] / steps
