"""The page's linear model beside the package's: margins, poles, responses of the loop at the drive's reference."""

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

from .browser import Browser, written

LOOP = ("(({stable, gain_margin, phase_margin, delay_margin, gainCrossover}) => ({stable, gain_margin, phase_margin, "
        "delay_margin, gainCrossover}))(window.page.live.loop)")
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


@pytest.mark.slow
def test_margins_are_those_of_the_analysis(browser: Browser) -> None:
    """tests/explore/test_page.py compares those of every actuator."""
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


@pytest.mark.slow
def test_both_cases_have_their_loops(opened: Browser) -> None:
    opened.run("window.page.keep()")
    opened.set("controller.velocity.kp", 0.03)
    said = opened.run("document.getElementById('loop-summary').textContent")
    assert said.startswith("A: gain margin 7.216 dB at 47.2")
    assert ". B: gain margin " in said
    opened.run("window.page.loop.nichols.redraw()")  # it is out of view
    opened.settled()
    assert opened.run("(({chart: {scales: {x}}}) => [x.min, x.max])(window.page.loop.nichols)") == [-360.0, 0.0]


@pytest.mark.slow  # zig makes its C library for a browser: a minute, once
@pytest.mark.parametrize("name", NARROW)
def test_narrow_resonances_limit_the_margins(browser: Browser, name: str, tmp_path: Path) -> None:
    model, changes = NARROW[name]
    values = load_parameters(model=model).with_values(changes).values
    browser.open(written(tmp_path, model))
    for parameter, value in changes.items():
        browser.set(parameter, value)
    check_margins(browser, margins(LinearActuator(values, model=model).loop("reference")))


@pytest.mark.slow  # zig makes its C library for a browser: a minute, once
def test_a_choice_at_rest_keeps_its_side(browser: Browser, tmp_path: Path) -> None:
    """Brushes off their neutral position weaken one direction: at rest the motor is the stronger one."""
    parameters = load_parameters(model="servo")
    browser.open(written(tmp_path, "servo"))
    for asymmetry in (0.1, -0.1):
        browser.set("motor.asymmetry", asymmetry)
        values = parameters.with_values({"motor.asymmetry": asymmetry}).values
        check_margins(browser, margins(LinearActuator(values, model="servo").loop("reference")))


POLE = "window.page.loop.poles.pole"
GAINS = "PLACING.map(name => window.page.live.setting.get(name))"


def handle(browser: Browser) -> Any:
    """The handle of the slowest pair, in view, when nothing on the page moves any more."""
    browser.rested("window.page.refresh()")
    browser.run("document.getElementById('loop').scrollIntoView({block: 'center'})")
    browser.settled()
    browser.run("window.page.loop.poles.plot.redraw()")
    browser.settled()
    return browser.driver.find_element("css selector", ".handle")


def drag_pole(browser: Browser, *places: tuple[float, float]) -> None:
    """Drag the pole through places [Hz] by mouse."""
    handle(browser)
    start, *to = browser.run("""(({plot: {chart}, pole}) => (box => [pole, ...arguments[0]].map(([x, y]) => [
        box.left + chart.valToPos(x, "x"), box.top + chart.valToPos(y, "y")]))(chart.over.getBoundingClientRect()))(
        window.page.loop.poles)""", places)
    moves = [("mousePressed", start), *(("mouseMoved", place) for place in to), ("mouseReleased", to[-1])]
    for event, (x, y) in moves:
        browser.driver.execute_cdp_cmd("Input.dispatchMouseEvent", {
            "type": event, "x": x, "y": y, "button": "left", "buttons": int(event != "mouseReleased"),
            "clickCount": int(event != "mouseMoved")})
        browser.settled()


def test_a_pole_is_dragged_to_its_place(opened: Browser) -> None:
    """The gains that follow have their poles there by the package's linear model."""
    start = opened.run(POLE)
    assert start == pytest.approx([-16.7489, 25.5167], abs=1e-3)
    assert opened.run("window.page.loop.poles.handle.getAttribute('aria-label')").startswith(
        "Pole, the slowest pair at 30.52 Hz with damping 0.5487")
    drag_pole(opened, (-17.0, 24.0), (-20.0, 20.0))
    gains = opened.run(GAINS)
    values = dict(zip(("controller.position.kp", "controller.velocity.kp"), gains, strict=True))
    poles = continuous_poles(LinearActuator(load_parameters().with_values(values).values).closed) / (2.0 * np.pi)
    found = poles[np.argmin(np.abs(poles - (-20.0 + 20.0j)))]
    assert abs(found - (-20.0 + 20.0j)) < 0.3  # Hz of a pixel
    assert opened.run(POLE) == pytest.approx([found.real, found.imag], abs=1e-4)  # Jacobians of 1e-7
    assert opened.run("document.querySelector('[data-name=\"controller.velocity.kp\"] [type=text]').value") == (
        f"{gains[1]:.9g}")


@pytest.mark.slow
def test_a_dragged_pole_ends_at_the_sliders(opened: Browser) -> None:
    for place in ((-2.0, 45.0), (20.0, 60.0), (-60.0, 2.0), (-1.0, 1.0)):
        opened.run("window.page.loop.poles.move(arguments[0])", place)
        opened.settled()
        ranges = opened.run("PLACING.map(name => window.page.controls.find(c => c.control.name === name).range)")
        assert all(low <= gain <= high for gain, (low, high) in zip(opened.run(GAINS), ranges, strict=True))
        assert opened.run("window.page.live.loop.stable")


@pytest.mark.slow
def test_a_pole_is_moved_by_keys(opened: Browser) -> None:
    from selenium.webdriver.common.keys import Keys

    before, step = opened.run(POLE), opened.run("window.page.loop.poles.size / 100")
    grip = handle(opened)
    grip.send_keys(Keys.ARROW_LEFT * 2 + Keys.ARROW_UP)
    opened.settled()
    # Each key begins where gains of six digits have put the pole.
    assert opened.run(POLE) == pytest.approx([before[0] - 2.0 * step, before[1] + step], abs=1e-3)
    assert opened.run("document.activeElement.className") == "handle"


@pytest.mark.slow
def test_an_unstable_pole_is_dragged_until_the_loop_is_stable(opened: Browser) -> None:
    opened.set("controller.velocity.kp", 0.15)
    assert not opened.run("window.page.live.loop.stable")
    assert opened.run(POLE) == pytest.approx([9.0, 53.6], abs=0.1)  # not the slowest
    assert "the unstable pair" in opened.run("window.page.loop.poles.handle.getAttribute('aria-label')")
    drag_pole(opened, (5.0, 50.0), (-5.0, 45.0))
    assert opened.run("window.page.live.loop.stable")
    assert opened.run(POLE) == pytest.approx([-5.0, 45.0], abs=0.5)  # Hz of a pixel
    for name, gain in zip(("controller.position.kp", "controller.velocity.kp"), (200.0, 0.05), strict=True):
        opened.set(name, gain)
    growth = "growthOf(window.page.live.loop.poles)"
    before = opened.run(growth)
    opened.run("window.page.loop.poles.move([30, 30])")  # to where it would grow faster
    opened.settled()
    assert opened.run(growth) <= before + 1e-6  # of gains of six digits


@pytest.mark.slow
def test_keys_move_the_same_pair_where_another_becomes_slower(opened: Browser) -> None:
    from selenium.webdriver.common.keys import Keys

    handle(opened).send_keys(Keys.ARROW_LEFT)
    opened.settled()
    path = opened.driver.execute_async_script("""const done = arguments[0], path = [], {poles} = window.page.loop;
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
    assert "the chosen pair" in opened.run(label)
    opened.run("window.page.show(window.page.live, {...window.page.live})")  # another redrawing
    opened.settled()
    assert opened.run(POLE) == path[-1][:2]
    opened.run("window.page.begin({setting: window.page.live.setting})")
    opened.settled()
    assert opened.run(POLE) == pytest.approx([0.0, 2.3], abs=0.1)
    assert "the slowest pair" in opened.run(label)
