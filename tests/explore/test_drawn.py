"""A command drawn by hand, or written as points."""

from __future__ import annotations

from math import degrees, radians
from typing import Any

import numpy as np
import pytest

from .browser import SHOWN, Browser

pytestmark = pytest.mark.slow  # ten seconds of a browser

DRAWN = "window.page.live.setting.kind === 'csv' && window.page.live.setting.file?.title === 'drawn command'"
COMMAND = "(({columns: {fin_command: c}}) => [...c])(window.page.live.run.excitation)"
PLACE = """(({chart}) => (box => arguments[0].map(([t, x]) => [box.left + chart.valToPos(t, "x"),
    box.top + chart.valToPos(x, "y")]))(chart.over.getBoundingClientRect()))(window.page.plots[0])"""


@pytest.fixture(autouse=True)
def undrawn(opened: Browser) -> None:
    """Drawing is off."""
    opened.run("window.page.drawing.turn(false)")


def button(browser: Browser) -> Any:
    return browser.driver.find_element("id", "draw")


def drag(browser: Browser, points: list[tuple[float, float]], touch: bool = False) -> None:
    """Draw a command through points, time [s] and angle [deg], by mouse or by finger, and wait for it."""
    browser.run("window.before = window.page.live.setting.file")
    stroke(browser, points, touch)
    browser.wait(f"{DRAWN} && window.page.live.setting.file !== window.before")
    browser.settled()


def stroke(browser: Browser, points: list[tuple[float, float]], touch: bool = False) -> None:
    """Move the mouse, or a finger, through points."""
    browser.run("scrollTo(0, 0)")
    browser.settled()
    places = browser.run(PLACE, points)
    for k, (x, y) in enumerate([*places, places[-1]]):
        last = k == len(places)
        if touch:
            event: dict[str, Any] = {
                "type": "touchEnd" if last else "touchMove" if k else "touchStart",
                "touchPoints": [] if last else [{"x": x, "y": y}]}
            browser.driver.execute_cdp_cmd("Input.dispatchTouchEvent", event)
        else:
            event = {"type": "mouseReleased" if last else "mouseMoved" if k else "mousePressed", "x": x, "y": y,
                     "button": "left", "buttons": 0 if last else 1, "clickCount": int(k in (0, len(places)))}
            browser.driver.execute_cdp_cmd("Input.dispatchMouseEvent", event)


STROKE = [(0.1, 0.0), (0.2, 10.0), (0.3, -5.0)]


@pytest.mark.parametrize("touch", [False, True], ids=["mouse", "finger"])
def test_a_command_is_drawn(opened: Browser, touch: bool) -> None:
    button(opened).click()
    assert button(opened).get_attribute("aria-pressed") == "true"
    opened.settled()
    assert opened.run("window.page.plots[0].chart.scales.y.max") >= 20.0  # to the largest command
    drag(opened, STROKE, touch)
    command = np.degrees(opened.run(COMMAND))
    end = len(command) - 1
    assert end == 550
    # To a pixel: 0.7 ms and 0.2 deg, which at the slope of 150 deg/s is 0.3 deg.
    expected = np.interp(np.arange(end + 1) / 1000, [t for t, _ in STROKE], [x for _, x in STROKE])
    np.testing.assert_allclose(command, expected, atol=0.4)
    assert opened.run("window.page.live.run.outputs.fin_angle.at(-1)") == pytest.approx(radians(-5.0), abs=0.005)
    # A second stroke replaces its part.
    drag(opened, [(0.25, 5.0), (0.4, 5.0)], touch)
    again = np.degrees(opened.run(COMMAND))
    np.testing.assert_allclose(again[:249], command[:249], atol=1e-9)  # of interpolation
    np.testing.assert_allclose(again[252:398], 5.0, atol=0.2)
    np.testing.assert_allclose(again[402:], command[402:], atol=1e-9)
    button(opened).click()
    opened.settled()
    assert opened.run("window.page.plots[0].chart.scales.y.max") < 20.0


def test_going_back_takes_points_away(opened: Browser) -> None:
    button(opened).click()
    drag(opened, [(0.1, 0.0), (0.3, 15.0), (0.2, 3.0), (0.4, 3.0)])
    assert max(opened.run(COMMAND)) == pytest.approx(radians(3.0), abs=radians(0.2))


@pytest.mark.parametrize("touch", [False, True], ids=["mouse", "finger"])
def test_a_click_draws_nothing(opened: Browser, touch: bool) -> None:
    before = opened.run(COMMAND)
    button(opened).click()
    opened.settled()
    for points in ([(0.2, 12.0)], [(0.2, 12.0), (0.2, -12.0)], [(0.2, 12.0), (0.1, 5.0)]):
        stroke(opened, points, touch)
        opened.settled()
        assert opened.run("window.page.live.setting.kind") == "step"
    opened.rested("window.page.refresh()")
    assert opened.run(COMMAND) == before


def write(browser: Browser, text: str) -> None:
    """Write points by keyboard alone."""
    from selenium.webdriver.common.keys import Keys

    field = browser.driver.find_element("id", "points")
    field.send_keys(Keys.CONTROL + "a")
    field.send_keys(text + Keys.TAB)


def test_points_are_written_by_keyboard_and_restored_by_a_link(opened: Browser) -> None:
    from selenium.webdriver.common.keys import Keys

    button(opened).send_keys(Keys.ENTER)
    write(opened, "0 0\n0,1; 2\n")
    opened.wait("document.getElementById('problems').textContent")
    assert "drawn command: line 2, '0,1; 2', is not" in opened.run("document.getElementById('problems').textContent")
    write(opened, "0, 0\n0.1 0\n0.1 5\n0.2, −2.5\n0.4, -2.5\n")
    opened.wait(DRAWN)
    opened.rested("window.page.refresh()")
    command = opened.run(COMMAND)
    assert [degrees(command[k]) for k in (0, 99, 100, 150, 400)] == pytest.approx([0.0, 0.0, 5.0, 1.25, -2.5])
    assert len(command) == 401
    button(opened).send_keys(Keys.ENTER)
    opened.open(SHOWN, opened.run("location.hash"))
    opened.wait(f"window.page.live.run && {DRAWN}")
    assert opened.run(COMMAND) == command
    field = opened.driver.find_element("id", "points")
    assert field.get_attribute("value").splitlines() == ["0, 0", "0.1, 0", "0.1, 5", "0.2, -2.5", "0.4, -2.5"]


@pytest.mark.parametrize("line", ["0,", ", 5", "abc", "0, 0x10", "0, Infinity", "0,1,2", "0,, 5", "1 e1 2", "."])
def test_a_line_that_is_no_point_is_named(opened: Browser, line: str) -> None:
    """Nothing is read as a number that is none, nor an empty place as 0."""
    button(opened).click()
    opened.run("((f, text) => { f.value = text; f.dispatchEvent(new Event('change')); })("
               "document.getElementById('points'), arguments[0])", f"0, 0\n\n{line}\n1, 3")
    opened.settled()
    said = opened.run("document.getElementById('problems').textContent")
    assert said == f"drawn command: line 3, '{line}', is not a time [s] and an angle [°], such as 0.2, 10"
    assert opened.run("window.page.live.setting.kind") == "step"


@pytest.mark.parametrize("line", ["1,3", "1 3", "1.;+3.0", "\t1e0 , 30E-1 "])
def test_a_point_is_two_decimal_numbers(opened: Browser, line: str) -> None:
    opened.run("document.getElementById('points').value = arguments[0]", line)
    assert opened.run("window.page.drawing.points") == [[1.0, pytest.approx(radians(3.0))]]


def test_a_stroke_over_a_file_keeps_the_rest_of_it(opened: Browser) -> None:
    """Its command before and after the stroke, and its load."""
    rows = "time,aero_torque,fin_command\n0,0,0\n0.1,50,0\n0.1,50,0.1\n0.3,-20,0.1\n0.5,-20,0\n"
    opened.run("window.page.showFile('mine.csv', () => arguments[0])", rows)
    opened.wait("window.page.live.setting.file?.title === 'mine.csv'")
    opened.settled()
    load = "[...window.page.live.run.excitation.columns.aero_torque]"
    command, torque = np.array(opened.run(COMMAND)), opened.run(load)
    button(opened).click()
    opened.settled()
    field = opened.driver.find_element("id", "points")
    assert field.get_attribute("value").splitlines()[-2:] == ["0.3, 5.72957795", "0.5, 0"]
    drag(opened, [(0.2, 0.0), (0.25, 0.0)])
    again = np.array(opened.run(COMMAND))
    assert len(again) == 501
    outside = np.r_[0:198, 253:501]  # ms; to a pixel of 0.7 ms
    np.testing.assert_allclose(again[outside], command[outside], atol=1e-9)  # of thinned rows
    np.testing.assert_allclose(again[202:249], 0.0, atol=radians(0.2))
    assert opened.run(load) == torque
    write(opened, "0, 2\n0.3, 2\n")
    opened.wait("window.page.live.run?.excitation.time.length === 301")
    np.testing.assert_allclose(opened.run(COMMAND), radians(2.0), atol=1e-12)
    assert opened.run(load) == torque[:301]
