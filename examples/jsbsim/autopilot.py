"""Three-axis attitude hold: sampled PID in body axes, scheduled with dynamic pressure, mixed to four fins.

Signs: a positive roll, pitch or yaw demand is a positive body moment about x, y, z (right side down, nose up, nose
right). A positive fin angle pushes the fin along -z_fin. Four positive angles therefore roll the rocket to the left;
the force of one fin, behind the centre of gravity, turns the nose down by cos(azimuth) and left by sin(azimuth).
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
    """Gains for roll, pitch, yaw, from errors to angular accelerations: `authority` converts these to fin angles.

    `proportional` [1/s2] gives 12 rad/s in roll, and 17 rad/s in pitch and yaw, where the airframe alone has 10 rad/s.
    `derivative` is in 1/s. `integral` [1/s3] holds the trim against the airframe's stability.
    """

    proportional: tuple[float, float, float] = (144.0, 290.0, 290.0)
    derivative: tuple[float, float, float] = (20.0, 24.0, 24.0)
    integral: tuple[float, float, float] = (40.0, 1500.0, 1500.0)


# Estimates from the aircraft file's numbers: rad/s2 for 1 rad of all four fins, at the reference condition.
_REFERENCE_PRESSURE, _REFERENCE_MACH = 150e3, 2.0  # Pa, 1
_AUTHORITY = np.array([4300.0, 240.0, 240.0])

_DEFLECTION = np.array([1.0, sqrt(2.0), sqrt(2.0)])
MIXER = -np.column_stack([np.ones(4), np.cos(AZIMUTHS), np.sin(AZIMUTHS)]) * _DEFLECTION
"""Matrix from roll, pitch and yaw demands to fin angles, shape (4, 3). A demand of 1 rad turns every fin by 1 rad."""
_UNMIXER = np.linalg.pinv(MIXER)


@dataclass(frozen=True)
class Command:
    """The autopilot's commands: fin angles [rad] within their limit, shape (4,), and `axes`.

    `axes` are EMCAS4.fmu's roll_command, pitch_command and yaw_command [rad] before that limit, shape (3,).
    """

    fins: Array
    axes: Array


class Autopilot:
    """An attitude hold with its integrals; call `update` every PERIOD."""

    def __init__(self, gains: Gains) -> None:
        self._gains = gains
        self._integral = np.zeros(3)

    def update(self, state: State, wanted: Array) -> Command:
        """Return the commands at a sample for a wanted roll, pitch, yaw [rad], shape (3,)."""
        error = attitude_error(state.attitude, wanted)
        g = self._gains
        acceleration = (np.array(g.proportional) * error - np.array(g.derivative) * state.body_rates
                        + np.array(g.integral) * self._integral)
        possible = authority(state)
        demand = acceleration / possible
        limited: Array = np.clip(MIXER @ demand, -LIMIT, LIMIT)
        # Back-calculation: the integrals do not wind up. It is continuous: a small difference has a small effect.
        missing = acceleration - possible * (_UNMIXER @ limited)
        self._integral = self._integral + PERIOD * (error - missing / np.array(g.proportional))
        return Command(limited, _DEFLECTION * demand)


def authority(state: State) -> Array:
    """Return the angular acceleration per demand [1/s2], shape (3,), in proportion to the fins' q S 4/beta."""
    beta = sqrt(max(state.mach**2 - 1.0, 0.44))  # at least that at Mach 1.2
    share = state.dynamic_pressure / _REFERENCE_PRESSURE * sqrt(_REFERENCE_MACH**2 - 1.0) / beta
    return _AUTHORITY * share


def to_body(attitude: Array) -> Array:
    """Return the rotation matrix (3, 3) from north, east, down to body axes at an attitude (roll, pitch, yaw) [rad]."""
    (sr, sp, sy), (cr, cp, cy) = np.sin(attitude), np.cos(attitude)
    return np.array([[cp * cy, cp * sy, -sp],
                     [sr * sp * cy - cr * sy, sr * sp * sy + cr * cy, sr * cp],
                     [cr * sp * cy + sr * sy, cr * sp * sy - sr * cy, cr * cp]])


def attitude_error(actual: Array, wanted: Array) -> Array:
    """Return the sine of the angle from actual to wanted attitude (both [rad]) about body x, y, z, shape (3,).

    The angle must be below 90 deg. A wanted pitch above the actual pitch gives a positive y component.
    """
    turn = to_body(wanted) @ to_body(actual).T
    return 0.5 * np.array([turn[1, 2] - turn[2, 1], turn[2, 0] - turn[0, 2], turn[0, 1] - turn[1, 0]])
