"""The series clutch actuator against an independent integration."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pytest

from emcas_fmu.parameters import load_parameters
from emcas_fmu.reference import series_clutch as reference
from tests.marks import slow
from tests.simulation import simulate

from .checks import convergence_order
from .hammers import random_inputs

MODEL = "series-clutch"
TICKS = (8e-4, 4e-4, 2e-4, 1e-4, 5e-5)


@pytest.mark.parametrize(("seeds", "changes"), [
    ((1,), {"clutch.rated_torque": 4.0, "efficiency.backward": 0.5, "friction.fin_coulomb": 2.0}),
    *slow((range(6), {}), ((3,), {"clutch.rated_torque": 3.0, "clutch.temperature_coefficient": -0.02}),
          ((2,), {"efficiency.backward": -0.5, "clutch.residual": 0.1}))])
def test_second_order_convergence_to_the_independent_integration(seeds: Sequence[int],
                                                                 changes: dict[str, float]) -> None:
    values = {**load_parameters(model=MODEL).values, "encoder.enabled": False, **changes}
    errors = np.array([_errors(values, seed) for seed in seeds])
    assert errors[:, 2].max() < 0.002, errors  # the default tick
    # The order is that of the geometric mean over histories: with one history the positions of events within ticks
    # shift the fit of five points by 0.2.
    assert 1.6 < convergence_order(TICKS, np.exp(np.log(errors).mean(axis=0)).tolist()) < 2.8, errors


def _errors(values: Mapping[str, Any], seed: int, rows: int = 200) -> list[float]:
    """Return the largest error of the fin angle [deg] with each tick, under random inputs."""
    inputs, errors = random_inputs(seed, rows), []
    exact = reference.simulate(values, {"time": np.arange(rows + 1) * 1e-3, **inputs})
    for tick in TICKS:
        run = simulate({**values, "solver.max_tick": tick}, rows * 1e-3, model=MODEL, **inputs)
        errors.append(float(np.degrees(np.abs(run["fin_angle"] - exact["fin_angle"]).max())))
        assert np.abs(run["motor_speed"] - exact["motor_speed"]).max() < 2e3 * tick  # of 300 rad/s
    return errors
