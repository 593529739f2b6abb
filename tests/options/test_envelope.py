"""Torque-speed envelopes: against closed forms, against the simulation, and the command."""

from __future__ import annotations

import csv
import json
from collections.abc import Mapping
from math import exp, sqrt
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner, Result

from emcas_fmu.analysis.envelope import Curve, envelope, short_term_current
from emcas_fmu.cli import app
from emcas_fmu.errors import EmcasError
from emcas_fmu.parameters import ParameterSet, load_parameters
from emcas_fmu.simulation import simulate

from .held import HELD, MODEL

BASE = load_parameters(model=MODEL)
NO_I2T = {"heat.continuous_current": 60.0}


def _emcas(*arguments: str) -> Result:
    return CliRunner().invoke(app, ["envelope", *arguments])


def _set(overrides: Mapping[str, Any]) -> ParameterSet:
    return BASE.replace(overrides)


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
        assert short_term_current(lone.nested(), duration) == pytest.approx(expected, rel=5e-4)


@pytest.mark.parametrize("preload", [0.0, 0.7])
def test_the_simulated_winding_gets_there_in_the_duration(preload: float) -> None:
    found = envelope(_set(NO_I2T), 20.0, preload)
    before = _set({"heat.continuous_current": 60.0}).nested()
    share = preload**2
    # The steady state of the preload: T = T_a + 0.6 R(T) i^2, solved by hand.
    square = share * found.continuous.current**2
    rise = 0.6 * 0.25 * square / (1.0 - 0.6 * 0.25 * 0.00387 * square)
    current = short_term_current(before, 20.0, preload)
    assert found.short_term.currents["heat"] == current
    values = _set({**HELD, "drive.kp": 1e4, **NO_I2T, "drive.current_limit": 1e3, "heat.continuous_current": 1e3,
                   "drive.current_offset": current * (1.0 + 0.25e-4), "heat.winding_start_rise": rise,
                   "heat.case_start_rise": rise * 0.4 / 0.6}).values
    run = simulate(values, 20.0, 1.0, model=MODEL)
    # The current is less than its reference by R/(R + kp), of which the rise in R, 1e-5, is left.
    assert run["winding_temperature"][-1] == pytest.approx(130.0, abs=5e-3)


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
    forever = envelope(_set(NO_I2T), 1e6)
    assert forever.short_term.current == pytest.approx(forever.continuous.current, rel=1e-9)


def test_refusals() -> None:
    with pytest.raises(EmcasError, match=r"needs the option heat, as in nonlinear\+heat"):
        envelope(load_parameters(), 1.0)
    for overrides, message in (
            ({"friction.temperature": 140.0}, "friction.temperature = 140 degC must be below heat.winding_limit = 130"),
            ({"motor.back_emf_constant": 0.0}, "motor.back_emf_constant = 0: must be above 0"),
            ({"drive.supply_voltage": 0.0}, "drive.supply_voltage = 0: must be above 0")):
        with pytest.raises(EmcasError, match=message):
            envelope(_set(overrides), 1.0)
    for arguments, text in ((["--duration", "10"], "has no unit"), (["--duration", "3 m"], "does not measure"),
                            (["--duration", "-1 s"], "must be above 0"), (["--preload", "1"], "from 0 to below 1"),
                            (["--model", "second-order+heat"], "needs a motor current"),
                            (["--plot", "a.jpeg"], "a plot ends in")):
        done = _emcas(*arguments)
        assert done.exit_code == 2
        assert text in " ".join(done.stderr.split())


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
