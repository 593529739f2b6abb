"""The page's linear model compared with the package's: margins, poles and frequency response of the loop."""

from __future__ import annotations

from itertools import pairwise
from math import degrees
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from emcas_fmu.api import analyse
from emcas_fmu.bench.linear.actuator import LinearActuator
from emcas_fmu.bench.linear.frequency import continuous_poles, evaluate, margins
from emcas_fmu.parameters import load_parameters
from tests.analysis.test_linear import NARROW

from .browser import Browser, write_page

LOOP = ("(({stable, gain_margin, phase_margin, delay_margin, gainCrossover}) => ({stable, gain_margin, phase_margin, "
        "delay_margin, gainCrossover}))(window.page.live.loop)")
# For gain [dB], phase [deg] and delay [ms]. Numerical derivatives and python-control's splines cause differences of
# 1e-6 of a margin (at most 1.5e-6 of 4 dB); the limit has a factor of ten.
EXACT = 1e-4


def check_margins(browser: Browser, expected: Any) -> None:
    """Assert that the open page has these margins."""
    found = browser.run(LOOP)
    assert found["stable"]
    assert found["gain_margin"] == pytest.approx(expected.gain_db, abs=EXACT)
    assert degrees(found["phase_margin"]) == pytest.approx(degrees(expected.phase), abs=EXACT)
    assert 1e3 * found["delay_margin"] == pytest.approx(1e3 * expected.delay, abs=EXACT)
    assert found["gainCrossover"] == pytest.approx(expected.gain_crossover, rel=1e-5)


@pytest.mark.slow
def test_margins_of_the_default_actuator_equal_the_analysis(browser: Browser) -> None:
    """tests/explore/test_page.py compares the margins of every actuator."""
    browser.renew()
    check_margins(browser, analyse().linear.margins["reference"])


CHANGES: dict[str, dict[str, float]] = {
    "gains": {"controller.position.kp": 80.0, "controller.velocity.kp": 0.03, "controller.velocity.ki": 0.05},
    "observer": {"controller.load_observer": 40.0}, "no integral": {"controller.position.ki": 0.0},
    "as built": {"motor.torque_constant": 0.1, "motor.resistance": 0.6, "supply_voltage": 20.0},
    "sampling": {"controller.sample_time": 0.002, "drive.transport_delay": 0.0021, "encoder.enabled": False},
}


@pytest.mark.parametrize("changes", CHANGES.values(), ids=CHANGES)
def test_margins_follow_the_sliders(tab: Browser, changes: dict[str, float]) -> None:
    for name, value in changes.items():
        tab.set(name, value)
    renamed = {name.replace("supply_voltage", "drive.supply_voltage"): value for name, value in changes.items()}
    linear = LinearActuator(load_parameters().with_values(renamed).values)
    loop = linear.loop("reference")
    check_margins(tab, margins(loop))
    frequency = np.array(tab.run("[...window.page.live.loop.frequency]"))
    gain, phase = (np.array(tab.run(f"[...window.page.live.loop.{name}]")) for name in ("gain", "phase"))
    expected = evaluate(loop, frequency)
    found = 10.0 ** (gain / 20.0) * np.exp(1j * np.radians(phase))
    np.testing.assert_allclose(found, expected, rtol=1e-6)  # numerical derivatives: 1e-7 of a Jacobian
    poles = np.array(tab.run("window.page.live.loop.poles")) @ [1.0, 1j]
    for pole in linear.closed.poles():
        assert np.min(np.abs(poles - pole)) < 1e-5  # poles near 0 are nearly multiple, and less exact than others


def test_unstable_loop_has_no_margins(tab: Browser) -> None:
    tab.set("controller.velocity.kp", 0.15)
    assert not LinearActuator(load_parameters().with_values({"controller.velocity.kp": 0.15}).values).stable
    assert "unstable when closed" in tab.run("document.getElementById('loop-summary').textContent")
    tab.run_and_finish("window.page.refresh()")
    assert "no value" in tab.run("document.getElementById('verdicts').textContent")
    tab.set("controller.velocity.kp", 0.0)
    assert "margins" in tab.run("document.getElementById('loop-summary').textContent")


@pytest.mark.slow
def test_both_settings_have_margins(tab: Browser) -> None:
    tab.run("window.page.keep()")
    tab.set("controller.velocity.kp", 0.03)
    summary = tab.run("document.getElementById('loop-summary').textContent")
    assert summary.startswith("A: gain margin 7.216 dB at 47.2")
    assert ". B: gain margin " in summary
    tab.run("window.page.loop.nichols.redraw()")  # the chart is out of view
    tab.settle()
    assert tab.run("(({chart: {scales: {x}}}) => [x.min, x.max])(window.page.loop.nichols)") == [-360.0, 0.0]


@pytest.mark.slow  # zig makes its C library for a browser: a minute, once
@pytest.mark.parametrize("name", NARROW)
def test_narrow_resonances_limit_the_margins(browser: Browser, name: str, tmp_path: Path) -> None:
    model, changes = NARROW[name]
    values = load_parameters(model=model).with_values(changes).values
    browser.open(write_page(tmp_path, model))
    for parameter, value in changes.items():
        browser.set(parameter, value)
    check_margins(browser, margins(LinearActuator(values, model=model).loop("reference")))


@pytest.mark.slow  # zig makes its C library for a browser: a minute, once
def test_linear_model_uses_the_stronger_direction_of_asymmetric_brushes(browser: Browser, tmp_path: Path) -> None:
    """Brushes off their neutral position make the motor weaker in one direction."""
    parameters = load_parameters(model="servo")
    browser.open(write_page(tmp_path, "servo"))
    for asymmetry in (0.1, -0.1):
        browser.set("motor.asymmetry", asymmetry)
        values = parameters.with_values({"motor.asymmetry": asymmetry}).values
        check_margins(browser, margins(LinearActuator(values, model="servo").loop("reference")))


POLE = "window.page.loop.poles.pole"
GAINS = "PLACING.map(name => window.page.live.setting.get(name))"


def handle(browser: Browser) -> Any:
    """Return the handle of the slowest pole pair, scrolled into view, after all computations."""
    browser.run_and_finish("window.page.refresh()")
    browser.run("document.getElementById('loop').scrollIntoView({block: 'center'})")
    browser.settle()
    browser.run("window.page.loop.poles.plot.redraw()")
    browser.settle()
    return browser.driver.find_element("css selector", ".handle")


def drag_pole(browser: Browser, *places: tuple[float, float]) -> None:
    """Drag the pole by mouse through positions (real and imaginary part [Hz])."""
    handle(browser)
    start, *to = browser.run("""(({plot: {chart}, pole}) => (box => [pole, ...arguments[0]].map(([x, y]) => [
        box.left + chart.valToPos(x, "x"), box.top + chart.valToPos(y, "y")]))(chart.over.getBoundingClientRect()))(
        window.page.loop.poles)""", places)
    moves = [("mousePressed", start), *(("mouseMoved", place) for place in to), ("mouseReleased", to[-1])]
    for event, (x, y) in moves:
        browser.driver.execute_cdp_cmd("Input.dispatchMouseEvent", {
            "type": event, "x": x, "y": y, "button": "left", "buttons": int(event != "mouseReleased"),
            "clickCount": int(event != "mouseMoved")})
        browser.settle()


def test_dragged_pole_sets_the_gains(tab: Browser) -> None:
    """With these gains the package's linear model has its poles there."""
    start = tab.run(POLE)
    assert start == pytest.approx([-16.7489, 25.5167], abs=1e-3)
    assert tab.run("window.page.loop.poles.handle.getAttribute('aria-label')").startswith(
        "Pole, the slowest pair at 30.52 Hz with damping 0.5487")
    drag_pole(tab, (-17.0, 24.0), (-20.0, 20.0))
    gains = tab.run(GAINS)
    values = dict(zip(("controller.position.kp", "controller.velocity.kp"), gains, strict=True))
    poles = continuous_poles(LinearActuator(load_parameters().with_values(values).values).closed) / (2.0 * np.pi)
    found = poles[np.argmin(np.abs(poles - (-20.0 + 20.0j)))]
    assert abs(found - (-20.0 + 20.0j)) < 0.3  # Hz, a pixel
    assert tab.run(POLE) == pytest.approx([found.real, found.imag], abs=1e-4)  # Hz; numerical derivatives
    assert tab.run("document.querySelector('[data-name=\"controller.velocity.kp\"] [type=text]').value") == (
        f"{gains[1]:.9g}")


@pytest.mark.slow
def test_dragged_pole_keeps_the_gains_within_their_sliders(tab: Browser) -> None:
    for place in ((-2.0, 45.0), (20.0, 60.0), (-60.0, 2.0), (-1.0, 1.0)):
        tab.run("window.page.loop.poles.move(arguments[0])", place)
        tab.settle()
        ranges = tab.run("PLACING.map(name => window.page.controls.find(c => c.control.name === name).range)")
        assert all(low <= gain <= high for gain, (low, high) in zip(tab.run(GAINS), ranges, strict=True))
        assert tab.run("window.page.live.loop.stable")


@pytest.mark.slow
def test_keys_move_the_pole(tab: Browser) -> None:
    from selenium.webdriver.common.keys import Keys

    before, step = tab.run(POLE), tab.run("window.page.loop.poles.size / 100")
    grip = handle(tab)
    grip.send_keys(Keys.ARROW_LEFT * 2 + Keys.ARROW_UP)
    tab.settle()
    # Each key begins at the pole of the last gains, which have six digits.
    assert tab.run(POLE) == pytest.approx([before[0] - 2.0 * step, before[1] + step], abs=1e-3)
    assert tab.run("document.activeElement.className") == "handle"


@pytest.mark.slow
def test_an_unstable_pole_is_dragged_until_the_loop_is_stable(tab: Browser) -> None:
    tab.set("controller.velocity.kp", 0.15)
    assert not tab.run("window.page.live.loop.stable")
    assert tab.run(POLE) == pytest.approx([9.0, 53.6], abs=0.1)  # not the slowest
    assert "the unstable pair" in tab.run("window.page.loop.poles.handle.getAttribute('aria-label')")
    drag_pole(tab, (5.0, 50.0), (-5.0, 45.0))
    assert tab.run("window.page.live.loop.stable")
    assert tab.run(POLE) == pytest.approx([-5.0, 45.0], abs=0.5)  # Hz, a pixel
    for name, gain in zip(("controller.position.kp", "controller.velocity.kp"), (200.0, 0.05), strict=True):
        tab.set(name, gain)
    growth = "growthOf(window.page.live.loop.poles)"
    before = tab.run(growth)
    tab.run("window.page.loop.poles.move([30, 30])")  # a position with faster growth
    tab.settle()
    assert tab.run(growth) <= before + 1e-6  # gains have six digits


@pytest.mark.slow
def test_keys_move_the_same_pair_after_another_has_become_the_slowest(tab: Browser) -> None:
    from selenium.webdriver.common.keys import Keys

    handle(tab).send_keys(Keys.ARROW_LEFT)
    tab.settle()
    path = tab.driver.execute_async_script("""const done = arguments[0], path = [], {poles} = window.page.loop;
        const press = () => {
            path.push([...poles.pole, poles.size]);
            if (path.length === 40) return done(path);
            poles.handle.dispatchEvent(new KeyboardEvent("keydown", {key: "ArrowLeft"}));
            requestAnimationFrame(() => requestAnimationFrame(press));
        };
        press();""")
    for (*pole, _), (*moved, size) in pairwise(path):
        assert np.hypot(*np.subtract(moved, pole)) < 3.0 * size / 100.0
    label = "window.page.loop.poles.handle.getAttribute('aria-label')"
    assert "the chosen pair" in tab.run(label)
    tab.run("window.page.show(window.page.live, {...window.page.live})")  # plots again
    tab.settle()
    assert tab.run(POLE) == path[-1][:2]
    tab.run("window.page.begin({setting: window.page.live.setting})")
    tab.settle()
    assert tab.run(POLE) == pytest.approx([0.0, 2.3], abs=0.1)
    assert "the slowest pair" in tab.run(label)
