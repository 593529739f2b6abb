"""Stribeck friction and screw losses together, against an independent integration by events."""

from __future__ import annotations

from collections.abc import Mapping
from math import sin
from typing import Any

import numpy as np
import pytest

from emcas_fmu.simulation import simulate
from tests.marks import slow

from .screw_reference import IDEAL, motion
from .screw_values import SCREW_STRETCHES, efficiencies, values_of

OVERRIDES: Mapping[str, Any] = {
    **IDEAL, "stribeck.static_ratio": 2.0, "stribeck.speed": 3.0, **efficiencies(0.7, 0.4),
    "friction.fin_coulomb": 3.0, "friction.fin_viscous": 2.0, "friction.temperature": -6.0}


def _command(t: float) -> float:
    return 0.02 * sin(40.0 * t)


@pytest.mark.parametrize(("model", "overrides", "largest"), [
    ("nonlinear", {}, 2e-6), *slow(("elastic", {**SCREW_STRETCHES, "mass.nut": 200.0}, 1e-4),
                                   ("elastic", SCREW_STRETCHES, 1e-4))])
def test_independent_integration_agrees(model: str, overrides: Mapping[str, Any], largest: float) -> None:
    """To second order and with rest at the same samples, in the cold under a constant load.

    A nut of 200 kg reverses the load on the screw.
    """
    name = f"{model}+stribeck+efficiency"
    v = values_of(OVERRIDES, overrides, model=name)
    exact, speed = motion(v, 0.2, _command, -20.0, model == "elastic")

    def run(changes: Mapping[str, Any]) -> Mapping[str, Any]:
        return simulate({**v, **changes}, 0.2, model=name, fin_command=_command, aero_torque=-20.0)

    def error(changes: Mapping[str, Any]) -> float:
        return float(np.degrees(np.abs(run(changes)["fin_angle"] - exact).max()))

    assert 10 < int(np.sum(speed == 0.0)) < 60
    assert np.array_equal(run({"solver.max_tick": 1e-4})["motor_speed"] == 0.0, speed == 0.0)
    errors = [error({"solver.max_tick": tick}) for tick in (1e-4, 5e-5, 2.5e-5)]
    assert errors[0] < largest  # 1.0e-6, 4.3e-5 and 4.1e-5 deg
    assert errors[0] / errors[-1] == pytest.approx(16.0, rel=0.15)  # second order, through events
    # Friction and losses each have an effect.
    assert min(error({"stribeck.static_ratio": 1.0}), error(efficiencies(1.0, 1.0))) > 0.01  # deg
