"""The electrohydraulic actuator's own faults, each against the sound actuator with the parameters that it changes."""

from __future__ import annotations

from math import radians
from typing import Any

import numpy as np
import pytest

from emcas_fmu.parameters import load_parameters
from emcas_fmu.simulation import simulate

MODEL = "electrohydraulic"
FAULTY = dict(load_parameters(model=f"{MODEL}+faults").values)
PLAIN = dict(load_parameters(model=MODEL).values)
# The changed parameters of each fault, with its shipped amounts.
CHANGES: dict[str, dict[str, float]] = {
    "hard_over": {"valve.null_shift": 2.0},
    "silting": {"valve.null_shift": FAULTY["fault.silting.shift"], "valve.lap": FAULTY["fault.silting.lap"]},
    "internal_leakage": {"cylinder.internal_leakage": FAULTY["fault.internal_leakage.factor"]
                         * PLAIN["cylinder.internal_leakage"]},
    "air": {"oil.bulk_modulus": FAULTY["fault.air.share"] * PLAIN["oil.bulk_modulus"]},
}


def run(model: str, values: dict[str, Any]) -> dict[str, Any]:
    return simulate(values, 0.3, model=model, fin_command=lambda t: radians(8.0) * np.sin(30.0 * t),
                    aero_torque=lambda t: 60.0 * np.sin(50.0 * t))


@pytest.mark.parametrize("fault", CHANGES)
def test_fault_equals_changed_parameters_to_the_bit(fault: str) -> None:
    found = run(f"{MODEL}+faults", {**FAULTY, f"fault.{fault}.active": True})
    expected, sound = run(MODEL, {**PLAIN, **CHANGES[fault]}), run(MODEL, PLAIN)
    for name, column in expected.items():
        # The fault begins with the first sample, after the first row.
        np.testing.assert_array_equal(found[name][1:], column[1:], err_msg=name)
    assert np.abs(found["pressure_1"] - sound["pressure_1"]).max() > 1e4


def test_brown_out_to_no_pressure_releases_the_fin() -> None:
    """The general fault brown_out acts on a pressure line as well."""
    values = {**FAULTY, "fault.brown_out.share": 0.0, "fault.brown_out.begin": 0.1, "fault.brown_out.end": 9.0}
    found = simulate(values, 0.5, model=f"{MODEL}+faults", fin_command=radians(5.0), aero_torque=-100.0)
    assert found["fin_angle"][-1] < -radians(5.0) < 0.0 < found["fin_angle"][100]


def test_hard_over_trips_the_built_in_test() -> None:
    values = {**FAULTY, "fault.hard_over.begin": 0.1, "fault.hard_over.end": 9.0}
    found = simulate(values, 1.0, model=f"{MODEL}+faults")
    assert found["at_stop"][-1]
    assert found["built_in_test"][-1]
    assert not found["built_in_test"][90]
