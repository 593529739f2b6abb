"""Properties that only the actuators after Habibi and Ozkan have."""

from __future__ import annotations

from math import radians

import numpy as np
import pytest

from emcas_fmu.parameters import load_parameters
from emcas_fmu.simulation import simulate


def test_habibi_has_the_same_gap_at_every_angle() -> None:
    """The ratio is constant: loads below the motor's friction move the fin equally far at 0 and at 15 deg."""
    plays = []
    for start in (0.0, 15.0):
        values = load_parameters(model="habibi").with_values({
            "fin.start_angle": radians(start), "friction.fin_viscous": 50.0, "friction.fin_coulomb": 0.0}).values
        run = simulate(values, 1.0, model="habibi", enable=False, aero_torque=lambda t: 2.0 if t < 0.5 else -2.0)
        plays.append(run["fin_angle"][499] - run["fin_angle"][999])
    deflection = 4.0 / (0.05**2 * values["drive_line.contact_stiffness"])
    assert plays[0] == pytest.approx(plays[1], rel=1e-9)
    # The impact moves the rotor by less than 1 % of the gap.
    assert plays[0] == pytest.approx(5e-5 / 0.05 + deflection, rel=0.01)


def test_ozkan_current_follows_the_delayed_reference_with_any_supply() -> None:
    values = load_parameters(model="ozkan").values
    run, weak = (simulate(values, 0.3, model="ozkan", fin_command=0.1, supply_voltage=v) for v in (39.0, 1.0))
    for name in ("fin_angle", "motor_current"):
        assert np.array_equal(run[name], weak[name])
    delayed = np.interp(run["time"] - values["drive.transport_delay"], run["time"], run["time"])
    reference = run["drive_reference"][np.clip(np.ceil(delayed * 1e3 - 1e-9).astype(int), 0, None)]
    expected = np.clip(values["drive.current_gain"] * reference + values["drive.current_offset"], -60.0, 60.0)
    assert run["motor_current"][10:] == pytest.approx(expected[10:], abs=1e-9)


@pytest.mark.parametrize("compliance", [0.0, 1.71e-3])
def test_ozkan_shaft_twists_under_load(compliance: float) -> None:
    """The twist is the compliance, at least 1e-6 rad/(N.m), times the load at the motor; the ratio is constant."""
    parameters = load_parameters(model="ozkan").with_values({"drive_line.torsional_compliance": compliance})
    run = simulate(parameters.values, 1.0, model="ozkan", aero_torque=-60.0)
    ratio = parameters.values["kinematics.moment_arm"] / parameters.values["screw.lead"]
    twist = run["motor_angle"][-1] - ratio * run["fin_angle"][-1]
    assert twist == pytest.approx(max(compliance, 1e-6) * 60.0 / ratio, rel=1e-3)  # after 1 s it still moves
