"""Parts of the page: presets, torque-speed plane, mechanism, strip of verdicts, CSV files in links."""

from __future__ import annotations

from math import degrees, radians, tan
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from emcas_fmu.parameters import load_parameters
from emcas_fmu.studies.analysis.capability import envelope

from .browser import SHOWN, Browser, written

pytestmark = pytest.mark.slow  # fifteen seconds of a browser


def choose(browser: Browser, identifier: str, text: str) -> None:
    """Choose an option of a list as a user does."""
    from selenium.webdriver.support.select import Select

    Select(browser.driver.find_element("id", identifier)).select_by_visible_text(text)
    browser.settled()


CHOSEN = "document.getElementById('preset').selectedOptions[0].textContent"


def test_a_preset_is_the_shipped_set(opened: Browser) -> None:
    opened.set("excitation.kind", "slew")
    opened.set("motor.resistance", 0.3)
    assert opened.run(CHOSEN) == "other values"
    for name in ("load-observer", "robust"):  # nothing of a former choice stays
        choose(opened, "preset", name)
        found = opened.run("window.page.live.setting.parameters")
        assert {**found, "drive.supply_voltage": 39.0} == load_parameters(name).values  # the supply is an input
    assert opened.run("window.page.live.setting.kind") == "slew"
    assert "margins" in opened.run("document.getElementById('preset-about').textContent")
    opened.rested("window.page.refresh()")
    opened.open(SHOWN, opened.run("location.hash"))
    assert opened.run(CHOSEN) == "robust"
    choose(opened, "preset", "sag")
    assert opened.run("window.page.live.setting.get('supply_voltage')") == pytest.approx(28.0)
    choose(opened, "preset", "initial values")
    assert opened.run("Object.keys(window.page.live.setting.values)") == ["excitation.kind"]


def test_limits_of_torque_are_those_of_the_analysis(opened: Browser) -> None:
    """The same operations in the same order, in C and in numpy: the same bits."""
    for changes in ({}, {"motor.pole_pairs": 5.0, "supply_voltage": 30.0}):
        for name, value in changes.items():
            opened.set(name, value)
        renamed = {name.replace("supply_voltage", "drive.supply_voltage"): value for name, value in changes.items()}
        expected = envelope(load_parameters().with_values(renamed).values)
        found = opened.run("(({actuator, live: {setting}}) => [...actuator.limitTorques(setting.parameters, "
                           "setting.get('supply_voltage'), arguments[0])])(window.page)",
                           expected["speed_rad_per_s"].tolist())
        np.testing.assert_array_equal(found, expected["torque_nm"])
    # The drawn limits enclose the whole response, which is drawn to its end.
    opened.run("window.page.plane.redraw()")  # it may be out of view
    opened.settled()
    low, high = opened.run("(({scales: {y}}) => [y.min, y.max])(window.page.plane.chart)")
    most = opened.run("magnitude(window.page.live.run.outputs.motor_torque) / DATA.plane.torque[1]")
    assert low < -most < most < high
    assert "largest steady torque at rest" in opened.run("window.page.plane.box.getAttribute('aria-label')")


STRIP = ("[...document.querySelectorAll('#verdicts li')].map(e => [e.className, ...[...e.children].map("
         "part => part.textContent)])")
TABLE = ("[...document.querySelectorAll('#requirements tbody tr')].map(({cells: [title, verdict]}) => ["
         "verdict.classList[1], title.textContent, verdict.textContent]).filter(([passed]) => passed !== 'skip')")


def test_the_strip_has_the_verdicts_of_the_table(opened: Browser) -> None:
    opened.set("controller.position.kp", 20.0)
    opened.rested("window.page.refresh()")
    strip, table = opened.run(STRIP), opened.run(TABLE)
    assert {passed for passed, *_ in strip} == {"pass", "fail"}
    assert [[passed, title, f"{value} ({margin})"] for passed, title, value, margin in strip] == table
    missed = [title for passed, title, *_ in strip if passed == "fail"]
    line = opened.run("document.getElementById('verdict').textContent")
    assert line == f"{len(missed)} of {len(strip)} requirements missed: {'; '.join(missed)}"
    margins = {title: margin for _, title, _, margin in strip}
    assert margins["Bandwidth at 1 deg"].startswith("−")
    assert margins["Unloaded fin rate"].startswith("+")


WORKED = "window.page.background = new Background([document.getElementById('data').textContent, {}])"
FAILED = "requirements and frequency responses are not computed: "


@pytest.mark.parametrize("program", ["'AAAA', document.getElementById('program').textContent", "'', '}'"],
                         ids=["no actuator", "no program"])
def test_a_worker_that_fails_is_said(opened: Browser, program: str) -> None:
    opened.run(f"({WORKED.format(program)}, null)")
    for gain in (60.0, 61.0):  # each time
        opened.set("controller.position.kp", gain)
        opened.wait("document.getElementById('warnings').textContent")
        assert opened.run("document.getElementById('warnings').textContent").startswith(FAILED)
        assert opened.run("document.body.classList.contains('waiting')")  # what is shown is of another setting
        assert opened.run("window.page.live.figures.rise_time") > 0.0
    _ = opened.complaints  # read away: the browser may have its own, of a program that does not run
    opened.open(SHOWN)
    opened.rested("window.page.refresh()")
    assert opened.run("document.getElementById('warnings').textContent") == ""
    assert not opened.run("document.body.classList.contains('waiting')")


@pytest.mark.parametrize("width", [400, 1400])
def test_the_verdict_stays_beside_the_sliders(opened: Browser, width: int) -> None:
    opened.size(width)
    opened.set("friction.temperature", -40.0)  # outside the temperatures of the identification: a warning
    sliders = "document.querySelector('[data-name=\"controller.velocity.kp\"]')"
    for place in ("0", f"{sliders}.getBoundingClientRect().top", "1500" if width > 1000 else "900"):
        opened.run(f"scrollTo(0, {place})")
        opened.settled()
        for part in ("verdict", "verdicts", "warnings"):
            top, bottom = opened.run("(b => [b.top, b.bottom])(document.getElementById(arguments[0])."
                                     "getBoundingClientRect())", part)
            assert 0 <= top < bottom <= 900, (part, place)
    assert opened.run("document.getElementById('warnings').textContent")


PART = "document.querySelector('.mechanism .{}').getAttribute('transform')"


def test_the_mechanism_is_that_of_the_time_under_the_cursor(opened: Browser) -> None:
    opened.set("excitation.torque", -40.0)
    for time in (0.1, 0.3):
        opened.run("window.page.mechanism.set(arguments[0])", time)
        fin, nut = opened.run("['fin_angle', 'nut_position'].map(name => window.page.live.run.outputs[name]["
                              "Math.round(arguments[0] / STEP)])", time)
        turned = float(opened.run(PART.format("fin")).removeprefix("rotate(").rstrip(")"))
        assert turned == pytest.approx(-degrees(fin))
        assert abs(turned) > 2.0
        # A rigid lever meets the nut: equation (2.5), by the page from angle and displacement.
        arm, initial = 0.05, radians(5.0)
        at = float(opened.run(PART.format("nut")).removeprefix("translate(").partition(" ")[0])
        assert at == pytest.approx(55.0 * (nut / arm + tan(initial)))
        assert at == pytest.approx(55.0 * tan(fin + initial))
        # The cursor of every plot over time follows, to within a row; the width of a pixel is less than that.
        under = opened.run("window.page.plots.map(({chart}) => chart.data[0][chart.cursor.idx])")
        np.testing.assert_allclose(under, time, atol=1.5e-3)
        assert opened.run("document.querySelector('.mechanism [type=range]').value") == f"{time}"
    # The other way round: a cursor in a plot moves the mechanism.
    opened.run("(({chart}) => chart.setCursor({left: chart.valToPos(0.2, 'x'), top: 10}))(window.page.plots[0])")
    assert opened.run("window.page.mechanism.time") == pytest.approx(0.2, abs=1.5e-3)


def drawn(browser: Browser, model: str, folder: Path, time: float) -> dict[str, float]:
    """Open the page of an actuator under load, its mechanism at a time [s], and return the outputs there."""
    browser.open(written(folder, model), "#B=excitation.torque%3D-40")
    browser.run("window.page.mechanism.set(arguments[0])", time)
    row: dict[str, float] = browser.run("Object.fromEntries(Object.entries(window.page.live.run.outputs).map("
                                        "([name, column]) => [name, column[Math.round(arguments[0] / STEP)]]))", time)
    assert browser.complaints == []
    return row


def check_mesh(wheel: str, worm: str, teeth: int, fin_angle: float) -> None:
    """Fail unless a tooth is where the fin is, and teeth and threads at the bottom are half a pitch apart."""
    begins = [[float(x) for x in each.split(" L")[0].split()] for each in wheel.split("M")[1:]]
    angles = np.array([np.arctan2(x, y) for x, y in begins])  # from the bottom, as the lever's: to the right positive
    turn = 2.0 * np.pi / teeth
    assert np.min(np.abs(angles - fin_angle)) < 1e-9
    threads = np.array([float(each.split()[0]) for each in worm.split("M")[1:]])  # next to the wheel
    np.testing.assert_allclose(np.diff(threads), 38.0 * turn)
    apart = np.min(np.abs(threads[:, None] - 38.0 * angles), axis=0)[np.abs(angles) < 0.5]
    np.testing.assert_allclose(apart, 19.0 * turn, rtol=1e-9)


def test_a_worm_and_its_wheel_move_together(opened: Browser) -> None:
    """A positive fin angle moves the bottom of the wheel to the right, as the lever's end of other drives."""
    for fin_angle in (0.0, 0.02, -0.3):
        wheel, screw = opened.run("(part => { part.show({fin_angle: arguments[0], motor_angle: 30 * arguments[0]}, "
                                  "{'worm.teeth': 60, 'worm.starts': 2}); return ['nut wheel', 'worm'].map(name => "
                                  "part.shapes.find(shape => shape.getAttribute('class') === name)"
                                  ".getAttribute('d')); })(worm())", fin_angle)
        check_mesh(wheel, screw, 60, fin_angle)


def test_a_worm_s_threads_are_where_the_motor_is_and_teeth_where_the_fin_is(browser: Browser, tmp_path: Path) -> None:
    row = drawn(browser, "worm-gear", tmp_path, 0.085)
    teeth, starts = (load_parameters(model="worm-gear").values[f"worm.{name}"] for name in ("teeth", "starts"))
    # A rigid gear: what is drawn of it meshes.
    assert row["motor_angle"] * starts / teeth == pytest.approx(row["fin_angle"])
    wheel, worm = browser.run("['wheel', 'worm'].map(part => document.querySelector(`.mechanism .${part}`)."
                              "getAttribute('d'))")
    check_mesh(wheel, worm, int(teeth), row["fin_angle"])


@pytest.mark.parametrize("model", ["electrohydraulic", "electrohydrostatic"])
def test_a_cylinder_s_piston_and_chambers(browser: Browser, model: str, tmp_path: Path) -> None:
    row = drawn(browser, model, tmp_path, 0.075)
    at = float(browser.run(PART.format("piston")).removeprefix("translate(").partition(" ")[0])
    assert at == pytest.approx(55.0 * (row["piston_position"] / 0.05 + tan(radians(5.0))))
    assert at == pytest.approx(55.0 * tan(row["fin_angle"] + radians(5.0)))
    chambers = browser.run("[...document.querySelectorAll('.mechanism .pressure')].map(e => ['x', 'width', "
                           "'fill-opacity'].map(name => Number(e.getAttribute(name))))")
    (left, one, dark), (middle, two, light) = chambers
    assert left + one == pytest.approx(-78.0 + at) == middle
    assert one + two == pytest.approx(62.0)
    assert dark / light == pytest.approx(row["pressure_1"] / row["pressure_2"])
    assert dark > light  # chamber 1 moves the fin in the positive direction, against the load


def player(browser: Browser) -> Any:
    """The button that plays and pauses, in view."""
    browser.run("document.querySelector('.mechanism').scrollIntoView({block: 'center'})")
    return browser.driver.find_element("css selector", ".mechanism button")


def test_the_mechanism_plays_and_pauses(opened: Browser) -> None:
    button = player(opened)
    button.click()
    assert button.text == "Pause"
    opened.wait("window.page.mechanism.time > 0.02 && window.page.mechanism.time < 0.5")
    button.click()
    assert button.text == "Play"
    at = opened.run("window.page.mechanism.time")
    opened.settled()
    assert opened.run("window.page.mechanism.time") == at


def test_nothing_plays_where_motion_is_reduced(opened: Browser) -> None:
    def reduce(value: str) -> None:
        opened.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {
            "features": [{"name": "prefers-reduced-motion", "value": value}]})

    button = player(opened)
    button.click()
    try:
        reduce("reduce")
        opened.settled()
        assert not button.is_displayed()
        assert opened.run("window.page.mechanism.playing") is None
    finally:
        reduce("")


def flown(browser: Browser, path: Path) -> None:
    """Fly a CSV file, as a user chooses it, and wait for all that follows."""
    browser.driver.find_element("id", "file").send_keys(str(path))
    browser.wait(f"window.page.live.setting.file?.title === '{path.name}'")
    browser.rested("window.page.refresh()")


def test_a_link_holds_the_csv_files(opened: Browser, tmp_path: Path) -> None:
    state = ("[window.page.kept, window.page.live].map(each => [each.setting.values, each.setting.file.title, "
             "[...each.run.outputs.fin_angle]])")
    for name, angle in (("one.csv", 0.1), ("zwei ä&=.csv", -0.05)):
        path = tmp_path / name
        path.write_text(f"time,fin_command\n0,0\n0.1,{angle}\n0.4,{angle}\n", encoding="utf-8")
        flown(opened, path)
        if name == "one.csv":
            opened.run("window.page.keep()")
    before, link = opened.run(state), opened.run("location.hash")
    assert before[0][2] != before[1][2]
    opened.open(SHOWN, link)
    opened.wait("window.page.live?.run")
    assert opened.run(state) == before
    assert opened.run("document.getElementById('notes').textContent") == ""


def test_a_csv_file_that_a_link_cannot_hold_is_said(opened: Browser, tmp_path: Path) -> None:
    noise = np.random.default_rng(1).uniform(-0.1, 0.1, 8001)
    path = tmp_path / "long.csv"
    path.write_text("time,fin_command\n" + "".join(f"{k / 10_000},{x!r}\n" for k, x in enumerate(noise.tolist())),
                    encoding="utf-8")
    flown(opened, path)
    assert "csv=" not in opened.run("location.hash").replace("kind%3Dcsv", "")
    opened.run("(Object.defineProperty(navigator, 'clipboard', {configurable: true, "
               "value: {writeText: async () => 0}}), null)")
    opened.run("document.getElementById('link').click()")
    opened.wait("document.getElementById('copied').textContent")
    assert "too long" in opened.run("document.getElementById('copied').textContent")
    opened.open(SHOWN, "#B=excitation.kind%3Dcsv&B.csv=AAAA")
    opened.wait("document.getElementById('notes').textContent")
    assert "CSV file of B is not readable" in opened.run("document.getElementById('notes').textContent")
