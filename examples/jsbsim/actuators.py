"""What moves the fins: the `Actuators` protocol, and two that speak it, an ideal and a second-order actuator.

fmu.py has EMCAS4.fmu and EMCAS.fmu, masters.py EMCAS.fmu in a system of another master.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil, nan, radians
from typing import Protocol

import numpy as np
from scipy.linalg import expm

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
    """Of the vehicle at the fins, body axes [m/s2], shape (3,)."""
    attitude: Array
    """Roll, pitch, yaw [rad], shape (3,)."""
    supply_voltage: float
    """[V]."""
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
    """Of all four [W]: drawn from the bus where the model has one, otherwise mechanical, against the hinge moments."""
    saturated: Array
    """Whether any limit is active."""
    bus_voltage: float = nan
    """At the drives [V]; not a number where the model has no bus."""
    bus_current: float = nan
    """Of all four [A]; likewise."""


class Actuators(Protocol):
    """Four fins."""

    def step(self, time: float, step: float, demand: Demand) -> Response:
        """Advance from `time` [s] by `step` [s] with the demand held."""
        ...

    def close(self) -> None:
        """Free what is held."""
        ...


class Ideal:
    """Each fin stands at its command as soon as it is given."""

    def __init__(self) -> None:
        self._angles = np.zeros(4)

    def step(self, time: float, step: float, demand: Demand) -> Response:
        """The commands, and the rates it took to get there."""
        rates = (demand.commands - self._angles) / step
        self._angles = demand.commands
        return Response(demand.commands, rates, -float(rates @ demand.hinge_moments), np.zeros(4, dtype=bool))

    def close(self) -> None:
        """Nothing is held."""


@dataclass(frozen=True)
class SecondOrderModel:
    """angle'' = natural_frequency^2 (command - angle) - 2 damping natural_frequency angle', rate and angle limited."""

    natural_frequency: float
    """[rad/s]."""
    damping: float
    rate_limit: float
    """[rad/s]."""
    angle_limit: float = LIMIT
    """[rad]."""


class SecondOrder:
    """The textbook actuator: no hinge moment, no friction, no bus."""

    _INNER = 0.125e-3  # s: 1.5 % of a radian at 20 Hz; the limits are applied once in each such step

    def __init__(self, model: SecondOrderModel) -> None:
        self._model = model
        self._states = [(0.0, 0.0)] * 4
        self._transitions: dict[float, list[list[float]]] = {}

    def step(self, time: float, step: float, demand: Demand) -> Response:
        """The linear motion between limits is exact."""
        inner = max(1, ceil(step / self._INNER - 1e-9))
        if step not in self._transitions:
            omega, damping = self._model.natural_frequency, self._model.damping
            dynamics = np.array([[0.0, 1.0], [-omega**2, -2.0 * damping * omega]])
            self._transitions[step] = expm(dynamics * (step / inner)).tolist()
        (a, b), (c, d) = self._transitions[step]
        fastest, farthest = self._model.rate_limit, self._model.angle_limit
        limited = [False] * 4
        for k, command in enumerate(demand.commands.tolist()):
            angle, rate = self._states[k]
            wanted = min(max(command, -farthest), farthest)
            for _ in range(inner):
                moved, faster = wanted + a * (angle - wanted) + b * rate, c * (angle - wanted) + d * rate
                if abs(faster) > fastest:
                    faster = fastest if faster > 0.0 else -fastest
                    moved, limited[k] = angle + 0.5 * (rate + faster) * step / inner, True
                if abs(moved) > farthest:
                    moved, faster, limited[k] = (farthest if moved > 0.0 else -farthest), 0.0, True
                angle, rate = moved, faster
            self._states[k] = angle, rate
        angles, rates = np.array(self._states).T
        return Response(angles.copy(), rates.copy(), -float(rates @ demand.hinge_moments),
                        np.array(limited) | (np.abs(demand.commands) > farthest))

    def close(self) -> None:
        """Nothing is held."""
