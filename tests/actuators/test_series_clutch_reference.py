"""The series clutch actuator against an integration that shares no code with it."""

from __future__ import annotations

import numpy as np
import pytest

from emcas_fmu.parameters import load_parameters
from emcas_fmu.reference import series_clutch as reference
from tests.simulation import simulate

from .hammers import hammered

MODEL = "series-clutch"


@pytest.mark.parametrize(("seed", "changes"), [
    (1, {"clutch.rated_torque": 4.0, "efficiency.backward": 0.5, "friction.fin_coulomb": 2.0}),
    pytest.param(0, {}, marks=pytest.mark.slow),
    pytest.param(3, {"clutch.rated_torque": 3.0, "clutch.temperature_coefficient": -0.02}, marks=pytest.mark.slow),
    pytest.param(2, {"efficiency.backward": -0.5, "clutch.residual": 0.1}, marks=pytest.mark.slow)])
def test_it_is_an_independent_integration_to_second_order(seed: int, changes: dict[str, float]) -> None:
    rows = 200
    values = {**load_parameters(model=MODEL).values, "encoder.enabled": False, **changes}
    inputs = hammered(seed, rows)
    exact = reference.simulate(values, {"time": np.arange(rows + 1) * 1e-3, **inputs})
    ticks, errors = [8e-4, 4e-4, 2e-4, 1e-4, 5e-5], []
    for tick in ticks:
        run = simulate({**values, "solver.max_tick": tick}, rows * 1e-3, model=MODEL, **inputs)
        errors.append(np.degrees(np.abs(run["fin_angle"] - exact["fin_angle"]).max()))
        assert np.abs(run["motor_speed"] - exact["motor_speed"]).max() < 2e3 * tick  # of 300 rad/s
    assert errors[2] < 0.002, errors  # the default tick
    # Events that move between ticks shift the fit of five points.
    slope = np.polyfit(np.log(ticks), np.log(errors), 1)[0]
    assert 1.6 < slope < 2.8, (slope, errors)
