"""What moves the fins: the `Actuators` protocol, and one that speaks it, an ideal actuator.

second_order.py has the package's second-order model, fmu.py FMUs of four fins or of one, masters.py FMUs of one in a
system of another master.
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
    """Held during one communication step. Signs as in the FMU: moments positive along positive fin angle."""

    commands: Array
    """[rad], shape (4,)."""
    hinge_moments: Array
    """[N.m], shape (4,)."""
    acceleration: Array
    """Of the vehicle's centre of gravity, body axes [m/s2], shape (3,)."""
    attitude: Array
    """Roll, pitch, yaw [rad], shape (3,)."""
    body_rates: Array = field(default_factory=lambda: np.zeros(3))
    """p, q, r [rad/s], shape (3,)."""
    angular_acceleration: Array = field(default_factory=lambda: np.zeros(3))
    """d/dt of the body rates [rad/s2], shape (3,)."""
    axes: Array | None = None
    """Roll, pitch, yaw deflections that mix to the commands, before their limit [rad], shape (3,); for actuators that
    mix by themselves."""


@dataclass(frozen=True)
class Response:
    """At the end of the step; arrays have shape (4,)."""

    angles: Array
    """[rad]."""
    rates: Array
    """[rad/s]."""
    power: float
    """Of all four [W]: drawn from the supply where the model has one, otherwise mechanical, against the hinge
    moments."""
    saturated: Array
    """Whether any limit is active."""
    bus_voltage: float = nan
    """At the drives [V]; not a number where the model is fed otherwise, as what follows."""
    bus_current: float = nan
    """Of all four [A]."""
    line_pressure: float = nan
    """At the valves [Pa]."""
    line_flow: float = nan
    """Of all four [m3/s]."""


class Actuators(Protocol):
    """Four fins."""

    def step(self, time: float, step: float, demand: Demand) -> Response:
        """Advance from `time` [s] by `step` [s] with the demand held."""
        ...

    def close(self) -> None:
        """Free what is held."""
        ...


class Ideal:
    """Each fin is at its command at once."""

    def __init__(self) -> None:
        self._angles = np.zeros(4)

    def step(self, time: float, step: float, demand: Demand) -> Response:
        """The commands, and the rates it took to get there."""
        rates = (demand.commands - self._angles) / step
        self._angles = demand.commands
        return Response(demand.commands, rates, -float(rates @ demand.hinge_moments), np.zeros(4, dtype=bool))

    def close(self) -> None:
        """Nothing is held."""
