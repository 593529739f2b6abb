"""The `Actuators` protocol of the four fins, and an ideal actuator.

Other implementations are second_order.py (the package's second-order model), fmu.py (FMUs of four fins or of one) and
masters.py (FMUs of one fin in a system of another master).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import nan, radians
from typing import Protocol

import numpy as np

from .vehicle import Array

LIMIT = radians(20.0)  # rad, of commands


@dataclass(frozen=True)
class Demand:
    """Inputs that are held during one communication step; moments are positive along a positive fin angle.

    `commands` [rad] and `hinge_moments` [N.m] have shape (4,). The vehicle's motion in body axes has shape (3,): the
    `acceleration` [m/s2] of the centre of gravity, `attitude` (roll, pitch, yaw) [rad], `body_rates` (p, q, r) [rad/s]
    and `angular_acceleration` [rad/s2]. `axes` are the roll, pitch and yaw commands [rad], before the fins' limit, for
    an FMU that mixes.
    """

    commands: Array
    hinge_moments: Array
    acceleration: Array
    attitude: Array
    body_rates: Array = field(default_factory=lambda: np.zeros(3))
    angular_acceleration: Array = field(default_factory=lambda: np.zeros(3))
    axes: Array | None = None


@dataclass(frozen=True)
class Response:
    """Outputs at the end of a step; arrays have shape (4,).

    `angles` are in rad, `rates` in rad/s. `power` [W] of all four fins is that from the supply, or without a supply the
    mechanical power against the hinge moments. `saturated` says whether a limit is active. `bus_voltage` [V] at the
    drives, `bus_current` [A], `line_pressure` [Pa] at the valves and `line_flow` [m3/s] are nan without such a supply.
    """

    angles: Array
    rates: Array
    power: float
    saturated: Array
    bus_voltage: float = nan
    bus_current: float = nan
    line_pressure: float = nan
    line_flow: float = nan


class Actuators(Protocol):
    """The actuators of four fins."""

    def step(self, time: float, step: float, demand: Demand) -> Response:
        """Return the response after a step from `time` [s] by `step` [s] with the demand held."""

    def close(self) -> None:
        """Free all resources."""


class Ideal:
    """Four fins that are at their commands at once."""

    def __init__(self) -> None:
        self._angles = np.zeros(4)

    def step(self, time: float, step: float, demand: Demand) -> Response:
        """Return the commands as angles, and their mean rates in the step."""
        rates = (demand.commands - self._angles) / step
        self._angles = demand.commands
        return Response(demand.commands, rates, -float(rates @ demand.hinge_moments), np.zeros(4, dtype=bool))

    def close(self) -> None:
        """Do nothing."""
