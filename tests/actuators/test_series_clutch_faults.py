"""Faults of the series clutch actuator."""

from __future__ import annotations

from collections.abc import Mapping
from math import radians
from typing import Any

import numpy as np
import pytest

from emcas_fmu.actuators import get
from emcas_fmu.parameters import load_parameters
from tests.simulation import simulate

MODEL = "series-clutch+faults"
_SLIPPING = {"jam", "powder_loss", "coil_open", "coil_short"}


def _faulty(fault: str, **inputs: Any) -> tuple[Mapping[str, Any], Mapping[str, Any]]:
    """Values and a run with a fault from 0.2 s on."""
    values = {**load_parameters(model=MODEL).values, f"fault.{fault}.begin": 0.2, f"fault.{fault}.end": 9.0}
    return values, simulate(values, 0.8, model=MODEL, **inputs)


@pytest.mark.parametrize("fault", [fault.name for fault in get(MODEL).faults])
def test_what_a_fault_does_to_a_slew_against_a_load(fault: str) -> None:
    """Against 320 N.m, of the 395 of stall: what takes the clutch's torque lets it slip, and the built-in test sees
    that the fin does not follow."""
    _, run = _faulty(fault, fin_command=lambda t: radians(15.0 if t > 0.18 else 0.0),
                     aero_torque=lambda t: -320.0 if t > 0.19 else 0.0)
    assert bool(run["slip_power"].any()) == (fault in _SLIPPING)
    assert bool(run["built_in_test"][-1]) == (fault in _SLIPPING)
    reached = abs(run["fin_angle"][-1] - radians(15.0)) < radians(0.2)
    assert reached == (fault not in _SLIPPING)
    assert run["supply_power"].min() >= 0.0


def test_a_jam_slips_and_makes_no_energy() -> None:
    """The rotor's motion and what the motor draws are all there is to heat the clutch."""
    values, run = _faulty("jam", fin_command=lambda t: 0.25 if t > 0.15 else 0.0)
    jammed = run["time"] > 0.201
    assert not np.ptp(run["fin_angle"][jammed])
    assert not run["screw_speed"][jammed].any()
    inertia = values["inertia.motor"] + values["clutch.driving_inertia"]
    kinetic = 0.5 * inertia * float(run["motor_speed"][jammed][0] ** 2)
    heat, drawn = (np.trapezoid(run[name][jammed], run["time"][jammed]) for name in ("slip_power", "supply_power"))
    assert 0.0 < heat < drawn + kinetic


def test_without_its_no_back_a_load_moves_the_disabled_fin() -> None:
    values, run = _faulty("clutch_engaged", enable=False, aero_torque=100.0)
    assert not run["fin_angle"][run["time"] < 0.2].any()
    assert run["at_stop"][-1]
    assert values["fault.clutch_engaged.share"] > 0.0
