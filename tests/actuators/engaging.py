"""Runs of the two actuators with clutches, and the closed form of a clutch that locks."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest
from hypothesis import strategies as st

from emcas_fmu.actuators.declaration import Actuator, PlantInputs
from emcas_fmu.namespace import Record
from emcas_fmu.ops.floats import FLOATS
from emcas_fmu.simulation import simulate

_STEP = 1e-4  # s
_TIMEOUT = 1.0  # s, for a clutch that does not lock
INPUT_PROFILES = st.lists(
    st.tuples(st.floats(-0.4, 0.4), st.floats(-350.0, 350.0), st.booleans(), st.floats(0.0, 60.0)),
    min_size=1, max_size=6)
"""Equally long levels of command [rad], load [N.m], enable and supply voltage [V]."""


def run_profile(model: str, values: Mapping[str, Any], profile: list[Any], sign: float = 1.0) -> dict[str, Any]:
    """Simulate 0.3 s with an input profile, whose commands and loads are multiplied by `sign`."""
    index = np.minimum(np.arange(301) * len(profile) // 301, len(profile) - 1)
    command, load, enable, supply = (np.array(column, float)[index] for column in zip(*profile, strict=True))
    return simulate(values, 0.3, model=model, fin_command=sign * command, aero_torque=sign * load, enable=enable,
                    supply_voltage=supply)


def ratio(values: Mapping[str, Any], fin: float = 0.0) -> float:
    """Return the speed of the screw over that of the fin, d/(l cos^2), at a fin angle [rad]."""
    lever = fin + values["kinematics.initial_angle"]
    return float(values["kinematics.moment_arm"] / values["screw.lead"] / np.cos(lever)**2)


def assert_locks(actuator: Actuator, values: Mapping[str, Any], x: Record, u: PlantInputs, torque: float,
                 approach: float) -> None:
    """Check that a clutch locks after t = dw/a with the heat E = T_c dw^2/(2 a), and that it stays locked.

    At the start `x` the screw is at rest, and dw is the motor's speed; `torque` is T_c [N.m], and `approach` is the
    rate a [rad/s2] at which dw falls.
    """
    p, start_speed, time = actuator.namespace(values), x.motor_speed, 0.0
    while x.motor_speed != x.screw_speed:
        moved, used = actuator.step(FLOATS, p, x, u, _STEP)
        x, time = x.replace(**moved), time + used
        assert time < _TIMEOUT
    # Torques are constant, so that steps are exact except for rounding of the difference quotients in ROS2 (1e-8).
    assert time == pytest.approx(start_speed / approach, rel=1e-6)
    heat = values["clutch.heat_capacity"] * (x.clutch_temperature - values["friction.temperature"])
    assert heat == pytest.approx(0.5 * torque * start_speed**2 / approach, rel=1e-6)
    # Motor and screw stay locked: their speeds are equal to the bit.
    for _ in range(20):
        moved, _ = actuator.step(FLOATS, p, x, u, _STEP)
        x = x.replace(**moved)
        assert x.motor_speed == x.screw_speed
