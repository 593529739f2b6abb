"""Simulations of the electrohydrostatic actuator for its tests."""

from __future__ import annotations

from collections.abc import Mapping
from math import cos
from typing import Any

from emcas_fmu.parameters import load_parameters
from emcas_fmu.simulation import simulate

MODEL = "electrohydrostatic"
BASE = load_parameters(model=MODEL)
DRY = {"friction.fin_coulomb": 0.0, "cylinder.coulomb_friction": 0.0, "pump.coulomb_friction": 0.0,
       "pump.pressure_friction": 0.0}
"""Parameters without dry friction."""
EXACT = {"transducer.resolution": 0.0}


def values_of(overrides: Mapping[str, Any] | None = None) -> Mapping[str, Any]:
    """Return the default values with overrides."""
    return BASE.with_values(overrides or {}).values


def run_of(overrides: Mapping[str, Any], stop: float, step: float = 1e-3, **inputs: Any) -> dict[str, Any]:
    return simulate(values_of(overrides), stop, step, model=MODEL, **inputs)


def lever(values: Mapping[str, Any], angle: Any = 0.0) -> Any:
    """Return the piston's displacement over the fin angle, dx/d(delta) [m]."""
    return values["kinematics.moment_arm"] / cos(angle + values["kinematics.initial_angle"]) ** 2
