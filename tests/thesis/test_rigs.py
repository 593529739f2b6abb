"""The two rigs: friction equals their readings, and the load is the commanded one."""

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
    """The polynomial of the parameter file, written out."""
    return sum(values[f"friction.coulomb.{direction}[{n}]"] * (np.degrees(fin) / 20.0) ** n for n in range(7))


@cache
def runs() -> Runs:
    return Runs()


@pytest.mark.parametrize("direction", [-1, *slow(1)])
def test_slow_sweeps_read_coulomb_friction_at_both_temperatures(direction: int) -> None:
    values, name = runs().values, friction.DIRECTIONS[direction]
    # The second point of the table is that of the cold measurement.
    assert values["friction.table.temperature[1]"] == COLD
    for temperature, viscous, dry in ((WARM, 1.0, 1.0), (COLD, values["friction.table.viscous[1]"],
                                                         values["friction.table.coulomb[1]"])):
        sweep = runs().friction(25, temperature)
        fin = sweep.fin_angle[sweep.steady[direction]]
        expected = (dry * coulomb(values, name, fin)
                    + viscous * values[f"friction.viscous.{name}"] * 25.0 * 2.0 * np.pi / 60.0)
        # Within a tenth of a per cent: the rig's torque is held for half a millisecond, and its integral follows the
        # slope of the friction with its 10 ms. Largest distance measured: 0.07 mN.m.
        assert np.max(np.abs(sweep.friction(direction) - expected)) < 2e-4
        assert np.ptp(degrees(1.0) * fin) > 36.0


@pytest.mark.slow
@pytest.mark.parametrize("deviations", [
    {"deviation.kinematics.moment_arm": 0.05},
    {"deviation.screw.lead": -0.04, "deviation.kinematics.initial_angle": radians(3.0)}])
def test_the_lever_as_built_changes_no_reading_at_the_screw(deviations: Mapping[str, float]) -> None:
    """Friction is the screw's, and the rig is on it, with any lever behind."""
    values = load_parameters().with_values(deviations).values
    sweep = friction_rig.sweep(values, 25, WARM)
    fin = sweep.fin_angle[sweep.steady[1]]
    expected = coulomb(values, "positive", fin) + values["friction.viscous.positive"] * 25.0 * 2.0 * np.pi / 60.0
    # As above.
    assert np.max(np.abs(sweep.friction(1) - expected)) < 2e-4
    assert np.ptp(degrees(1.0) * fin) > 36.0


def test_the_mean_slope_over_speed_is_the_mean_viscous_coefficient() -> None:
    rows = friction.viscous_fit(runs()).table
    assert rows is not None
    rig, parameter = (np.array([row[i] for row in rows.rows]) for i in (1, 2))
    # Each slope is tilted by what the lever takes to accelerate the fin at constant motor speed, J R'/R^4 w^2, with
    # opposite signs along the two directions: the mean is free of it but for friction's slope over the window.
    assert np.mean(rig) == pytest.approx(np.mean(parameter), rel=3e-3)
    np.testing.assert_allclose(rig, parameter, rtol=0.03)


def test_that_tilt_is_the_one_of_the_equation_of_motion() -> None:
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
    # 6 mN.m of it at 10 deg; what is left of the ramp's settling is below 0.3 mN.m in the middle of the travel.
    assert np.max(helping[middle]) > 2e-3
    assert np.max(np.abs(sweep.friction(1)[middle] - expected[middle])) < 3e-4


def test_the_rig_drives_a_unit_whose_drive_is_off() -> None:
    values = load_parameters().values
    without_motor = {**values, "motor.torque_constant": 1e-3, "motor.back_emf_constant": 1e-3}
    one, other = (friction_rig.sweep(v, 1000, WARM) for v in (values, without_motor))
    np.testing.assert_array_equal(one.current, other.current)


def test_the_fitted_polynomials_are_the_parameters() -> None:
    values, fin = runs().values, np.radians(np.linspace(-18.0, 18.0, 37))
    for direction, name in friction.DIRECTIONS.items():
        fitted = np.polynomial.polynomial.polyval(np.degrees(fin) / 20.0, friction.polynomial(runs(), direction))
        # The viscous part is taken off by the tilted line: 2.6 rad/s times a slope off by 2 %, 0.03 mN.m.
        assert np.max(np.abs(fitted - coulomb(values, name, fin))) < 1e-4


def held(seconds: float, moment: float) -> Excitation:
    time = np.arange(round(seconds * 1e3) + 1) * 1e-3
    return Excitation("held", {COMMAND: 0.0 * time, LOAD: moment * np.clip(time / 0.02, 0.0, 1.0)})


def test_the_loading_rig_applies_what_is_asked_for() -> None:
    for moment in (-100.0, 40.0):
        run = loading_rig.run(runs().values, held(0.6, moment))
        # The torque loop's integral leaves nothing but a limit cycle of the encoder's counts.
        assert run.applied[-1] == pytest.approx(moment, abs=0.2)
        assert np.max(np.abs(run.applied)) < 1.5 * abs(moment)


def test_it_applies_no_more_than_its_motor_can() -> None:
    rig = rig_values("loading")
    largest = rig.current_gain * rig.reference_limit * rig.torque_constant * rig.ratio
    run = loading_rig.run(runs().values, held(0.6, 2.0 * largest))
    # Less its dry friction, which may help to hold; a thousandth for the fin that still gives.
    assert largest - rig.coulomb <= run.applied[-1] <= 1.001 * (largest + rig.coulomb)


def test_a_load_that_follows_leaves_the_loaded_test_as_it_is_under_the_very_moment() -> None:
    loaded, ideal = runs().loaded, runs().ideal.columns
    assert len(loaded.columns["time"]) == len(ideal["time"])
    time = ideal["time"]
    settled = np.zeros(len(time), dtype=bool)
    for end in (*SLEWS, time[-1]):
        settled |= (time > end - 0.1) & (time < end)
    # At rest both hold; the encoder's counts and what the integral still carries make less than half the accuracy.
    assert np.max(np.abs(loaded.columns["fin_angle"] - ideal["fin_angle"])[settled]) < radians(0.1)
    moving = (time > SLEWS[0]) & (time < SLEWS[0] + 0.1)
    missed = np.abs(loaded.applied - loaded.requested)
    assert np.max(missed[moving]) > 10.0 * np.max(missed[settled])


@pytest.mark.parametrize(("section", "standing"), [
    ('[fin]\nstart_angle = "5 deg"', 0.0), ('[drive]\ncurrent_offset = "4 A"', 0.044)])
def test_what_a_load_moves_is_counted_from_where_the_fin_stood(tmp_path: Path, section: str, standing: float) -> None:
    """Figure 5.17: wherever a run starts by the set, and beside 0 because friction holds it there."""
    file = tmp_path / "set.toml"
    file.write_text(section, encoding="utf-8")
    shown = loading.torque_loop(Runs([file]))
    assert shown.figure is not None
    assert shown.table is not None
    fin = np.asarray(shown.figure.axes[1].lines[0].get_ydata(), dtype=float)
    assert fin[0] == 0.0
    assert fin[49] == pytest.approx(standing, abs=1e-3)
    assert shown.table.rows[-1][1] == pytest.approx(np.max(np.abs(fin - fin[49])), abs=1e-9)
    assert 0.4 < shown.table.rows[-1][1] < 0.8


def test_every_number_of_the_rigs_is_an_estimate_with_a_reason() -> None:
    for rig in ("friction_motor", "loading"):
        for name, entry in rig_entries(rig).items():
            assert entry.source == "estimate", name
            assert len(entry.note) > 15, name
