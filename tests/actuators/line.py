"""Simulations of the elastic actuator for its tests."""

from __future__ import annotations

from collections.abc import Mapping
from math import tan
from typing import Any

import numpy as np

from emcas_fmu.parameters import load_parameters
from emcas_fmu.simulation import simulate

MODEL = "elastic"
BASE = load_parameters(model=MODEL)
DRY = {**{f"friction.coulomb.{way}[{n}]": 0.0 for way in ("positive", "negative") for n in range(7)},
       "friction.fin_coulomb": 0.0}
SMOOTH = {**DRY, "friction.viscous.positive": 0.0, "friction.viscous.negative": 0.0}
RIGID = {"drive_line.axial_compliance": 0.0, "drive_line.torsional_compliance": 0.0, "drive_line.backlash": 0.0}

# In series these are 10 kN.m/rad about the hinge.
HINGE = {"drive_line.fork_stiffness": 4e4, "drive_line.shaft_stiffness": 2e4, "drive_line.structure_stiffness": 4e4}


def values_of(overrides: Mapping[str, Any] | None = None) -> Mapping[str, Any]:
    """Return the default values with overrides."""
    return BASE.with_values(overrides or {}).values


def run_of(overrides: Mapping[str, Any], stop: float, step: float = 1e-3, **inputs: Any) -> dict[str, Any]:
    return simulate(values_of(overrides), stop, step, model=MODEL, **inputs)


def motor_angle_of(values: Mapping[str, Any], fin: Any) -> Any:
    """Return the motor angle [rad] that a rigid drive line has at a fin angle [rad]."""
    start = values["kinematics.initial_angle"]
    return values["kinematics.moment_arm"] / values["screw.lead"] * (np.tan(fin + start) - np.tan(start))


def fin_angle_of(angle: Any) -> Any:
    """Return the fin angle [rad] that a rigid drive line has at a motor angle [rad]."""
    values = values_of()
    start = values["kinematics.initial_angle"]
    return np.arctan(values["screw.lead"] / values["kinematics.moment_arm"] * angle + tan(start)) - start
