"""Three-axis attitude hold: sampled PID in body axes, scheduled with dynamic pressure, mixed to four fins.

Signs: a positive roll, pitch or yaw demand asks for a positive body moment about x, y, z (right side down, nose up,
nose right). A positive fin angle pushes the fin's end of the tail along -z_fin, so with every angle positive the rocket
rolls to the left, and a fin behind the centre of gravity pushes the nose down by cos(azimuth) and left by sin(azimuth).
"""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt

import numpy as np

from .actuators import LIMIT
from .vehicle import AZIMUTHS, Array, State

PERIOD = 4e-3  # s: 250 Hz


@dataclass(frozen=True)
class Gains:
    """Of roll, pitch, yaw in angular acceleration for an error: airframe's inertia and authority are divided out."""

    proportional: tuple[float, float, float] = (144.0, 290.0, 290.0)
    """[1/s2]: 12 rad/s in roll; 17 rad/s in pitch and yaw, beside the airframe's own 10 rad/s."""
    derivative: tuple[float, float, float] = (20.0, 24.0, 24.0)
    """[1/s]."""
    integral: tuple[float, float, float] = (40.0, 1500.0, 1500.0)
    """[1/s3]: carries the trim against the airframe's stability."""


# Estimates from the aircraft file's numbers at the reference condition: rad/s2 for each rad of all four fins.
_REFERENCE_PRESSURE, _REFERENCE_MACH = 150e3, 2.0  # Pa, 1
_AUTHORITY = np.array([4300.0, 240.0, 240.0])

_DEFLECTION = np.array([1.0, sqrt(2.0), sqrt(2.0)])
MIXER = -np.column_stack([np.ones(4), np.cos(AZIMUTHS), np.sin(AZIMUTHS)]) * _DEFLECTION
"""Fin angles for demands of roll, pitch, yaw; shape (4, 3). A demand of 1 rad turns every fin by 1 rad."""
_UNMIXER = np.linalg.pinv(MIXER)


@dataclass(frozen=True)
class Command:
    """What the autopilot asks for."""

    fins: Array
    """Fin angles within their limit [rad], shape (4,)."""
    axes: Array
    """The same before the limit as EMCAS4.fmu's roll_command, pitch_command, yaw_command [rad], shape (3,)."""


class Autopilot:
    """Call `update` every PERIOD."""

    def __init__(self, gains: Gains) -> None:
        self._gains = gains
        self._integral = np.zeros(3)

    def update(self, state: State, wanted: Array) -> Command:
        """Fin commands for a wanted roll, pitch, yaw [rad], shape (3,)."""
        error = attitude_error(state.attitude, wanted)
        g = self._gains
        acceleration = (np.array(g.proportional) * error - np.array(g.derivative) * state.body_rates
                        + np.array(g.integral) * self._integral)
        possible = authority(state)
        demand = acceleration / possible
        limited: Array = np.clip(MIXER @ demand, -LIMIT, LIMIT)
        # Back-calculation: what the limit takes away, the integral does not wind up for. Continuous, so that the
        # smallest difference has a small effect.
        missing = acceleration - possible * (_UNMIXER @ limited)
        self._integral = self._integral + PERIOD * (error - missing / np.array(g.proportional))
        return Command(limited, _DEFLECTION * demand)


def authority(state: State) -> Array:
    """Angular acceleration for each rad of demand [1/s2], shape (3,): as the fins' q S 4/beta."""
    beta = sqrt(max(state.mach**2 - 1.0, 0.44))  # no less than at Mach 1.2
    share = state.dynamic_pressure / _REFERENCE_PRESSURE * sqrt(_REFERENCE_MACH**2 - 1.0) / beta
    return _AUTHORITY * share


def to_body(attitude: Array) -> Array:
    """Matrix that turns coordinates from north, east, down to body axes, for roll, pitch, yaw [rad]; shape (3, 3)."""
    (sr, sp, sy), (cr, cp, cy) = np.sin(attitude), np.cos(attitude)
    return np.array([[cp * cy, cp * sy, -sp],
                     [sr * sp * cy - cr * sy, sr * sp * sy + cr * cy, sr * cp],
                     [cr * sp * cy + sr * sy, cr * sp * sy - sr * cy, cr * cp]])


def attitude_error(actual: Array, wanted: Array) -> Array:
    """The turn from actual to wanted attitude about body x, y, z [rad], shape (3,); sine of the angle, so below 90 deg.

    A wanted pitch above the actual one gives a positive y component.
    """
    turn = to_body(wanted) @ to_body(actual).T
    return 0.5 * np.array([turn[1, 2] - turn[2, 1], turn[2, 0] - turn[0, 2], turn[0, 1] - turn[1, 0]])
