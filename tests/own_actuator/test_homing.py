"""Homing of a user's actuator with its own equations and controllers: motor and encoder on a strain-wave gear."""

from __future__ import annotations

from math import radians
from pathlib import Path

import numpy as np
import pytest

from emcas_fmu.extensions.status import FAILED, OPERATIONAL
from emcas_fmu.parameters import load_parameters
from emcas_fmu.simulation import simulate

MODEL = str(Path(__file__).with_name("geared.py"))
START = radians(5.0)


@pytest.mark.parametrize("kernel", ["compiled", "python"])
@pytest.mark.parametrize("encoder", [True, False])
def test_homing_finds_both_stops_and_zero(kernel: str, encoder: bool) -> None:
    """The fin starts at an unknown angle of 5 deg; after homing it follows a command of 3 deg."""
    model = f"{MODEL}+homing"
    values = load_parameters(model=model).with_values(
        {"fin.start_angle": START, "homing.required": True, "encoder.enabled": encoder}).values
    run = simulate(values, 7.5, 0.01, model=model, kernel=kernel, home=lambda t: t > 0.01,
                   fin_command=lambda t: radians(3.0) if t > 6.0 else 0.0)
    angle, stop = run["fin_angle"], values["fin.stop_angle"]
    assert not run["homed"][0]
    assert run["homed"][-1]
    assert run["status"][-1] == OPERATIONAL
    assert np.max(angle) == pytest.approx(stop, rel=1e-9)
    assert np.min(angle) == pytest.approx(-stop, rel=1e-9)
    count = 2.0 * np.pi / (values["encoder.pulses"] * values["encoder.multiplier"] * values["gear.ratio"])
    # An error of a count at each stop, and 0.01 deg for integral action that still settles after 1.5 s (0.002 deg).
    assert angle[-1] == pytest.approx(radians(3.0), abs=2.0 * count + radians(0.01))
    assert run["measured_fin_angle"][-1] == pytest.approx(angle[-1], abs=2.0 * count)


def test_homing_fails_at_an_obstacle() -> None:
    model = f"{MODEL}+homing+faults"
    values = load_parameters(model=model).with_values(
        {"fin.start_angle": START, "homing.required": True, "fault.jam.begin": 2.0, "fault.jam.end": 9.0}).values
    run = simulate(values, 4.0, 0.01, model=model, kernel="python", home=lambda t: t > 0.01)
    assert not run["homed"][-1]
    assert run["status"][-1] == FAILED
