"""Inputs that jump at random, for what is compared with an independent integration."""

from __future__ import annotations

from typing import Any

import numpy as np


def hammered(seed: int, rows: int) -> dict[str, Any]:
    """Return commands, loads, supply and enable at rows 1 ms apart: locks, slips, stops, limits of coils and drive."""
    rng = np.random.default_rng(seed)

    def held(low: float, high: float, count: int) -> Any:
        column = np.zeros(rows + 1)
        for at in np.sort(rng.integers(0, rows, count)):
            column[at:] = rng.uniform(low, high)
        return column

    return {"fin_command": held(-0.4, 0.4, 6), "aero_torque": held(-350.0, 350.0, 8),
            "supply_voltage": 39.0 + held(-20.0, 10.0, 3), "enable": (held(-1.0, 4.0, 4) >= 0.0).astype(float)}
