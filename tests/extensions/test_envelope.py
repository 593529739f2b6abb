"""Torque-speed envelopes: closed forms, the simulation, and the command."""

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

from .held import BLOCKED_FAST, MODEL

BASE = load_parameters(model=MODEL)
NO_I2T = {"heat.continuous_current": 60.0}


def _emcas(*arguments: str) -> Result:
    return CliRunner().invoke(app, ["envelope", *arguments])


def _set(overrides: Mapping[str, Any]) -> ParameterSet:
    return BASE.with_values(overrides)


def test_continuous_torque_at_standstill_is_the_closed_form() -> None:
    found = envelope(_set(NO_I2T), 10.0).continuous
    loss = (130.0 - 24.0) / (0.2 + 0.4)
    current = sqrt(loss / (0.25 * (1.0 + 0.00387 * 106.0)))
    case = 24.0 + 0.4 * loss
    assert found.bound_by == "heat"
    assert found.current == pytest.approx(current, rel=1e-12)
    assert (found.winding, found.case) == pytest.approx((130.0, case), rel=1e-12)
    assert found.torque[0] == pytest.approx(0.11 * (1.0 - 0.0011 * (case - 24.0)) * current, rel=1e-12)


def test_short_term_current_of_one_exponential_is_the_closed_form() -> None:
    """With a case at ambient temperature and a constant resistance the winding warms by one exponential."""
    one_node = _set({**NO_I2T, "heat.case_capacity": 1e7, "heat.case_to_ambient": 1e-4,
                     "heat.resistance_coefficient": 0.0})
    for duration in (0.5, 10.0, 200.0):
        steady = 106.0 / (1.0 - exp(-duration / (190.0 * 0.2)))
        expected = sqrt(steady / 0.2 / 0.25)
        # The case warms by 1e-4/0.2 of the winding's rise.
        assert short_term_current(one_node.nested(), duration, (24.0, 24.0)) == pytest.approx(expected, rel=5e-4)


@pytest.mark.parametrize("preload", [0.0, 0.7])
def test_the_simulated_winding_reaches_its_limit_in_the_duration(preload: float) -> None:
    found, p = envelope(_set(NO_I2T), 20.0, preload), _set(NO_I2T).nested()
    winding, case = _steady((preload * found.continuous.current)**2)
    current = short_term_current(p, 20.0, settled(p, preload * found.continuous.current))
    assert found.short_term.currents["heat"] == current
    values = _set({**BLOCKED_FAST, "drive.kp": 1e4, "drive.current_limit": 1e3, "heat.continuous_current": 1e3,
                   "drive.current_offset": current * (1.0 + 0.25e-4), "heat.winding_start_rise": winding - 24.0,
                   "heat.case_start_rise": case - 24.0}).values
    run = simulate(values, 20.0, 1.0, model=MODEL)
    # The current is less than its reference by R/(R + kp). The offset corrects that for the cold R; its rise leaves
    # 1e-5 of the current.
    assert run["winding_temperature"][-1] == pytest.approx(130.0, abs=5e-3)


@pytest.mark.parametrize(("pairs", "speed"), [(0, 218.18), (4, 154.67)])
def test_the_knee_of_a_cold_motor_at_its_peak_current(pairs: int, speed: float) -> None:
    """60 A, 0.25 ohm, 0.11 V.s/rad, 0.6 mH at 39 V: (15 + 0.11 w)^2 + (0.036 n w)^2 = 39^2, in V and rad/s."""
    cold = _set({**NO_I2T, "motor.pole_pairs": pairs, "heat.resistance_coefficient": 0.0,
                 "heat.torque_coefficient": 0.0})
    whole = envelope(cold, 0.1)
    found = whole.short_term
    assert found.bound_by == "peak"
    assert found.corner_speed == pytest.approx(speed, abs=0.01)
    # Up to the knee the torque is that of the peak current; beyond it the voltage's limit is less.
    assert np.all((found.torque < 0.11 * 60.0 * (1.0 - 1e-9)) == (whole.speed > found.corner_speed))
    np.testing.assert_allclose(np.minimum(found.limits["voltage"], 6.6), found.torque, atol=1e-6)


def _steady(square: float) -> tuple[float, float]:
    """Return steady temperatures [degC] of winding and case under i^2 [A^2], solved by hand: T = T_a + 0.6 R(T) i^2."""
    rise = 0.6 * 0.25 * square / (1.0 - 0.6 * 0.25 * 0.00387 * square)
    return 24.0 + rise, 24.0 + rise * 0.4 / 0.6


def _resistance(winding: float) -> float:
    return 0.25 * (1.0 + 0.00387 * (winding - 24.0))


@pytest.mark.parametrize(("overrides", "least"), [({}, 20.0), ({"heat.continuous_current": 10.0}, 10.0), (
    {"drive.current_limit": 8.0}, 8.0), (NO_I2T, sqrt(106.0 / 0.6 / 0.25 / (1.0 + 0.00387 * 106.0)))])
def test_preload_is_a_share_of_the_least_continuous_current(overrides: Mapping[str, Any], least: float) -> None:
    """The voltage's curve and the no-load speed are those of the temperatures after the preload."""
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
    # Heat never allows the peak current for this duration: its curve has the temperatures at the winding's limit.
    hottest = 0.11 * (1.0 - 0.0011 * 0.4 / 0.6 * 106.0)
    assert found.limits["peak"] == pytest.approx(60.0 * hottest, rel=1e-9)


@pytest.mark.parametrize("coefficient", [-0.005, -0.008])
def test_with_weak_magnets_the_curve_has_the_largest_torque_of_any_current(coefficient: float) -> None:
    """By closed forms over all currents; a smaller current than the largest has more torque."""
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
    """From 41.5 A on, 1/sqrt(0.6 0.25 0.00387), the rising resistance adds more heat than leaves: there is no end."""
    slope = 0.25 * 0.00387 * current**2
    a = np.array([[(slope - 5.0) / 190.0, 5.0 / 190.0, (0.25 * current**2 - 24.0 * slope) / 190.0],
                  [5.0 / 1200.0, -7.5 / 1200.0, 2.5 * 24.0 / 1200.0], [0.0, 0.0, 0.0]])
    p = BASE.nested()
    for time in (1e-3, 1.0, 30.0, 300.0):
        # Both compute the same exponential: rounding.
        exact = (expm(a * time) @ (60.0, 40.0, 1.0))[:2]
        assert warmed(p, current, time, (60.0, 40.0)) == pytest.approx(exact, rel=1e-9)
    end = warmed(p, current, 1e9, (60.0, 40.0))
    assert end == pytest.approx(settled(p, current), rel=1e-12) if current < 30.0 else end[0] >= 1e9


def test_short_term_current_of_i2t_is_the_closed_form_and_the_simulation() -> None:
    found = envelope(BASE, 10.0)
    assert found.continuous.currents["i2t"] == 20.0
    current = found.short_term.currents["i2t"]
    assert current == pytest.approx(sqrt(400.0 + 3200.0 * 2.0 / 10.0), rel=1e-9)
    assert envelope(BASE, 1.9).short_term.currents["i2t"] == 60.0
    values = _set({**BLOCKED_FAST, "drive.kp": 1e4, "drive.current_offset": current}).values
    run = simulate(values, 11.0, 0.01, model=MODEL)
    folds = run["time"][np.flatnonzero(run["current_limit"] < 60.0)[0]]
    assert folds == pytest.approx(10.0, abs=0.02)  # rows of 0.01 s; the current is 5e-5 below its reference


def test_no_load_speed_and_voltage() -> None:
    """At no load the motor is cold; below that speed the voltages balance at the temperatures of the current."""
    found = envelope(_set({**NO_I2T, "friction.temperature": 40.0}), 10.0)
    cold = 0.11 * (1.0 - 0.0011 * 16.0)
    assert found.speed[-1] == pytest.approx(39.0 / cold, rel=1e-12)
    for curve in (found.continuous, found.short_term):
        assert curve.torque[-1] == pytest.approx(0.0, abs=1e-9)
        assert np.all(np.diff(curve.torque) <= 1e-12)
        assert np.all(curve.torque <= curve.limits["heat"] + 1e-9)
    steady = found.continuous
    rows = np.flatnonzero(found.speed > steady.corner_speed)
    assert len(rows) > 10
    for i in rows[:-1]:
        # Current and temperatures follow from the torque by iteration.
        current = steady.torque[i] / 0.11
        for _ in range(50):
            loss = current**2 * 0.25 * (1.0 + 0.00387 * 16.0)
            winding = 40.0 + 0.6 * loss / (1.0 - 0.6 * current**2 * 0.25 * 0.00387)
            flux = 1.0 - 0.0011 * (40.0 + (winding - 40.0) * 0.4 / 0.6 - 24.0)
            current = steady.torque[i] / (0.11 * flux)
        assert _resistance(winding) * current + 0.11 * flux * found.speed[i] == pytest.approx(39.0, rel=1e-6)


def test_the_least_limit_binds() -> None:
    def bound(curve: Curve) -> str:
        assert curve.current == min(curve.currents.values())
        return curve.bound_by

    assert bound(envelope(BASE, 10.0).continuous) == "i2t"
    assert bound(envelope(BASE, 1.0).short_term) == "peak"
    assert bound(envelope(_set(NO_I2T), 1000.0).short_term) == "heat"
    for duration in (1e6, 1e9):  # long enough for the continuous current
        found = envelope(_set(NO_I2T), duration)
        assert found.short_term.current == pytest.approx(found.continuous.current, rel=1e-9)
        assert found.short_term.winding == pytest.approx(130.0, abs=1e-6)
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
                             "an envelope needs a limit of the motor current; linear+heat has none; choose "
                             "nonlinear+heat, elastic+heat, habibi+heat, worm-gear+heat, worm-gear-elastic+heat or "
                             "series-clutch+heat"),
                            (["--model", "ristanovic+heat+faults"],
                             "an envelope needs a limit of the motor current; ristanovic+heat+faults has none"),
                            (["--model", "ozkan+heat"],
                             "an envelope needs a current loop whose voltage the supply limits; ozkan+heat has none"),
                            (["--preload", "1"], "from 0 to below 1"),
                            (["--model", "second-order+heat"], "needs a motor current"),
                            (["--plot", "a.jpeg"], "the name of a plot must end in")):
        done = _emcas(*arguments)
        assert done.exit_code == 2
        assert text in " ".join(done.stderr.split())


@pytest.mark.parametrize("model", ["elastic+heat", "habibi+heat+faults", "nonlinear+heat+homing"])
def test_models_with_the_same_drive_have_the_same_torque(model: str) -> None:
    other = load_parameters(model=model)
    shared = {name: other.values[name] for name in BASE.values if name in other.values}
    assert np.array_equal(envelope(other, 5.0).continuous.torque, envelope(_set(shared), 5.0).continuous.torque)


def test_speeds_are_shown_in_rpm() -> None:
    found = envelope(BASE, 10.0)
    rows = {cells[0].replace(ESTIMATE, "").strip(): [float(cell) for cell in cells[1:]] for cells in (
        line.strip("\u2502 \n").split("\u2502") for line in _emcas().stdout.splitlines()) if "rpm" in cells[0]}
    minute = 60.0 / (2.0 * pi)
    # The table has four digits.
    assert rows["voltage limits from / rpm"] == pytest.approx(
        [c.corner_speed * minute for c in (found.continuous, found.short_term)], rel=5e-4)
    assert rows["no-load speed / rpm"] == pytest.approx([found.speed[-1] * minute] * 2, rel=5e-4)
    assert draw(found).axes[0].get_xlim()[1] == pytest.approx(found.speed[-1] * minute)


def test_results_from_estimates_are_marked(tmp_path: Path) -> None:
    """I2t and peak current are estimates by default, but not with the drive's rating in a file."""
    rating = tmp_path / "rating.toml"
    rating.write_text('[heat]\ncontinuous_current = "25 A"\npeak_time = "2 s"\n[drive]\ncurrent_limit = "60 A"\n',
                      encoding="utf-8")
    drive = {"heat.continuous_current", "heat.peak_time", "drive.current_limit"}
    for arguments, estimated in (([], True), (["-p", str(rating)], False)):
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


def test_results_from_measured_parameters_are_not_marked() -> None:
    measured = replace(BASE, entries=tuple(replace(entry, source="measured") for entry in BASE.entries))
    assert envelope(measured, 10.0).estimates == {}
    assert "(estimate)" not in draw(envelope(measured, 10.0)).axes[0].get_ylabel()
    assert "(estimate)" in draw(envelope(BASE, 10.0)).axes[0].get_ylabel()


def test_command(tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    file.write_text('[heat]\ncontinuous_current = "25 A"\n', encoding="utf-8")
    table, plot, figures_file, page = (tmp_path / name for name in ("e.csv", "e.svg", "e.json", "e.html"))
    done = _emcas("-p", str(file), "--duration", "500 ms", "-o", str(table), "--plot", str(plot), "--json",
                  str(figures_file))
    assert done.exit_code == 0, done.output
    assert "peak" in done.output
    figures = json.loads(figures_file.read_text(encoding="utf-8"))
    expected = envelope(load_parameters(file, load_parameters(model=MODEL)), 0.5)
    assert figures["duration_s"] == 0.5
    assert figures["continuous"]["bound_by"] == "heat"
    assert figures["short_term"]["current_a"] == 60.0
    rows = list(csv.DictReader(table.read_text(encoding="utf-8").splitlines()))
    assert [float(row["continuous"]) for row in rows] == list(expected.continuous.torque)
    assert [float(row["short_term.peak"]) for row in rows] == list(expected.short_term.limits["peak"])
    assert "<svg" in plot.read_text(encoding="utf-8")
    assert _emcas("--plot", str(page)).exit_code == 0
    assert 'aria-label="Torque-speed envelope"' in page.read_text(encoding="utf-8")
