"""The page's linear model beside the package's: margins, poles, responses of the loop at the drive's reference."""

from __future__ import annotations

from math import degrees
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from emcas_fmu.actuators import NAMES, capabilities, get
from emcas_fmu.api import analyse
from emcas_fmu.bench.linear.actuator import LinearActuator
from emcas_fmu.bench.linear.frequency import evaluate, margins
from emcas_fmu.parameters import load_parameters
from tests.own_actuator.example import MODEL as DIRECT_DRIVE
from tests.tools.test_every_actuator import TOGETHER

from .browser import Browser, written

WITH_LOOP = [model for model in (*NAMES, DIRECT_DRIVE, *TOGETHER)
             if capabilities.POSITION_LOOP in get(model).provides]
LOOP = ("(each => (({size, stable, gain_margin, phase_margin, delay_margin, gainCrossover, phaseCrossover}) => ({size, "
        "stable, gain_margin, phase_margin, delay_margin, gainCrossover, phaseCrossover}))(each.loop))"
        "(window.page.live)")
# Of gain [dB], phase [deg] and delay [ms] each: 1e-6 of a margin, from differences of the equations and the splines of
# python-control (1.5e-6 of 4 dB at most), with a factor of ten.
EXACT = 1e-4


def check_margins(browser: Browser, expected: Any) -> None:
    """Fail unless the page that is open has these margins."""
    found = browser.run(LOOP)
    assert found["stable"]
    assert found["gain_margin"] == pytest.approx(expected.gain_db, abs=EXACT)
    assert degrees(found["phase_margin"]) == pytest.approx(degrees(expected.phase), abs=EXACT)
    assert 1e3 * found["delay_margin"] == pytest.approx(1e3 * expected.delay, abs=EXACT)
    assert found["gainCrossover"] == pytest.approx(expected.gain_crossover, rel=1e-5)


def test_margins_are_those_of_the_analysis(browser: Browser) -> None:
    browser.renew()
    check_margins(browser, analyse().linear.margins["reference"])


CHANGES: dict[str, dict[str, float]] = {
    "gains": {"controller.position.kp": 80.0, "controller.velocity.kp": 0.03, "controller.velocity.ki": 0.05},
    "observer": {"controller.load_observer": 40.0}, "no integral": {"controller.position.ki": 0.0},
    "as built": {"motor.torque_constant": 0.1, "motor.resistance": 0.6, "supply_voltage": 20.0},
    "sampling": {"controller.sample_time": 0.002, "drive.transport_delay": 0.0021, "encoder.enabled": False},
}


@pytest.mark.parametrize("changes", CHANGES.values(), ids=CHANGES)
def test_margins_follow_the_sliders(opened: Browser, changes: dict[str, float]) -> None:
    for name, value in changes.items():
        opened.set(name, value)
    renamed = {name.replace("supply_voltage", "drive.supply_voltage"): value for name, value in changes.items()}
    linear = LinearActuator(load_parameters().with_values(renamed).values)
    loop = linear.loop("reference")
    check_margins(opened, margins(loop))
    frequency = np.array(opened.run("[...window.page.live.loop.frequency]"))
    gain, phase = (np.array(opened.run(f"[...window.page.live.loop.{name}]")) for name in ("gain", "phase"))
    expected = evaluate(loop, frequency)
    found = 10.0 ** (gain / 20.0) * np.exp(1j * np.radians(phase))
    np.testing.assert_allclose(found, expected, rtol=1e-6)  # of differences: 1e-7 of a Jacobian
    poles = np.array(opened.run("window.page.live.loop.poles")) @ [1.0, 1j]
    for pole in linear.closed.poles():
        assert np.min(np.abs(poles - pole)) < 1e-5  # those near 0 are nearly multiple: less exact than the others


def test_a_loop_that_is_unstable_has_no_margins(opened: Browser) -> None:
    opened.set("controller.velocity.kp", 0.15)
    assert not LinearActuator(load_parameters().with_values({"controller.velocity.kp": 0.15}).values).stable
    assert "unstable when closed" in opened.run("document.getElementById('loop-summary').textContent")
    opened.rested("window.page.refresh()")
    assert "no value" in opened.run("document.getElementById('verdicts').textContent")
    opened.set("controller.velocity.kp", 0.0)
    assert "margins" in opened.run("document.getElementById('loop-summary').textContent")


def test_both_cases_have_their_loops(opened: Browser) -> None:
    opened.run("window.page.keep()")
    opened.set("controller.velocity.kp", 0.03)
    said = opened.run("document.getElementById('loop-summary').textContent")
    assert said.startswith("A: gain margin 7.216 dB at 47.2")
    assert ". B: gain margin " in said
    ends = opened.run("(({chart: {scales: {x, y}}}) => [x.min, x.max, y.min, y.max])(window.page.loop.nichols)")
    assert ends[0] == -360.0 < ends[1] == 0.0


@pytest.mark.slow  # zig makes its C library for a browser: a minute, once
@pytest.mark.parametrize("model", WITH_LOOP, ids=lambda model: Path(model).stem)
def test_margins_of_every_actuator_are_those_of_the_analysis(browser: Browser, model: str, tmp_path: Path) -> None:
    parameters = load_parameters(model=model)
    browser.open(written(tmp_path, model))
    check_margins(browser, analyse(parameters).linear.margins["reference"])
    assert browser.complaints == []
