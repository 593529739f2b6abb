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
    """Return the values and a run with a fault that begins at 0.2 s."""
    values = {**load_parameters(model=MODEL).values, f"fault.{fault}.begin": 0.2, f"fault.{fault}.end": 9.0}
    return values, simulate(values, 0.8, model=MODEL, **inputs)


@pytest.mark.parametrize("fault", [fault.name for fault in get(MODEL).faults])
def test_faults_that_overload_the_clutch_make_it_slip_and_trip_the_built_in_test(fault: str) -> None:
    """In a slew against 320 N.m, with a stall torque of 395 N.m, the fin follows only with the other faults."""
    _, run = _faulty(fault, fin_command=lambda t: radians(15.0 if t > 0.18 else 0.0),
                     aero_torque=lambda t: -320.0 if t > 0.19 else 0.0)
    assert bool(run["slip_power"].any()) == (fault in _SLIPPING)
    assert bool(run["built_in_test"][-1]) == (fault in _SLIPPING)
    reached = abs(run["fin_angle"][-1] - radians(15.0)) < radians(0.2)
    assert reached == (fault not in _SLIPPING)
    assert run["supply_power"].min() >= 0.0


def test_jam_makes_the_clutch_slip_and_creates_no_energy() -> None:
    """The heat of slip comes from the supply and the rotor's kinetic energy."""
    values, run = _faulty("jam", fin_command=lambda t: 0.25 if t > 0.15 else 0.0)
    jammed = run["time"] > 0.201
    assert not np.ptp(run["fin_angle"][jammed])
    assert not run["screw_speed"][jammed].any()
    inertia = values["inertia.motor"] + values["clutch.driving_inertia"]
    kinetic = 0.5 * inertia * float(run["motor_speed"][jammed][0] ** 2)
    heat, supplied = (np.trapezoid(run[name][jammed], run["time"][jammed]) for name in ("slip_power", "supply_power"))
    assert 0.0 < heat < supplied + kinetic


def test_a_load_moves_the_disabled_fin_without_the_no_back() -> None:
    values, run = _faulty("clutch_engaged", enable=False, aero_torque=100.0)
    assert not run["fin_angle"][run["time"] < 0.2].any()
    assert run["at_stop"][-1]
    assert values["fault.clutch_engaged.share"] > 0.0
