"""A friction clutch that brings screw and motor together, against its closed form."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest

from emcas_fmu.actuators.declaration import Actuator, PlantInputs
from emcas_fmu.namespace import Record
from emcas_fmu.ops.floats import FLOATS

_STEP = 1e-4  # s
_MOST = 1.0  # s, of a clutch that does not lock


def ratio(values: Mapping[str, Any], fin: float = 0.0) -> float:
    """Screw over fin, d/(l cos^2)."""
    lever = fin + values["kinematics.initial_angle"]
    return float(values["kinematics.moment_arm"] / values["screw.lead"] / np.cos(lever)**2)


def assert_locks(actuator: Actuator, values: Mapping[str, Any], x: Record, u: PlantInputs, torque: float,
                 approach: float) -> None:
    """Check that a clutch locks after t = dw/a, with E = T_c dw^2/(2 a) as heat, and that it stays locked.

    The difference dw is the motor's speed at the start `x`, where the screw is at rest; `torque` T_c [N.m], `approach`
    a [rad/s2].
    """
    p, begin, time = actuator.namespace(values), x.motor_speed, 0.0
    while x.motor_speed != x.screw_speed:
        moved, used = actuator.step(FLOATS, p, x, u, _STEP)
        x, time = x.replace(**moved), time + used
        assert time < _MOST
    # Torques are constant, so that steps are exact but for rounding of the differences in ROS2 (1e-8).
    assert time == pytest.approx(begin / approach, rel=1e-6)
    heat = values["clutch.heat_capacity"] * (x.clutch_temperature - values["friction.temperature"])
    assert heat == pytest.approx(0.5 * torque * begin**2 / approach, rel=1e-6)
    # Locked they stay, to the bit.
    for _ in range(20):
        moved, _ = actuator.step(FLOATS, p, x, u, _STEP)
        x = x.replace(**moved)
        assert x.motor_speed == x.screw_speed
