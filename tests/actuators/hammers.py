"""Inputs that jump, for comparisons with independent integrations."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

Signal = Callable[[Any], Any]
"""A function from times [s] to values."""


def jumps(*levels: tuple[float, float]) -> Signal:
    """Return a signal that jumps to each level at its time [s], at a row of 1 ms; it is 0 before the first."""
    def column(time: Any) -> Any:
        values = np.zeros_like(time)
        for begin, level in levels:
            values[time > begin - 5e-4] = level
        return values

    return column


def random_inputs(seed: int, rows: int) -> dict[str, Any]:
    """Return random commands, loads, supply and enable at rows 1 ms apart, for the actuators with clutches.

    With them clutches lock and slip, the fin meets its stops, and currents of coils and drive reach their limits.
    """
    rng = np.random.default_rng(seed)

    def random_steps(low: float, high: float, count: int) -> Any:
        column = np.zeros(rows + 1)
        for begin in np.sort(rng.integers(0, rows, count)):
            column[begin:] = rng.uniform(low, high)
        return column

    return {"fin_command": random_steps(-0.4, 0.4, 6), "aero_torque": random_steps(-350.0, 350.0, 8),
            "supply_voltage": 39.0 + random_steps(-20.0, 10.0, 3),
            "enable": (random_steps(-1.0, 4.0, 4) >= 0.0).astype(float)}
