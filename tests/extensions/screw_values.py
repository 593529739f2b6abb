"""Models, values and closed forms that the tests of the screw's efficiency share."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from math import radians
from typing import Any

import numpy as np

from . import runs
from .runs import NO_COULOMB

MODEL, ELASTIC, EXTENSION = "nonlinear+efficiency", "elastic+efficiency", "+efficiency"
NO_DRY = {**NO_COULOMB, "friction.fin_coulomb": 0.0}
# A rigid elastic line but for the screw, which alone stretches.
SCREW_STRETCHES = {"drive_line.backlash": 0.0, "drive_line.torsional_compliance": 0.0}
values_of = partial(runs.values_of, model=MODEL)


def efficiencies(forward: float, backward: float) -> dict[str, float]:
    return {"efficiency.forward": forward, "efficiency.backward": backward}


def ratio(v: Mapping[str, Any], fin: Any) -> Any:
    """Return motor speed over fin rate at a fin angle [rad]."""
    return v["kinematics.moment_arm"] / v["screw.lead"] / np.cos(fin + v["kinematics.initial_angle"])**2


def coulomb(v: Mapping[str, Any], way: str, fin: Any) -> Any:
    """Return the dry friction [N.m] at the motor at a fin angle [rad]; `way` is ``positive`` or ``negative``."""
    return np.polyval([v[f"friction.coulomb.{way}[{n}]"] for n in range(6, -1, -1)], fin / radians(20.0))
