"""A command that the user draws by mouse or finger, or writes as points."""

from __future__ import annotations

from math import degrees, radians
from typing import Any

import numpy as np
import pytest

from .browser import DEFAULT_PAGE, Browser

pytestmark = pytest.mark.slow  # ten seconds in a browser

DRAWN = "window.page.live.setting.kind === 'csv' && window.page.live.setting.file?.title === 'drawn command'"
COMMAND = "(({columns: {fin_command: c}}) => [...c])(window.page.live.run.excitation)"
PLACE = """(({chart}) => (box => arguments[0].map(([t, x]) => [box.left + chart.valToPos(t, "x"),
    box.top + chart.valToPos(x, "y")]))(chart.over.getBoundingClientRect()))(window.page.plots[0])"""


@pytest.fixture(autouse=True)
def undrawn(tab: Browser) -> None:
    """Switch drawing off."""
    tab.run("window.page.drawing.turn(false)")


def button(browser: Browser) -> Any:
    return browser.driver.find_element("id", "draw")


def drag(browser: Browser, points: list[tuple[float, float]], touch: bool = False) -> None:
    """Draw a command through points (time [s], angle [deg]) by mouse or finger, and wait for its response."""
    browser.run("window.before = window.page.live.setting.file")
    stroke(browser, points, touch)
    browser.wait(f"{DRAWN} && window.page.live.setting.file !== window.before")
    browser.settle()


def stroke(browser: Browser, points: list[tuple[float, float]], touch: bool = False) -> None:
    """Move the pressed mouse, or a finger, through points (time [s], angle [deg])."""
    browser.run("scrollTo(0, 0)")
    browser.settle()
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
def test_strokes_set_the_command(tab: Browser, touch: bool) -> None:
    button(tab).click()
    assert button(tab).get_attribute("aria-pressed") == "true"
    tab.settle()
    assert tab.run("window.page.plots[0].chart.scales.y.max") >= 20.0  # deg, the largest command
    drag(tab, STROKE, touch)
    command = np.degrees(tab.run(COMMAND))
    end = len(command) - 1
    assert end == 550
    # A pixel is 0.7 ms and 0.2 deg: at the slope of 150 deg/s 0.1 deg + 0.2 deg.
    expected = np.interp(np.arange(end + 1) / 1000, [t for t, _ in STROKE], [x for _, x in STROKE])
    np.testing.assert_allclose(command, expected, atol=0.4)
    assert tab.run("window.page.live.run.outputs.fin_angle.at(-1)") == pytest.approx(radians(-5.0), abs=0.005)
    # A second stroke replaces the command between its ends.
    drag(tab, [(0.25, 5.0), (0.4, 5.0)], touch)
    again = np.degrees(tab.run(COMMAND))
    np.testing.assert_allclose(again[:249], command[:249], atol=1e-9)  # deg, rounding of the interpolation
    np.testing.assert_allclose(again[252:398], 5.0, atol=0.2)
    np.testing.assert_allclose(again[402:], command[402:], atol=1e-9)
    button(tab).click()
    tab.settle()
    assert tab.run("window.page.plots[0].chart.scales.y.max") < 20.0


def test_stroke_backwards_in_time_removes_points(tab: Browser) -> None:
    button(tab).click()
    drag(tab, [(0.1, 0.0), (0.3, 15.0), (0.2, 3.0), (0.4, 3.0)])
    assert max(tab.run(COMMAND)) == pytest.approx(radians(3.0), abs=radians(0.2))


@pytest.mark.parametrize("touch", [False, True], ids=["mouse", "finger"])
def test_click_or_vertical_or_backward_stroke_changes_nothing(tab: Browser, touch: bool) -> None:
    before = tab.run(COMMAND)
    button(tab).click()
    tab.settle()
    for points in ([(0.2, 12.0)], [(0.2, 12.0), (0.2, -12.0)], [(0.2, 12.0), (0.1, 5.0)]):
        stroke(tab, points, touch)
        tab.settle()
        assert tab.run("window.page.live.setting.kind") == "step"
    tab.run_and_finish("window.page.refresh()")
    assert tab.run(COMMAND) == before


def write(browser: Browser, text: str) -> None:
    """Write points with the keyboard."""
    from selenium.webdriver.common.keys import Keys

    field = browser.driver.find_element("id", "points")
    field.send_keys(Keys.CONTROL + "a")
    field.send_keys(text + Keys.TAB)


def test_written_points_set_the_command_and_a_link_restores_them(tab: Browser) -> None:
    from selenium.webdriver.common.keys import Keys

    button(tab).send_keys(Keys.ENTER)
    write(tab, "0 0\n0,1; 2\n")
    tab.wait("document.getElementById('problems').textContent")
    assert "drawn command: line 2, '0,1; 2', is not" in tab.run("document.getElementById('problems').textContent")
    write(tab, "0, 0\n0.1 0\n0.1 5\n0.2, −2.5\n0.4, -2.5\n")
    tab.wait(DRAWN)
    tab.run_and_finish("window.page.refresh()")
    command = tab.run(COMMAND)
    assert [degrees(command[k]) for k in (0, 99, 100, 150, 400)] == pytest.approx([0.0, 0.0, 5.0, 1.25, -2.5])
    assert len(command) == 401
    button(tab).send_keys(Keys.ENTER)
    tab.open(DEFAULT_PAGE, tab.run("location.hash"))
    tab.wait(f"window.page.live.run && {DRAWN}")
    assert tab.run(COMMAND) == command
    field = tab.driver.find_element("id", "points")
    assert field.get_attribute("value").splitlines() == ["0, 0", "0.1, 0", "0.1, 5", "0.2, -2.5", "0.4, -2.5"]


@pytest.mark.parametrize("line", ["0,", ", 5", "abc", "0, 0x10", "0, Infinity", "0,1,2", "0,, 5", "1 e1 2", "."])
def test_message_names_the_line_that_is_no_point(tab: Browser, line: str) -> None:
    """Other texts are not read as numbers, and a missing value is not read as 0."""
    button(tab).click()
    tab.run("((f, text) => { f.value = text; f.dispatchEvent(new Event('change')); })("
               "document.getElementById('points'), arguments[0])", f"0, 0\n\n{line}\n1, 3")
    tab.settle()
    message = tab.run("document.getElementById('problems').textContent")
    assert message == f"drawn command: line 3, '{line}', is not a time [s] and an angle [°], such as 0.2, 10"
    assert tab.run("window.page.live.setting.kind") == "step"


@pytest.mark.parametrize("line", ["1,3", "1 3", "1.;+3.0", "\t1e0 , 30E-1 "])
def test_two_decimal_numbers_are_a_point(tab: Browser, line: str) -> None:
    tab.run("document.getElementById('points').value = arguments[0]", line)
    assert tab.run("window.page.drawing.points") == [[1.0, pytest.approx(radians(3.0))]]


def test_stroke_over_a_csv_file_keeps_the_other_samples_and_the_load(tab: Browser) -> None:
    rows = "time,aero_torque,fin_command\n0,0,0\n0.1,50,0\n0.1,50,0.1\n0.3,-20,0.1\n0.5,-20,0\n"
    tab.run("window.page.showFile('mine.csv', () => arguments[0])", rows)
    tab.wait("window.page.live.setting.file?.title === 'mine.csv'")
    tab.settle()
    load = "[...window.page.live.run.excitation.columns.aero_torque]"
    command, torque = np.array(tab.run(COMMAND)), tab.run(load)
    button(tab).click()
    tab.settle()
    field = tab.driver.find_element("id", "points")
    assert field.get_attribute("value").splitlines()[-2:] == ["0.3, 5.72957795", "0.5, 0"]
    drag(tab, [(0.2, 0.0), (0.25, 0.0)])
    again = np.array(tab.run(COMMAND))
    assert len(again) == 501
    outside = np.r_[0:198, 253:501]  # ms; the stroke's ends are uncertain by a pixel of 0.7 ms
    np.testing.assert_allclose(again[outside], command[outside], atol=1e-9)  # rad, interpolation between fewer rows
    np.testing.assert_allclose(again[202:249], 0.0, atol=radians(0.2))
    assert tab.run(load) == torque
    write(tab, "0, 2\n0.3, 2\n")
    tab.wait("window.page.live.run?.excitation.time.length === 301")
    np.testing.assert_allclose(tab.run(COMMAND), radians(2.0), atol=1e-12)
    assert tab.run(load) == torque[:301]
