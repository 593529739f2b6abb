"""What the tests of the efficiency share: the option's models, values and what they check with."""

from __future__ import annotations

from collections.abc import Mapping
from math import radians
from typing import Any

import numpy as np

from emcas_fmu.parameters import load_parameters

MODEL, ELASTIC, OPTION = "nonlinear+efficiency", "elastic+efficiency", "+efficiency"
DRY = {**{f"friction.coulomb.{way}[{n}]": 0.0 for way in ("positive", "negative") for n in range(7)},
       "friction.fin_coulomb": 0.0}


def values(overrides: Mapping[str, Any] | None = None, model: str = MODEL) -> Mapping[str, Any]:
    return load_parameters(model=model).with_values(overrides or {}).values


def efficiencies(forward: float, backward: float) -> dict[str, float]:
    return {"efficiency.forward": forward, "efficiency.backward": backward}


def ratio(v: Mapping[str, Any], fin: Any) -> Any:
    """Motor speed over fin rate at a fin angle [rad]."""
    return v["kinematics.moment_arm"] / v["screw.lead"] / np.cos(fin + v["kinematics.initial_angle"])**2


def coulomb(v: Mapping[str, Any], way: str, fin: Any) -> Any:
    """Dry friction [N.m] at the motor at a fin angle [rad], ``positive`` or ``negative``."""
    return np.polyval([v[f"friction.coulomb.{way}[{n}]"] for n in range(6, -1, -1)], fin / radians(20.0))
