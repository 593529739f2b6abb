"""Torque-speed envelopes: against closed forms, against the simulation, and the command."""

from __future__ import annotations

import csv
import json
import re
from collections.abc import Mapping
from dataclasses import replace
from math import exp, pi, sqrt
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.linalg import expm
from typer.testing import CliRunner, Result

from emcas_fmu.bench.conditions import ESTIMATE
from emcas_fmu.cli import app
from emcas_fmu.errors import EmcasError
from emcas_fmu.parameters import ParameterSet, load_parameters
from emcas_fmu.simulation import simulate
from emcas_fmu.studies.analysis.envelope import Curve, draw, envelope, settled, short_term_current, warmed

from .held import HELD, MODEL

BASE = load_parameters(model=MODEL)
NO_I2T = {"heat.continuous_current": 60.0}


def _emcas(*arguments: str) -> Result:
    return CliRunner().invoke(app, ["envelope", *arguments])


def _set(overrides: Mapping[str, Any]) -> ParameterSet:
    return BASE.with_values(overrides)


def test_continuous_at_standstill_is_the_closed_form() -> None:
    found = envelope(_set(NO_I2T), 10.0).continuous
    loss = (130.0 - 24.0) / (0.2 + 0.4)
    current = sqrt(loss / (0.25 * (1.0 + 0.00387 * 106.0)))
    case = 24.0 + 0.4 * loss
    assert found.bound_by == "heat"
    assert found.current == pytest.approx(current, rel=1e-12)
    assert (found.winding, found.case) == pytest.approx((130.0, case), rel=1e-12)
    assert found.torque[0] == pytest.approx(0.11 * (1.0 - 0.0011 * (case - 24.0)) * current, rel=1e-12)


def test_short_term_of_a_lone_winding_is_the_closed_form() -> None:
    """A case that stays at ambient and a resistance that stays leave one exponential."""
    lone = _set({**NO_I2T, "heat.case_capacity": 1e7, "heat.case_to_ambient": 1e-4, "heat.resistance_coefficient": 0.0})
    for duration in (0.5, 10.0, 200.0):
        steady = 106.0 / (1.0 - exp(-duration / (190.0 * 0.2)))
        expected = sqrt(steady / 0.2 / 0.25)
        # Of the case's rise 1e-4/0.2 is left.
        assert short_term_current(lone.nested(), duration, (24.0, 24.0)) == pytest.approx(expected, rel=5e-4)


@pytest.mark.parametrize("preload", [0.0, 0.7])
def test_the_simulated_winding_gets_there_in_the_duration(preload: float) -> None:
    found = envelope(_set(NO_I2T), 20.0, preload)
    before = _set({"heat.continuous_current": 60.0}).nested()
    share = preload**2
    # The steady state of the preload: T = T_a + 0.6 R(T) i^2, solved by hand.
    square = share * found.continuous.current**2
    rise = 0.6 * 0.25 * square / (1.0 - 0.6 * 0.25 * 0.00387 * square)
    current = short_term_current(before, 20.0, settled(before, preload * found.continuous.current))
    assert found.short_term.currents["heat"] == current
    values = _set({**HELD, "drive.kp": 1e4, **NO_I2T, "drive.current_limit": 1e3, "heat.continuous_current": 1e3,
                   "drive.current_offset": current * (1.0 + 0.25e-4), "heat.winding_start_rise": rise,
                   "heat.case_start_rise": rise * 0.4 / 0.6}).values
    run = simulate(values, 20.0, 1.0, model=MODEL)
    # The current is less than its reference by R/(R + kp), of which the rise in R, 1e-5, is left.
    assert run["winding_temperature"][-1] == pytest.approx(130.0, abs=5e-3)


@pytest.mark.parametrize(("pairs", "speed"), [(0, 218.18), (4, 154.67)])
def test_the_knee_of_a_cold_motor_at_its_peak_current(pairs: int, speed: float) -> None:
    """60 A, 0.25 ohm, 0.11 V.s/rad, 0.6 mH at 39 V: (15 + 0.11 w)^2 + (0.036 n w)^2 = 39^2, in V and rad/s."""
    cold = _set({**NO_I2T, "motor.pole_pairs": pairs, "heat.resistance_coefficient": 0.0,
                 "heat.torque_coefficient": 0.0})
    found = envelope(cold, 0.1).short_term
    assert found.bound_by == "peak"
    assert found.corner_speed == pytest.approx(speed, abs=0.01)
    e = envelope(cold, 0.1)
    # Beyond the knee the torque is below the peak's, before it is the peak's.
    assert np.all((e.short_term.torque < 0.11 * 60.0 * (1.0 - 1e-9)) == (e.speed > found.corner_speed))
    # The limit drawn beside it is the voltage's alone: the same where that binds.
    np.testing.assert_allclose(np.minimum(e.short_term.limits["voltage"], 6.6), e.short_term.torque, atol=1e-6)


def _steady(square: float) -> tuple[float, float]:
    """Steady temperatures [degC] of winding and case under i^2 [A^2]: T = T_a + 0.6 R(T) i^2, solved by hand."""
    rise = 0.6 * 0.25 * square / (1.0 - 0.6 * 0.25 * 0.00387 * square)
    return 24.0 + rise, 24.0 + rise * 0.4 / 0.6


def _resistance(winding: float) -> float:
    return 0.25 * (1.0 + 0.00387 * (winding - 24.0))


@pytest.mark.parametrize(("overrides", "least"), [({}, 20.0), ({"heat.continuous_current": 10.0}, 10.0), (
    {"drive.current_limit": 8.0}, 8.0), (NO_I2T, sqrt(106.0 / 0.6 / 0.25 / (1.0 + 0.00387 * 106.0)))])
def test_preload_is_a_share_of_the_least_continuous_current(overrides: Mapping[str, Any], least: float) -> None:
    """The voltage's curve and the speed without load are those of the temperatures it leaves."""
    found = envelope(_set(overrides), 5.0, 0.9)
    assert found.continuous.current == pytest.approx(least, rel=1e-12)
    winding, case = _steady((0.9 * least)**2)
    constant = 0.11 * (1.0 - 0.0011 * (case - 24.0))
    reached = warmed(_set(overrides).nested(), found.short_term.currents["heat"], 5.0, (winding, case))
    assert reached[0] == pytest.approx(130.0, abs=1e-6)
    # Closed forms to rounding.
    assert found.speed[-1] == pytest.approx(39.0 / constant, rel=1e-9)
    for curve, k, r in ((found.short_term, constant, _resistance(winding)), (found.continuous, 0.11, 0.25)):
        expected = np.maximum(k * (39.0 - k * found.speed) / r, 0.0)
        assert curve.limits["voltage"] == pytest.approx(expected, rel=1e-9, abs=1e-9)


def test_corner_speed_and_limits_are_those_of_the_warm_motor() -> None:
    found = envelope(BASE, 10.0).continuous
    winding, case = _steady(400.0)
    constant = 0.11 * (1.0 - 0.0011 * (case - 24.0))
    assert found.corner_speed == pytest.approx((39.0 - 20.0 * _resistance(winding)) / constant, rel=1e-9)
    assert found.limits["i2t"] == pytest.approx(20.0 * constant, rel=1e-9)
    # The peak is more than heat allows for any time: at the temperatures of what it allows.
    hottest = 0.11 * (1.0 - 0.0011 * 0.4 / 0.6 * 106.0)
    assert found.limits["peak"] == pytest.approx(60.0 * hottest, rel=1e-9)


@pytest.mark.parametrize("coefficient", [-0.005, -0.008])
def test_weak_magnets_are_given_the_current_of_the_largest_torque(coefficient: float) -> None:
    """Against all currents, by closed forms; a smaller current than the largest gives more."""
    whole = envelope(_set({**NO_I2T, "heat.torque_coefficient": coefficient}), 10.0)
    found = whole.continuous
    current = np.linspace(0.0, found.currents["heat"], 20001)
    winding, case = np.array([_steady(i**2) for i in current]).T
    constant = 0.11 * (1.0 + coefficient * (case - 24.0))
    room = (39.0 - 0.25 * (1.0 + 0.00387 * (winding - 24.0)) * current) / constant
    for i, speed in enumerate(whole.speed):
        # In steps of 1.1 mA, 2e-4 N.m.
        assert found.torque[i] == pytest.approx(np.max((constant * current)[room >= speed]), abs=2e-4)
    assert found.current == current[-1]
    assert found.torque[0] > 1.02 * constant[-1] * current[-1]


@pytest.mark.parametrize("current", [0.0, 20.0, 70.0, 90.0])
def test_warming_is_the_matrix_exponential_and_ends_in_the_steady_state(current: float) -> None:
    """From 70.4 A on, where its resistance rises by more than the winding sheds, that without end."""
    slope = 0.25 * 0.00387 * current**2
    a = np.array([[(slope - 5.0) / 190.0, 5.0 / 190.0, (0.25 * current**2 - 24.0 * slope) / 190.0],
                  [5.0 / 1200.0, -7.5 / 1200.0, 2.5 * 24.0 / 1200.0], [0.0, 0.0, 0.0]])
    p = BASE.nested()
    for time in (1e-3, 1.0, 30.0, 300.0):
        # Of two ways to compute it, rounding.
        exact = (expm(a * time) @ (60.0, 40.0, 1.0))[:2]
        assert warmed(p, current, time, (60.0, 40.0)) == pytest.approx(exact, rel=1e-9)
    end = warmed(p, current, 1e9, (60.0, 40.0))
    assert end == pytest.approx(settled(p, current), rel=1e-12) if current < 30.0 else end[0] >= 1e9


def test_i2t_for_a_while_is_the_closed_form_and_simulated() -> None:
    found = envelope(BASE, 10.0)
    assert found.continuous.currents["i2t"] == 20.0
    current = found.short_term.currents["i2t"]
    assert current == pytest.approx(sqrt(400.0 + 3200.0 * 2.0 / 10.0), rel=1e-9)
    assert envelope(BASE, 1.9).short_term.currents["i2t"] == 60.0
    run = simulate(_set({**HELD, "drive.kp": 1e4, "drive.current_offset": current}).values, 11.0, 0.01, model=MODEL)
    folds = run["time"][np.flatnonzero(run["current_limit"] < 60.0)[0]]
    assert folds == pytest.approx(10.0, abs=0.02)  # of the points, and 5e-5 of the current


def test_no_load_speed_and_voltage() -> None:
    """Without torque nothing gets warm; between, the voltage balance holds at the temperatures of that current."""
    found = envelope(_set({**NO_I2T, "friction.temperature": 40.0}), 10.0)
    cold = 0.11 * (1.0 - 0.0011 * 16.0)
    assert found.speed[-1] == pytest.approx(39.0 / cold, rel=1e-12)
    for curve in (found.continuous, found.short_term):
        assert curve.torque[-1] == pytest.approx(0.0, abs=1e-9)
        assert np.all(np.diff(curve.torque) <= 1e-12)
        assert np.all(curve.torque <= curve.limits["heat"] + 1e-9)
    steady = found.continuous
    at = np.flatnonzero(found.speed > steady.corner_speed)
    assert len(at) > 10
    for i in at[:-1]:
        # Torque and temperatures of a current, found by hand from the torque.
        current = steady.torque[i] / 0.11
        for _ in range(50):
            loss = current**2 * 0.25 * (1.0 + 0.00387 * 16.0)
            winding = 40.0 + 0.6 * loss / (1.0 - 0.6 * current**2 * 0.25 * 0.00387 / 1.0)
            flux = 1.0 - 0.0011 * (40.0 + (winding - 40.0) * 0.4 / 0.6 - 24.0)
            current = steady.torque[i] / (0.11 * flux)
        resistance = 0.25 * (1.0 + 0.00387 * (winding - 24.0))
        assert resistance * current + 0.11 * flux * found.speed[i] == pytest.approx(39.0, rel=1e-6)


def test_the_least_limit_binds() -> None:
    def bound(curve: Curve) -> str:
        assert curve.current == min(curve.currents.values())
        return curve.bound_by

    assert bound(envelope(BASE, 10.0).continuous) == "i2t"
    assert bound(envelope(BASE, 1.0).short_term) == "peak"
    assert bound(envelope(_set(NO_I2T), 1000.0).short_term) == "heat"
    # For ever and a day it is the continuous one.
    for duration in (1e6, 1e9):
        forever = envelope(_set(NO_I2T), duration)
        assert forever.short_term.current == pytest.approx(forever.continuous.current, rel=1e-9)
        assert forever.short_term.winding == pytest.approx(130.0, abs=1e-6)
    assert envelope(BASE, 1e9).short_term.current == pytest.approx(20.0, rel=1e-6)
    assert bound(envelope(BASE, 1e-6).short_term) == "peak"


def test_refusals() -> None:
    with pytest.raises(EmcasError, match=r"needs the extension heat: nonlinear\+heat"):
        envelope(load_parameters(), 1.0)
    for overrides, message in (
            ({"friction.temperature": 140.0}, "friction.temperature = 140 degC must be below heat.winding_limit = 130"),
            ({"motor.back_emf_constant": 0.0}, "motor.back_emf_constant = 0: must be above 0"),
            ({"drive.supply_voltage": 0.0}, "drive.supply_voltage = 0: must be above 0")):
        with pytest.raises(EmcasError, match=message):
            envelope(_set(overrides), 1.0)
    for arguments, text in ((["--duration", "10"], "has no unit"), (["--duration", "3 m"], "does not measure"),
                            (["--duration", "-1 s"], "must be from 1e-06 to 1e+09 s"),
                            (["--duration", "1e18 s"], "--duration 1e+18 s: must be from"),
                            (["--duration", "1e300 s"], "--duration 1e+300 s: must be from"),
                            (["--duration", "1e-9 s"], "must be from"), (["--duration", "inf s"], "--duration inf s"),
                            (["--model", "linear+heat"],
                             "an envelope needs a limit of the motor current; linear+heat has none; choose nonlinear, "
                             "elastic, habibi, worm-gear, worm-gear-elastic or series-clutch"),
                            (["--model", "ristanovic+heat+faults"],
                             "an envelope needs a limit of the motor current; ristanovic+heat+faults has none"),
                            (["--model", "ozkan+heat"],
                             "an envelope needs a supply that limits the motor voltage; ozkan+heat has none"),
                            (["--preload", "1"], "from 0 to below 1"),
                            (["--model", "second-order+heat"], "needs a motor current"),
                            (["--plot", "a.jpeg"], "the name of a plot must end in")):
        done = _emcas(*arguments)
        assert done.exit_code == 2
        assert text in " ".join(done.stderr.split())


@pytest.mark.parametrize("model", ["elastic+heat", "habibi+heat+faults", "nonlinear+heat+homing"])
def test_other_models_have_the_same_drive(model: str) -> None:
    other = load_parameters(model=model)
    same = {name: other.values[name] for name in BASE.values if name in other.values}
    assert np.array_equal(envelope(other, 5.0).continuous.torque, envelope(_set(same), 5.0).continuous.torque)


def test_speeds_are_told_in_turns_a_minute() -> None:
    found = envelope(BASE, 10.0)
    rows = {cells[0].replace(ESTIMATE, "").strip(): [float(cell) for cell in cells[1:]] for cells in (
        line.strip("\u2502 \n").split("\u2502") for line in _emcas().stdout.splitlines()) if "rpm" in cells[0]}
    minute = 60.0 / (2.0 * pi)
    # Of four digits.
    assert rows["voltage limits from / rpm"] == pytest.approx(
        [c.corner_speed * minute for c in (found.continuous, found.short_term)], rel=5e-4)
    assert rows["no-load speed / rpm"] == pytest.approx([found.speed[-1] * minute] * 2, rel=5e-4)
    assert draw(found).axes[0].get_xlim()[1] == pytest.approx(found.speed[-1] * minute)


def test_what_rests_on_estimates_says_so(tmp_path: Path) -> None:
    """The least current does by default; the drive's rating does no more where it is given."""
    given = tmp_path / "rating.toml"
    given.write_text('[heat]\ncontinuous_current = "25 A"\npeak_time = "2 s"\n[drive]\ncurrent_limit = "60 A"\n',
                     encoding="utf-8")
    drive = {"heat.continuous_current", "heat.peak_time", "drive.current_limit"}
    for arguments, estimated in (([], True), (["-p", str(given)], False)):
        done = _emcas(*arguments, "--json", str(tmp_path / "e.json"), "--plot", str(tmp_path / "e.html"))
        marked = {key: set(names) for key, names in json.loads((tmp_path / "e.json").read_text())["estimates"].items()}
        assert ("i2t_current_a" in marked, "peak_current_a" in marked) == (estimated, estimated)
        assert drive <= marked["current_a"] or not estimated
        assert {"heat.winding_to_case", "heat.case_to_ambient"} <= marked["winding_degc"] & marked["heat_current_a"]
        page = (tmp_path / "e.html").read_text(encoding="utf-8")
        for text in (" ".join(done.stdout.split()), page):
            assert re.search(r"Estimate: [\w /.]+, from engineering estimates of [\w., ]*heat.winding_to_case", text)
            assert ("heat.peak_time" in text) is estimated
        assert ("i2t / A (estimate)" in done.stdout) is estimated
        assert "current / A (estimate)" in done.stdout
        assert "winding at the end / degC (estimate)" in done.stdout


def test_nothing_is_an_estimate_where_all_is_given() -> None:
    known = replace(BASE, entries=tuple(replace(entry, source="measured") for entry in BASE.entries))
    assert envelope(known, 10.0).estimates == {}
    assert "(estimate)" not in draw(envelope(known, 10.0)).axes[0].get_ylabel()
    assert "(estimate)" in draw(envelope(BASE, 10.0)).axes[0].get_ylabel()


def test_command(tmp_path: Path) -> None:
    mine = tmp_path / "mine.toml"
    mine.write_text('[heat]\ncontinuous_current = "25 A"\n', encoding="utf-8")
    files = [tmp_path / name for name in ("e.csv", "e.svg", "e.json", "e.html")]
    done = _emcas("-p", str(mine), "--duration", "500 ms", "-o", str(files[0]), "--plot", str(files[1]), "--json",
                  str(files[2]))
    assert done.exit_code == 0, done.output
    assert "peak" in done.output
    figures = json.loads(files[2].read_text(encoding="utf-8"))
    expected = envelope(load_parameters(mine, load_parameters(model=MODEL)), 0.5)
    assert figures["duration_s"] == 0.5
    assert figures["continuous"]["bound_by"] == "heat"
    assert figures["short_term"]["current_a"] == 60.0
    with files[0].open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [float(row["continuous"]) for row in rows] == list(expected.continuous.torque)
    assert [float(row["short_term.peak"]) for row in rows] == list(expected.short_term.limits["peak"])
    assert "<svg" in files[1].read_text(encoding="utf-8")
    assert _emcas("--plot", str(files[3])).exit_code == 0
    assert 'aria-label="Torque-speed envelope"' in files[3].read_text(encoding="utf-8")
