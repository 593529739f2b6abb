"""The two simulated rigs: one reads the friction of the parameters, the other applies the commanded load."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from math import degrees, radians
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from docs.thesis import friction, friction_rig, loading, loading_rig
from docs.thesis.rigs import rig_entries, rig_values
from docs.thesis.runs import COLD, SLEWS, WARM, Runs
from emcas_fmu.bench.excitation import COMMAND, LOAD, Excitation
from emcas_fmu.parameters import load_parameters
from tests.marks import slow


def coulomb(values: Mapping[str, Any], direction: str, fin: Any) -> Any:
    """Return the Coulomb friction [N.m] at the motor by the polynomial of the parameter file."""
    return sum(values[f"friction.coulomb.{direction}[{n}]"] * (np.degrees(fin) / 20.0) ** n for n in range(7))


@cache
def runs() -> Runs:
    return Runs()


@pytest.mark.parametrize("direction", [-1, *slow(1)])
def test_slow_sweeps_measure_coulomb_friction_at_both_temperatures(direction: int) -> None:
    values, name = runs().values, friction.DIRECTIONS[direction]
    # The second point of the table is the cold measurement.
    assert values["friction.table.temperature[1]"] == COLD
    for temperature, viscous, dry in ((WARM, 1.0, 1.0), (COLD, values["friction.table.viscous[1]"],
                                                         values["friction.table.coulomb[1]"])):
        sweep = runs().friction(25, temperature)
        fin = sweep.fin_angle[sweep.steady[direction]]
        expected = (dry * coulomb(values, name, fin)
                    + viscous * values[f"friction.viscous.{name}"] * 25.0 * 2.0 * np.pi / 60.0)
        # The rig's torque is constant for 0.5 ms, and its integral follows the friction within 10 ms: measured
        # 0.07 mN.m at most.
        assert np.max(np.abs(sweep.friction(direction) - expected)) < 2e-4
        assert np.ptp(degrees(1.0) * fin) > 36.0


@pytest.mark.slow
@pytest.mark.parametrize("deviations", [
    {"deviation.kinematics.moment_arm": 0.05},
    {"deviation.screw.lead": -0.04, "deviation.kinematics.initial_angle": radians(3.0)}])
def test_deviations_of_the_lever_do_not_change_the_friction_at_the_screw(deviations: Mapping[str, float]) -> None:
    """The rig drives the screw, in front of the lever."""
    values = load_parameters().with_values(deviations).values
    sweep = friction_rig.sweep(values, 25, WARM)
    fin = sweep.fin_angle[sweep.steady[1]]
    expected = coulomb(values, "positive", fin) + values["friction.viscous.positive"] * 25.0 * 2.0 * np.pi / 60.0
    # Tolerance as above.
    assert np.max(np.abs(sweep.friction(1) - expected)) < 2e-4
    assert np.ptp(degrees(1.0) * fin) > 36.0


def test_mean_slope_over_speed_is_the_mean_viscous_coefficient() -> None:
    rows = friction.viscous_fit(runs()).table
    assert rows is not None
    rig, parameter = (np.array([row[i] for row in rows.rows]) for i in (1, 2))
    # At constant motor speed the lever accelerates the fin with the torque J R'/R^4 w^2, whose sign depends on the
    # direction: it cancels in the mean, except for the slope of friction in the window.
    assert np.mean(rig) == pytest.approx(np.mean(parameter), rel=3e-3)
    np.testing.assert_allclose(rig, parameter, rtol=0.03)


def test_torque_of_the_accelerated_fin_agrees_with_the_equation_of_motion() -> None:
    p = runs().parameters.nested()
    sweep = runs().friction(2000, WARM)
    rows = sweep.steady[1]
    fin, speed = sweep.fin_angle[rows], sweep.motor_speed[rows]
    phi = fin + p.kinematics.initial_angle
    ratio = p.kinematics.moment_arm / p.screw.lead / np.cos(phi) ** 2
    inertia = p.inertia.fin + p.inertia.shaft + p.inertia.fork
    helping = inertia * 2.0 * ratio * np.tan(phi) / ratio**4 * speed**2
    expected = coulomb(runs().values, "positive", fin) + p.friction.viscous.positive * speed - helping
    middle = slice(len(fin) // 4, -len(fin) // 4)
    # 6 mN.m at 10 deg. The transient of the ramp is below 0.3 mN.m in the middle of the travel.
    assert np.max(helping[middle]) > 2e-3
    assert np.max(np.abs(sweep.friction(1)[middle] - expected[middle])) < 3e-4


def test_friction_rig_works_with_the_actuators_drive_off() -> None:
    values = load_parameters().values
    without_motor = {**values, "motor.torque_constant": 1e-3, "motor.back_emf_constant": 1e-3}
    one, other = (friction_rig.sweep(v, 1000, WARM) for v in (values, without_motor))
    np.testing.assert_array_equal(one.current, other.current)


def test_fitted_polynomials_equal_the_parameters() -> None:
    values, fin = runs().values, np.radians(np.linspace(-18.0, 18.0, 37))
    for direction, name in friction.DIRECTIONS.items():
        fitted = np.polynomial.polynomial.polyval(np.degrees(fin) / 20.0, friction.polynomial(runs(), direction))
        # The viscous part is subtracted with a slope that is off by 2 %: 0.03 mN.m at 2.6 rad/s.
        assert np.max(np.abs(fitted - coulomb(values, name, fin))) < 1e-4


def constant_load(seconds: float, moment: float) -> Excitation:
    """Return an excitation with a load [N.m] that rises within 20 ms and remains constant."""
    time = np.arange(round(seconds * 1e3) + 1) * 1e-3
    return Excitation("load", {COMMAND: 0.0 * time, LOAD: moment * np.clip(time / 0.02, 0.0, 1.0)})


def test_loading_rig_applies_the_commanded_load() -> None:
    for moment in (-100.0, 40.0):
        run = loading_rig.run(runs().values, constant_load(0.6, moment))
        # The torque loop's integral leaves only a limit cycle of the encoder's counts.
        assert run.applied[-1] == pytest.approx(moment, abs=0.2)
        assert np.max(np.abs(run.applied)) < 1.5 * abs(moment)


def test_load_of_the_rig_is_limited_by_its_motor() -> None:
    rig = rig_values("loading")
    largest = rig.current_gain * rig.reference_limit * rig.torque_constant * rig.ratio
    run = loading_rig.run(runs().values, constant_load(0.6, 2.0 * largest))
    # Dry friction may act in either direction; a thousandth is for the fin, which still moves.
    assert largest - rig.coulomb <= run.applied[-1] <= 1.001 * (largest + rig.coulomb)


def test_fin_at_rest_under_the_rigs_load_agrees_with_the_ideal_load() -> None:
    loaded, ideal = runs().loaded, runs().ideal.columns
    assert len(loaded.columns["time"]) == len(ideal["time"])
    time = ideal["time"]
    settled = np.zeros(len(time), dtype=bool)
    for end in (*SLEWS, time[-1]):
        settled |= (time > end - 0.1) & (time < end)
    # The encoder's counts and the rest of the integral are less than half the accuracy.
    assert np.max(np.abs(loaded.columns["fin_angle"] - ideal["fin_angle"])[settled]) < radians(0.1)
    moving = (time > SLEWS[0]) & (time < SLEWS[0] + 0.1)
    missed = np.abs(loaded.applied - loaded.requested)
    assert np.max(missed[moving]) > 10.0 * np.max(missed[settled])


@pytest.mark.parametrize(("section", "start"), [
    ('[fin]\nstart_angle = "5 deg"', 0.0), ('[drive]\ncurrent_offset = "4 A"', 0.044)])
def test_deflection_by_a_load_is_relative_to_the_angle_before_the_load(
        tmp_path: Path, section: str, start: float) -> None:
    """Figure 5.17: the fin may start at an angle of the set, or not return to 0 because of friction."""
    file = tmp_path / "set.toml"
    file.write_text(section, encoding="utf-8")
    shown = loading.torque_loop(Runs([file]))
    assert shown.figure is not None
    assert shown.table is not None
    fin = np.asarray(shown.figure.axes[1].lines[0].get_ydata(), dtype=float)
    assert fin[0] == 0.0
    assert fin[49] == pytest.approx(start, abs=1e-3)
    assert shown.table.rows[-1][1] == pytest.approx(np.max(np.abs(fin - fin[49])), abs=1e-9)
    assert 0.4 < shown.table.rows[-1][1] < 0.8


def test_every_number_of_the_rigs_is_an_estimate_with_a_note() -> None:
    for rig in ("friction_motor", "loading"):
        for name, entry in rig_entries(rig).items():
            assert entry.source == "estimate", name
            assert len(entry.note) > 15, name
