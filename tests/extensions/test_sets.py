"""The named parameter sets for an extension or the elastic model: the effect of each."""

from __future__ import annotations

from math import pi, radians, sqrt

import numpy as np
import pytest

from emcas_fmu.parameters import ParameterSet, load_parameters
from emcas_fmu.simulation import simulate
from emcas_fmu.studies.analysis.envelope import envelope
from emcas_fmu.support.files import models_directory

SETS = models_directory() / "sets"


def loaded(name: str, model: str) -> ParameterSet:
    """Return a model's default set changed by a named one, whose entries are all used and have a source and a note."""
    file = SETS / f"{name}.toml"
    parameters = load_parameters(file, model=model)
    assert not parameters.unused
    entries = [entry for entry in parameters.entries if entry.file == file.name]
    assert entries
    assert all(entry.source and entry.note for entry in entries)
    return parameters


def test_a_screw_of_95_percent_loses_a_nineteenth_of_its_output_power() -> None:
    model = "nonlinear+efficiency"
    parameters = loaded("screw-efficiency-095", model)
    assert parameters.values["efficiency.backward"] == pytest.approx(2.0 - 1.0 / 0.95, abs=1e-4)
    # In a ramp against a load, without friction of the fin, the power into the fin is aero_torque times rate.
    run = simulate(parameters.with_values({"friction.fin_coulomb": 0.0, "friction.fin_viscous": 0.0}).values, 0.4,
                   model=model, fin_command=lambda t: radians(50.0) * t, aero_torque=-60.0)
    late = run["time"] > 0.2
    output_power = 60.0 * run["fin_rate"][late].mean()
    # A ripple of the rate, which accelerates nut and fin, remains.
    assert run["screw_loss"][late].mean() / output_power == pytest.approx(1.0 / 0.95 - 1.0, rel=0.01)


def test_the_published_motor_has_a_fifth_of_the_shipped_continuous_torque() -> None:
    """At standstill I^2 R(155 degC) (R_wc + R_ca) = 155 - 24 K; the magnets in the case are at 142 degC."""
    model = "nonlinear+heat"
    published, shipped = loaded("heat-published-motor", model), load_parameters(model=model)
    values = published.values
    # The time constants of the file, and those of the shipped set.
    assert values["heat.winding_capacity"] * values["heat.winding_to_case"] == pytest.approx(90.0141, rel=1e-4)
    assert values["heat.case_capacity"] * values["heat.case_to_ambient"] == pytest.approx(3781.17, rel=1e-4)
    no_i2t = {"heat.continuous_current": 60.0}
    continuous, shipped_continuous = (envelope(p.with_values(no_i2t), 10.0).continuous for p in (published, shipped))
    loss = (155.0 - 24.0) / (1.6372 + 15.2925)
    current = sqrt(loss / (0.25 * (1.0 + 0.00387 * 131.0)))
    torque = 0.11 * current * (1.0 - 0.0011 * 15.2925 * loss)
    assert (continuous.current, continuous.torque[0]) == pytest.approx((current, torque), rel=1e-9)
    assert current == pytest.approx(4.53, abs=0.01)
    assert continuous.torque[0] / shipped_continuous.torque[0] == pytest.approx(0.19, abs=0.01)


def test_a_hinge_of_15_kilonewton_metres_per_radian_twists_under_a_load() -> None:
    parameters = loaded("hinge-stiffness", "elastic")
    shaft = 80e9 * pi * 0.025**4 / (32.0 * 0.1)
    assert parameters.values["drive_line.shaft_stiffness"] == pytest.approx(shaft, rel=2e-3)
    stiffness = 1.0 / (2.0 / 60e3 + 1.0 / 30.7e3)
    assert parameters.values["drive_line.hinge_damping"] == pytest.approx(0.04 * sqrt(stiffness * 0.06), rel=0.01)
    blocked = {"friction.coulomb.positive[0]": 9.0, "friction.coulomb.negative[0]": 9.0, "drive_line.backlash": 0.0,
            "friction.fin_viscous": 50.0, "friction.fin_coulomb": 0.0}
    stiff, soft = (simulate(p.with_values(blocked).values, 0.4, model="elastic", enable=False, aero_torque=50.0)
                   for p in (load_parameters(model="elastic"), parameters))
    twist = soft["fin_angle"][-1] - stiff["fin_angle"][-1]
    assert twist == pytest.approx(50.0 / stiffness, rel=3e-3)
    assert np.degrees(twist) == pytest.approx(0.19, abs=0.01)
