"""Homing over an actuator with equations and controllers of its own: motor and encoder on a strain-wave gear."""

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
def test_it_finds_both_stops_and_zero(kernel: str, encoder: bool) -> None:
    """From 5 deg, taken for 0, to both stops and to zero, then 3 deg as commanded."""
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
    # A count of the encoder at each stop; 0.002 deg are the integral's rest after a second and a half.
    assert angle[-1] == pytest.approx(radians(3.0), abs=2.0 * count + radians(0.01))
    assert run["measured_fin_angle"][-1] == pytest.approx(angle[-1], abs=2.0 * count)


def test_an_obstacle_is_no_stop() -> None:
    model = f"{MODEL}+homing+faults"
    values = load_parameters(model=model).with_values(
        {"fin.start_angle": START, "homing.required": True, "fault.jam.begin": 2.0, "fault.jam.end": 9.0}).values
    run = simulate(values, 4.0, 0.01, model=model, kernel="python", home=lambda t: t > 0.01)
    assert not run["homed"][-1]
    assert run["status"][-1] == FAILED
