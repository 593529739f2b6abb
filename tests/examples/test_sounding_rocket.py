"""Four actuators control a rocket in RocketPy against the hinge moments of its fins."""

from __future__ import annotations

import os
import subprocess
import sys
from math import radians
from pathlib import Path

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


@pytest.mark.parametrize(("output", "words"), [("x/roll.png", "there is no folder"), ("roll.txt", "must end in .svg")])
def test_output_is_checked_before_the_flights(tmp_path: Path, output: str, words: str) -> None:
    ran = subprocess.run([sys.executable, str(fly.__file__), "--output", output], capture_output=True, text=True,
                         cwd=tmp_path)
    assert (ran.returncode, ran.stdout) == (2, "")
    assert words in ran.stderr


def test_missing_rocketpy_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "rocketpy.py").write_text("raise ModuleNotFoundError(name='rocketpy')\n")
    ran = subprocess.run([sys.executable, str(fly.__file__)], capture_output=True, text=True,
                         env={**os.environ, "PYTHONPATH": os.pathsep.join((str(tmp_path), *sys.path))})
    assert ran.returncode == 2
    assert ran.stderr == ("error: the flight needs the Python package rocketpy, which is not installed: "
                          "pip install 'emcas-fmu[rocketpy,native]'\n")
