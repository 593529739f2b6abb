"""Random actuators with known parameters, which tests identify."""

from __future__ import annotations

from math import radians

import numpy as np

from emcas_fmu.ops.arrays import ARRAYS
from emcas_fmu.parameters import ParameterSet
from emcas_fmu.physics import friction


def draw_truth(parameters: ParameterSet, rng: np.random.Generator) -> ParameterSet:
    """Return the set with random values of all identified parameters, far beyond their uncertainty."""
    v = parameters.values
    change: dict[str, object] = {}

    def vary(name: str, low: float, high: float) -> None:
        change[name] = float(v[name]) * float(np.exp(rng.uniform(np.log(low), np.log(high))))

    for name in ("drive.current_gain", "drive.kp", "motor.inductance", "motor.resistance"):
        vary(name, 0.4, 2.5)
    vary("inertia.motor", 0.6, 1.7)
    vary("drive.ki", 0.3, 8.0)
    change["drive.transport_delay"] = float(np.exp(rng.uniform(np.log(3e-4), np.log(8e-3))))
    change["drive.current_offset"] = float(rng.uniform(-0.3, 0.3))
    for direction in ("positive", "negative"):
        vary(f"friction.viscous.{direction}", 0.6, 1.8)
        scale = rng.uniform(0.7, 1.4)
        for n in range(7):
            name = f"friction.coulomb.{direction}[{n}]"
            change[name] = float(v[name]) * scale + (rng.normal(0.0, 0.006) if n else 0.0)
    change["friction.table.viscous[1]"] = float(rng.uniform(1.2, 2.0))
    change["friction.table.coulomb[1]"] = float(rng.uniform(1.1, 1.5))
    change["kinematics.initial_angle"] = float(radians(rng.uniform(-8.0, 8.0)))
    return parameters.with_values(change)


def largest_difference(parameters: ParameterSet, other: ParameterSet) -> float:
    """Return the largest difference [N.m] of two sets' Coulomb friction within +-command.limit in both directions."""
    limit = parameters.values["command.limit"]
    fin = np.linspace(-limit, limit, 401)
    pairs = [[friction.coulomb_reference(ARRAYS, s.nested(), np.array(way), fin) for s in (parameters, other)]
             for way in (1.0, -1.0)]
    return float(max(np.abs(a - b).max() for a, b in pairs))
