"""A second-order actuator from the FMU itself: its small step, and the rate of its large one."""

from __future__ import annotations

from math import radians
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares

from .actuators import Demand, SecondOrderModel
from .fmu import Fmu
from .vehicle import Array

SMALL, LARGE = radians(1.0), radians(20.0)  # rad: within the small-signal range, and the whole range
_STEP, _ROWS = 1e-3, 100  # s, and how many of them: longer than the rise, before the slow integral action counts


def step_response(path: Path, size: float) -> tuple[Array, Array]:
    """Time [s] and angle [rad] of an unloaded fin after a command of `size` [rad]; shape (100,)."""
    fins = Fmu(path, parameters={})
    try:
        zero = np.zeros(4)
        demand = Demand(np.full(4, size), zero, np.zeros(3), np.zeros(3), 39.0)
        angles = [float(fins.step(k * _STEP, _STEP, demand).angles[0]) for k in range(_ROWS)]
    finally:
        fins.close()
    return np.arange(1, _ROWS + 1) * _STEP, np.array(angles)


def unit_step(time: Array, omega: float, damping: float) -> Array:
    """Response of the underdamped or aperiodic second-order system to a unit step; shape of `time`."""
    root = np.sqrt(complex(damping**2 - 1.0))
    p, q = omega * (-damping + root), omega * (-damping - root)
    response: Array = (1.0 + (q * np.exp(p * time) - p * np.exp(q * time)) / (p - q)).real
    return response


def fit(path: Path) -> SecondOrderModel:
    """Natural frequency and damping by least squares on the response to 1 deg, rate limit from that to 20 deg."""
    time, small = step_response(path, SMALL)
    # The level is free: a small step ends a little off its command, held by friction until the integral has grown.
    found = least_squares(lambda x: x[2] * unit_step(time, x[0], x[1]) - small / SMALL, [100.0, 0.71, 1.0],
                          bounds=([10.0, 0.1, 0.5], [1000.0, 3.0, 2.0]))
    _, large = step_response(path, LARGE)
    return SecondOrderModel(float(found.x[0]), float(found.x[1]), float(np.max(np.diff(large)) / _STEP))
