"""Parts of the page: presets, torque-speed plane, mechanism, strip of verdicts, CSV files in links."""

from __future__ import annotations

from math import degrees, radians, tan
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from emcas_fmu.parameters import load_parameters
from emcas_fmu.studies.analysis.capability import envelope

from .browser import DEFAULT_PAGE, Browser, write_page

pytestmark = pytest.mark.slow  # fifteen seconds in a browser


def choose(browser: Browser, identifier: str, text: str) -> None:
    """Choose an option of a list."""
    from selenium.webdriver.support.select import Select

    Select(browser.driver.find_element("id", identifier)).select_by_visible_text(text)
    browser.settle()


CHOSEN = "document.getElementById('preset').selectedOptions[0].textContent"


def test_preset_sets_the_values_of_the_shipped_set(tab: Browser) -> None:
    tab.set("excitation.kind", "slew")
    tab.set("motor.resistance", 0.3)
    assert tab.run(CHOSEN) == "other values"
    for name in ("load-observer", "robust"):  # the second choice replaces all values of the first
        choose(tab, "preset", name)
        found = tab.run("window.page.live.setting.parameters")
        assert {**found, "drive.supply_voltage": 39.0} == load_parameters(name).values  # the supply is an input
    assert tab.run("window.page.live.setting.kind") == "slew"
    assert "margins" in tab.run("document.getElementById('preset-about').textContent")
    tab.run_and_finish("window.page.refresh()")
    tab.open(DEFAULT_PAGE, tab.run("location.hash"))
    assert tab.run(CHOSEN) == "robust"
    choose(tab, "preset", "sag")
    assert tab.run("window.page.live.setting.get('supply_voltage')") == pytest.approx(28.0)
    choose(tab, "preset", "initial values")
    assert tab.run("Object.keys(window.page.live.setting.values)") == ["excitation.kind"]


def test_torque_limits_have_the_bits_of_the_analysis(tab: Browser) -> None:
    """C and NumPy do the same operations in the same order."""
    for changes in ({}, {"motor.pole_pairs": 5.0, "supply_voltage": 30.0}):
        for name, value in changes.items():
            tab.set(name, value)
        renamed = {name.replace("supply_voltage", "drive.supply_voltage"): value for name, value in changes.items()}
        expected = envelope(load_parameters().with_values(renamed).values)
        found = tab.run("(({actuator, live: {setting}}) => [...actuator.limitTorques(setting.parameters, "
                           "setting.get('supply_voltage'), arguments[0])])(window.page)",
                           expected["speed_rad_per_s"].tolist())
        np.testing.assert_array_equal(found, expected["torque_nm"])
    # The axis contains the whole response.
    tab.run("window.page.plane.redraw()")  # the chart may be out of view
    tab.settle()
    low, high = tab.run("(({scales: {y}}) => [y.min, y.max])(window.page.plane.chart)")
    most = tab.run("magnitude(window.page.live.run.outputs.motor_torque) / DATA.plane.torque[1]")
    assert low < -most < most < high
    assert "largest steady torque at rest" in tab.run("window.page.plane.box.getAttribute('aria-label')")


STRIP = ("[...document.querySelectorAll('#verdicts li')].map(e => [e.className, ...[...e.children].map("
         "part => part.textContent)])")
TABLE = ("[...document.querySelectorAll('#requirements tbody tr')].map(({cells: [title, verdict]}) => ["
         "verdict.classList[1], title.textContent, verdict.textContent]).filter(([passed]) => passed !== 'skip')")


def test_strip_has_the_verdicts_of_the_table(tab: Browser) -> None:
    tab.set("controller.position.kp", 20.0)
    tab.run_and_finish("window.page.refresh()")
    strip, table = tab.run(STRIP), tab.run(TABLE)
    assert {passed for passed, *_ in strip} == {"pass", "fail"}
    assert [[passed, title, f"{value} ({margin})"] for passed, title, value, margin in strip] == table
    missed = [title for passed, title, *_ in strip if passed == "fail"]
    line = tab.run("document.getElementById('verdict').textContent")
    assert line == f"{len(missed)} of {len(strip)} requirements missed: {'; '.join(missed)}"
    margins = {title: margin for _, title, _, margin in strip}
    assert margins["Bandwidth at 1 deg"].startswith("−")
    assert margins["Unloaded fin rate"].startswith("+")


WORKED = "window.page.background = new Background([document.getElementById('data').textContent, {}])"
FAILED = "requirements and frequency responses are not computed: "


@pytest.mark.parametrize("program", ["'AAAA', document.getElementById('program').textContent", "'', '}'"],
                         ids=["no actuator", "no program"])
def test_failed_worker_is_a_warning(tab: Browser, program: str) -> None:
    tab.run(f"({WORKED.format(program)}, null)")
    for gain in (60.0, 61.0):  # after each change
        tab.set("controller.position.kp", gain)
        tab.wait("document.getElementById('warnings').textContent")
        assert tab.run("document.getElementById('warnings').textContent").startswith(FAILED)
        assert tab.run("document.body.classList.contains('waiting')")  # the shown results are of another setting
        assert tab.run("window.page.live.figures.rise_time") > 0.0
    _ = tab.complaints  # the browser itself may report the broken program
    tab.open(DEFAULT_PAGE)
    tab.run_and_finish("window.page.refresh()")
    assert tab.run("document.getElementById('warnings').textContent") == ""
    assert not tab.run("document.body.classList.contains('waiting')")


@pytest.mark.parametrize("width", [400, 1400])
def test_verdict_and_warnings_remain_visible_beside_the_sliders(tab: Browser, width: int) -> None:
    tab.size(width)
    tab.set("friction.temperature", -40.0)  # outside the temperatures of the identification: a warning
    sliders = "document.querySelector('[data-name=\"controller.velocity.kp\"]')"
    for place in ("0", f"{sliders}.getBoundingClientRect().top", "1500" if width > 1000 else "900"):
        tab.run(f"scrollTo(0, {place})")
        tab.settle()
        for part in ("verdict", "verdicts", "warnings"):
            top, bottom = tab.run("(b => [b.top, b.bottom])(document.getElementById(arguments[0])."
                                     "getBoundingClientRect())", part)
            assert 0 <= top < bottom <= 900, (part, place)
    assert tab.run("document.getElementById('warnings').textContent")


PART = "document.querySelector('.mechanism .{}').getAttribute('transform')"


def test_mechanism_shows_the_time_under_the_cursor(tab: Browser) -> None:
    tab.set("excitation.torque", -40.0)
    for time in (0.1, 0.3):
        tab.run("window.page.mechanism.set(arguments[0])", time)
        fin, nut = tab.run("['fin_angle', 'nut_position'].map(name => window.page.live.run.outputs[name]["
                              "Math.round(arguments[0] / STEP)])", time)
        turned = float(tab.run(PART.format("fin")).removeprefix("rotate(").rstrip(")"))
        assert turned == pytest.approx(-degrees(fin))
        assert abs(turned) > 2.0
        # The picture of a rigid lever follows equation (2.5), both from the angle and from the displacement.
        arm, initial = 0.05, radians(5.0)
        at = float(tab.run(PART.format("nut")).removeprefix("translate(").partition(" ")[0])
        assert at == pytest.approx(55.0 * (nut / arm + tan(initial)))
        assert at == pytest.approx(55.0 * tan(fin + initial))
        # The cursor of every plot over time is at the same row; a pixel is narrower than a row.
        under = tab.run("window.page.plots.map(({chart}) => chart.data[0][chart.cursor.idx])")
        np.testing.assert_allclose(under, time, atol=1.5e-3)
        assert tab.run("document.querySelector('.mechanism [type=range]').value") == f"{time}"
    # Conversely, a cursor in a plot moves the mechanism.
    tab.run("(({chart}) => chart.setCursor({left: chart.valToPos(0.2, 'x'), top: 10}))(window.page.plots[0])")
    assert tab.run("window.page.mechanism.time") == pytest.approx(0.2, abs=1.5e-3)


def show_mechanism(browser: Browser, model: str, folder: Path, time: float) -> dict[str, float]:
    """Open the page of an actuator under load, show its mechanism at a time [s], and return the outputs then."""
    browser.open(write_page(folder, model), "#B=excitation.torque%3D-40")
    browser.run("window.page.mechanism.set(arguments[0])", time)
    row: dict[str, float] = browser.run("Object.fromEntries(Object.entries(window.page.live.run.outputs).map("
                                        "([name, column]) => [name, column[Math.round(arguments[0] / STEP)]]))", time)
    assert browser.complaints == []
    return row


def check_mesh(wheel: str, worm: str, teeth: int, fin_angle: float) -> None:
    """Assert that a tooth is at the fin's angle, and that teeth and threads at the bottom are half a pitch apart."""
    begins = [[float(x) for x in each.split(" L")[0].split()] for each in wheel.split("M")[1:]]
    angles = np.array([np.arctan2(x, y) for x, y in begins])  # as the lever's: 0 at the bottom, positive to the right
    turn = 2.0 * np.pi / teeth
    assert np.min(np.abs(angles - fin_angle)) < 1e-9
    threads = np.array([float(each.split()[0]) for each in worm.split("M")[1:]])  # next to the wheel
    np.testing.assert_allclose(np.diff(threads), 38.0 * turn)
    apart = np.min(np.abs(threads[:, None] - 38.0 * angles), axis=0)[np.abs(angles) < 0.5]
    np.testing.assert_allclose(apart, 19.0 * turn, rtol=1e-9)


def test_worm_and_wheel_mesh_at_any_angle(tab: Browser) -> None:
    """A positive fin angle moves the bottom of the wheel to the right, like the lever's end of other drives."""
    for fin_angle in (0.0, 0.02, -0.3):
        wheel, screw = tab.run("(part => { part.show({fin_angle: arguments[0], motor_angle: 30 * arguments[0]}, "
                                  "{'worm.teeth': 60, 'worm.starts': 2}); return ['nut wheel', 'worm'].map(name => "
                                  "part.shapes.find(shape => shape.getAttribute('class') === name)"
                                  ".getAttribute('d')); })(worm())", fin_angle)
        check_mesh(wheel, screw, 60, fin_angle)


def test_worm_shows_the_motor_angle_and_wheel_the_fin_angle(browser: Browser, tmp_path: Path) -> None:
    row = show_mechanism(browser, "worm-gear", tmp_path, 0.085)
    teeth, starts = (load_parameters(model="worm-gear").values[f"worm.{name}"] for name in ("teeth", "starts"))
    # The gear is rigid, hence the picture's teeth mesh.
    assert row["motor_angle"] * starts / teeth == pytest.approx(row["fin_angle"])
    wheel, worm = browser.run("['wheel', 'worm'].map(part => document.querySelector(`.mechanism .${part}`)."
                              "getAttribute('d'))")
    check_mesh(wheel, worm, int(teeth), row["fin_angle"])


@pytest.mark.parametrize("model", ["electrohydraulic", "electrohydrostatic"])
def test_cylinder_shows_piston_position_and_pressures(browser: Browser, model: str, tmp_path: Path) -> None:
    row = show_mechanism(browser, model, tmp_path, 0.075)
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
    """Return the button that plays and pauses, scrolled into view."""
    browser.run("document.querySelector('.mechanism').scrollIntoView({block: 'center'})")
    return browser.driver.find_element("css selector", ".mechanism button")


def test_mechanism_plays_and_pauses(tab: Browser) -> None:
    button = player(tab)
    button.click()
    assert button.text == "Pause"
    tab.wait("window.page.mechanism.time > 0.02 && window.page.mechanism.time < 0.5")
    button.click()
    assert button.text == "Play"
    at = tab.run("window.page.mechanism.time")
    tab.settle()
    assert tab.run("window.page.mechanism.time") == at


def test_mechanism_does_not_play_with_reduced_motion(tab: Browser) -> None:
    def reduce(value: str) -> None:
        tab.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {
            "features": [{"name": "prefers-reduced-motion", "value": value}]})

    button = player(tab)
    button.click()
    try:
        reduce("reduce")
        tab.settle()
        assert not button.is_displayed()
        assert tab.run("window.page.mechanism.playing") is None
    finally:
        reduce("")


def choose_file(browser: Browser, path: Path) -> None:
    """Choose a CSV file as excitation, and wait for all computations."""
    browser.driver.find_element("id", "file").send_keys(str(path))
    browser.wait(f"window.page.live.setting.file?.title === '{path.name}'")
    browser.run_and_finish("window.page.refresh()")


def test_link_restores_the_csv_files(tab: Browser, tmp_path: Path) -> None:
    state = ("[window.page.kept, window.page.live].map(each => [each.setting.values, each.setting.file.title, "
             "[...each.run.outputs.fin_angle]])")
    for name, angle in (("one.csv", 0.1), ("zwei ä&=.csv", -0.05)):
        path = tmp_path / name
        path.write_text(f"time,fin_command\n0,0\n0.1,{angle}\n0.4,{angle}\n", encoding="utf-8")
        choose_file(tab, path)
        if name == "one.csv":
            tab.run("window.page.keep()")
    before, link = tab.run(state), tab.run("location.hash")
    assert before[0][2] != before[1][2]
    tab.open(DEFAULT_PAGE, link)
    tab.wait("window.page.live?.run")
    assert tab.run(state) == before
    assert tab.run("document.getElementById('notes').textContent") == ""


def test_csv_file_that_is_too_long_for_a_link_is_reported(tab: Browser, tmp_path: Path) -> None:
    noise = np.random.default_rng(1).uniform(-0.1, 0.1, 8001)
    path = tmp_path / "long.csv"
    path.write_text("time,fin_command\n" + "".join(f"{k / 10_000},{x!r}\n" for k, x in enumerate(noise.tolist())),
                    encoding="utf-8")
    choose_file(tab, path)
    assert "csv=" not in tab.run("location.hash").replace("kind%3Dcsv", "")
    tab.run("(Object.defineProperty(navigator, 'clipboard', {configurable: true, "
               "value: {writeText: async () => 0}}), null)")
    tab.run("document.getElementById('link').click()")
    tab.wait("document.getElementById('copied').textContent")
    assert "too long" in tab.run("document.getElementById('copied').textContent")
    tab.open(DEFAULT_PAGE, "#B=excitation.kind%3Dcsv&B.csv=AAAA")
    tab.wait("document.getElementById('notes').textContent")
    assert "CSV file of B is not readable" in tab.run("document.getElementById('notes').textContent")
