"""Four actuators control a rocket in RocketPy against the hinge moments of its fins."""

from __future__ import annotations

from math import radians

import numpy as np
import pytest

from tests.hosts.host import missing

pytestmark = pytest.mark.slow  # RocketPy needs a minute for a flight
try:
    from examples.sounding_rocket import fly
except ImportError as error:
    missing(str(error))
DURATION = 3.2  # s: a second after the turn


def test_servo_holds_the_roll_angle_against_the_hinge_moments() -> None:
    flight = fly.fly("servo", duration=DURATION)
    assert fly.held(flight) < radians(8.0)  # 5 deg by the misalignment at this gain, and backlash
    turned = np.abs(flight.angle + fly.MISALIGNED) > radians(1.0)
    assert turned.any()
    assert (flight.hinge_moment[turned] * (flight.angle + fly.MISALIGNED)[turned] < 0.0).mean() > 0.8  # restoring


def test_hinge_moments_turn_a_weak_servo_to_its_stops() -> None:
    weak = fly.fly("servo", "xl330", duration=DURATION)
    assert fly.held(weak) > radians(45.0)
    assert np.max(np.abs(weak.hinge_moment)) > 0.887  # N.m, its stall torque
    assert np.max(np.abs(weak.angle)) > 2.0 * fly.LIMIT  # beyond any command
