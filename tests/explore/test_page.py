"""The page in a browser has the kernel's numbers, and can be used with mouse, keyboard, link and file."""

from __future__ import annotations

import importlib.util
import re
import warnings
from math import radians
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from emcas_fmu.actuators import NAMES, capabilities, get
from emcas_fmu.api import simulate
from emcas_fmu.bench.excitation import csv_file
from emcas_fmu.bench.linear.actuator import LinearActuator, sound
from emcas_fmu.bench.linear.frequency import margins
from emcas_fmu.cli import app
from emcas_fmu.errors import EmcasWarning
from emcas_fmu.parameters import check_combinations, check_parameters, load_parameters
from emcas_fmu.simulation import simulate as simulate_one
from tests.hosts.host import missing
from tests.marks import slow
from tests.own_actuator.example import MODEL as DIRECT_DRIVE
from tests.tools.test_every_actuator import TOGETHER

from .browser import DEFAULT_PAGE, Browser, write_page
from .test_linear import check_margins

MODELS = (*NAMES, DIRECT_DRIVE, *TOGETHER)
SETTING = "excitation.kind=slew&excitation.amplitude=0.15&excitation.torque=-40"
STEP = 1e-3


def slew(browser: Browser, path: Path) -> tuple[np.ndarray[Any, Any], np.ndarray[Any, Any]]:
    """Open a page with a slew under load, and return inputs and outputs over time."""
    browser.open(path, "#" + "B=" + SETTING.replace("=", "%3D").replace("&", "%26"))
    assert browser.complaints == []
    run = browser.run("(({live: {setting, run}}) => { const inputs = setting.inputs(run.excitation); return {rows: "
                      "run.excitation.time.length, inputs: DATA.inputs.map(({name}) => typeof inputs[name] === "
                      "'object' ? [...inputs[name]] : Number(inputs[name])), outputs: DATA.outputs.map(name => "
                      "[...run.outputs[name]])}; })(window.page)")
    table = np.column_stack([np.broadcast_to(column, run["rows"]) for column in run["inputs"]])
    return table, np.array(run["outputs"]).T


def check_kernel(model: str, table: np.ndarray[Any, Any], found: np.ndarray[Any, Any]) -> None:
    """Assert that outputs have the bits of the compiled kernel."""
    inputs = dict(zip((v.name for v in get(model).inputs), table.T, strict=True))
    _, *columns = simulate_one(load_parameters(model=model).values, (len(table) - 1) * STEP, STEP, "compiled", model,
                               **inputs).values()
    np.testing.assert_array_equal(found, np.column_stack(columns))


def test_outputs_have_the_bits_of_the_kernel(browser: Browser) -> None:
    table, found = slew(browser, DEFAULT_PAGE)
    assert np.ptp(found[:, 0]) > radians(1.0)
    check_kernel("nonlinear", table, found)


@pytest.mark.slow  # zig makes its C library for a browser: a minute, once
@pytest.mark.parametrize("model", MODELS, ids=lambda model: Path(model).stem)
def test_outputs_and_margins_of_every_actuator(browser: Browser, model: str, tmp_path: Path) -> None:
    """One test compares both, because zig needs ten seconds for a page with many extensions."""
    if importlib.util.find_spec("ziglang") is None:
        missing("there is no ziglang (pip install ziglang)")
    path = write_page(tmp_path, model)
    assert path.stat().st_size < 1_000_000
    table, found = slew(browser, path)
    assert np.ptp(found[:, 0]) > radians(1.0) or "homing" in model  # an actuator with homing first finds its zero
    check_kernel(model, table, found)
    if capabilities.POSITION_LOOP in get(model).provides:
        homed = sound(load_parameters(model=model))
        check_margins(browser, margins(LinearActuator(homed.values, model=homed.model).loop("reference")))
        assert browser.complaints == []


SLOW = pytest.mark.slow
WRONG = (
    {"motor.resistance": 0.0, "drive.kp": 1e9}, {"controller.sample_time": 0.1, "solver.max_tick": 1e-7},
    *(pytest.param(changes, marks=SLOW) for changes in (
        {"controller.position.kp": -1.0}, {"fin.stop_angle": 0.2}, {"friction.coulomb.positive[1]": 0.9},
        {"fin.start_angle": 1.2}, {"drive.transport_delay": 0.1}, {"command.latency": 1.9})),
)


@pytest.mark.parametrize("changes", WRONG, ids=lambda changes: next(iter(changes)))
def test_wrong_parameters_have_the_packages_messages(tab: Browser, changes: dict[str, float]) -> None:
    for name, value in changes.items():
        tab.set(name, value)
    expected = check_parameters({**load_parameters().values, **changes})
    assert expected
    assert tab.run("[...document.querySelectorAll('#problems p')].map(p => p.textContent)") == expected
    assert tab.run("document.body.classList.contains('stale')")
    for name in changes:
        tab.set(name, None)
    assert tab.run("document.getElementById('problems').textContent") == ""


def test_warnings_are_those_of_the_rules(tab: Browser) -> None:
    tab.set("friction.temperature", -40.0)
    values = {**load_parameters().values, "friction.temperature": -40.0}
    warnings = tab.run("[...document.querySelectorAll('#warnings p')].map(p => p.textContent)")
    assert warnings == check_combinations(values, get("nonlinear"), warnings=True)
    assert warnings


@pytest.mark.parametrize("width", [pytest.param(320, marks=SLOW), 400, pytest.param(768, marks=SLOW), 1400])
def test_no_element_is_wider_than_the_window(tab: Browser, width: int) -> None:
    tab.size(width)
    tab.settle()
    tab.driver.find_element("id", "search").send_keys("friction")  # opens a long list
    tab.run("document.getElementById('keep').click()")
    tab.settle()
    wide = tab.run("[...document.querySelectorAll('body *')].filter(e => !e.closest('.wide') && "
                      "e.getBoundingClientRect().right > innerWidth + 0.5).map(e => e.outerHTML.slice(0, 80))")
    assert wide == []
    assert tab.run("document.documentElement.scrollWidth") <= width


def test_key_moves_a_slider_and_changes_the_response(tab: Browser) -> None:
    from selenium.webdriver.common.keys import Keys

    name = "controller.position.kp"
    before = tab.run("[window.page.live.setting.get(arguments[0]), window.page.live.figures.rise_time]", name)
    slider = tab.driver.find_element("css selector", f"[data-name='{name}'] input[type=range]")
    tab.run("arguments[0].focus()", slider)
    slider.send_keys(Keys.ARROW_RIGHT * 20)
    tab.settle()
    after = tab.run("[window.page.live.setting.get(arguments[0]), window.page.live.figures.rise_time]", name)
    step = 3 * before[0] / 200  # the range is three times the initial value; the first key rounds up to a step
    assert after[0] == pytest.approx(before[0] + 20 * step, abs=step)
    assert after[1] < before[1]
    assert slider.get_attribute("aria-valuetext").endswith("1/s")


SLIDER = ("(s => [s.checkVisibility(), Number(s.min), Number(s.value), Number(s.max)])"
          "(document.querySelector(`[data-name='${arguments[0]}'] input[type=range]`))")


def test_sliders_end_within_the_limits_and_show_their_value(tab: Browser) -> None:
    values = tab.run("Object.fromEntries(window.page.controls.filter(each => each.range).map("
                        "({control, factor}) => [control.name, window.page.live.setting.get(control.name) / factor]))")
    assert {"excitation.torque", "supply_voltage", "controller.position.kp"} <= values.keys()
    for name, value in values.items():
        visible, least, at, most = tab.run(SLIDER, name)
        assert least <= value <= most, name
        assert not visible or at == pytest.approx(value, abs=(most - least) / 200)
    tab.set("controller.position.kp", -5.0)
    assert tab.run(SLIDER, "controller.position.kp")[1] == 0.0
    tab.set("controller.position.kp", None)
    # A value of 0 gives no range; a typed value creates a range, which remains.
    assert not tab.run(SLIDER, "controller.load_observer")[0]
    tab.set("controller.load_observer", 40.0)
    assert tab.run(SLIDER, "controller.load_observer") == [True, 0.0, pytest.approx(40.0, abs=0.6), 120.0]
    tab.set("controller.load_observer", 0.0)
    assert tab.run(SLIDER, "controller.load_observer") == [True, 0.0, 0.0, 120.0]


def type_text(browser: Browser, name: str, text: str) -> str:
    """Type a text in the field beside a slider, and return the page's error message."""
    from selenium.webdriver.common.keys import Keys

    field = browser.driver.find_element("css selector", f"[data-name='{name}'] input[type=text]")
    field.send_keys(Keys.CONTROL + "a")
    field.send_keys(text + Keys.TAB)
    browser.settle()
    message: str = browser.run("document.getElementById('problems').textContent")
    return message


def test_accepted_value_extends_the_slider_until_reset(tab: Browser) -> None:
    name = "controller.position.kp"
    before = tab.run(SLIDER, name)
    assert "is above its maximum 100000" in type_text(tab, name, "1e6")
    assert type_text(tab, name, "53.8") == ""
    assert tab.run(SLIDER, name)[1::2] == before[1::2]
    assert type_text(tab, name, "400") == ""
    assert tab.run(SLIDER, name)[1:] == [0.0, 400.0, 400.0]
    tab.run("document.getElementById('reset').click()")
    tab.settle()
    assert tab.run(SLIDER, name) == before


def test_slider_of_the_temperature_covers_the_friction_table(tab: Browser) -> None:
    assert tab.run(SLIDER, "friction.temperature")[1::2] == [-40.0, 71.0]


@pytest.mark.parametrize(("text", "message"), [
    ("10 deg", "excitation.amplitude: '10 deg' is not a number; the unit is °"),
    ("abc", "excitation.amplitude: 'abc' is not a number; the unit is °"),
])
def test_text_that_is_no_number_is_an_error(tab: Browser, text: str, message: str) -> None:
    assert type_text(tab, "excitation.amplitude", text) == message
    assert tab.run("document.getElementById('first-excitation.amplitude').value") == text
    assert type_text(tab, "excitation.amplitude", "10") == ""


@pytest.mark.parametrize("command", [10.0, 0.4, 0.3])
def test_warning_about_a_large_command_is_that_of_simulate(tab: Browser, tmp_path: Path, command: float) -> None:
    path = tmp_path / "mine.csv"
    path.write_text(f"time,fin_command\n0,0\n0.1,{command}\n", encoding="utf-8")
    tab.driver.find_element("id", "file").send_keys(str(path))
    tab.wait("window.page.live.setting.kind === 'csv' && window.page.live.run")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", EmcasWarning)
        expected = simulate(excitation=csv_file(path)).warnings
    assert bool(expected) == (command > 0.35)  # command.limit is 20 deg
    assert (*tab.run("window.page.live.warnings"),) == expected


def test_statuses_and_flags_are_shown_by_name(tab: Browser) -> None:
    panel = {"names": ["word"], "items": [], "bits": ["stall", "no_drive"], "shown": ["", 1]}
    assert tab.run("[0, 1, 3].map(toWords(arguments[0]))", panel) == ["none", "stall", "stall, no drive"]
    found = tab.run("traces(arguments[0], {word: [0, 2, 3]}, [1]).map(({label, y}) => [label, y])", panel)
    assert found == [["no drive", [0.0, 0.6, 0.6]]]
    status = {"items": ["idle", "homing"], "bits": []}
    assert tab.run("[1, 2].map(toWords(arguments[0]))", status) == status["items"]


def test_speeds_are_in_rpm_and_frequency_axes_end_with_the_data(tab: Browser) -> None:
    tab.run_and_finish("window.page.refresh()")
    shown = tab.run("DATA.panels.find(({names}) => names[0] === 'motor_speed').shown")
    assert shown == ["rpm", pytest.approx(np.pi / 30.0)]
    tab.run("window.page.bode[0].redraw()")  # the chart is out of view
    tab.settle()
    ends, last = tab.run("(({chart}) => [chart.scales.x.max, chart.data[0].at(-1)])(window.page.bode[0])")
    assert ends == last


@pytest.mark.parametrize("width", [400, pytest.param(1400, marks=SLOW)])
def test_error_is_visible_at_every_scroll_position(tab: Browser, width: int) -> None:
    tab.size(width)
    tab.set("motor.resistance", 0.0)
    for place in ("0", "document.body.scrollHeight / 2", "document.body.scrollHeight"):
        tab.run(f"scrollTo(0, {place})")
        box = tab.run("(b => [b.top, b.bottom, b.height])(document.getElementById('problems')."
                         "getBoundingClientRect())")
        assert 0 <= box[0] < box[1] <= 900.5
        assert box[2] > 10


def test_stored_setting_without_its_file_is_a_warning(tab: Browser) -> None:
    tab.open(DEFAULT_PAGE, "#A=excitation.kind%3Dcsv&B=")
    assert "A is not shown: choose a CSV file" in tab.run("document.getElementById('warnings').textContent")
    assert tab.run("document.getElementById('problems').textContent") == ""


def test_every_control_has_a_label_and_the_natural_tab_order(tab: Browser) -> None:
    tab.run_and_finish("window.page.refresh()")
    unnamed = tab.run("[...document.querySelectorAll('input, select, button')].filter(e => !(e.labels?.length || "
                         "e.getAttribute('aria-label') || e.textContent.trim())).map(e => e.outerHTML)")
    assert unnamed == []
    assert tab.run("[...document.querySelectorAll('[tabindex]')].every(e => e.tabIndex <= 0)")
    assert tab.run("[...document.querySelectorAll('[role=img]')].every("
                      "e => e.getAttribute('aria-label').length > 20)")
    assert tab.run("document.querySelector('[aria-live]').textContent").startswith("rise time")


def test_typed_value_changes_the_command_and_can_be_reset(tab: Browser) -> None:
    from selenium.webdriver.common.keys import Keys

    row = tab.driver.find_element("css selector", "[data-name='excitation.amplitude']")
    field = row.find_element("css selector", "input[type=text]")
    field.send_keys(Keys.CONTROL + "a")
    field.send_keys("5,5" + Keys.TAB)
    tab.settle()
    assert tab.run("window.page.live.run.excitation.columns.fin_command.at(-1)") == pytest.approx(radians(5.5))
    row.find_element("css selector", ".again").click()
    tab.settle()
    assert tab.run("window.page.live.run.excitation.columns.fin_command.at(-1)") == radians(10.0)


def test_link_restores_both_settings(tab: Browser) -> None:
    tab.set("motor.resistance", 0.3)
    tab.run("window.page.keep()")
    tab.set("excitation.kind", "sine")
    tab.set("friction.temperature", -6.0)
    tab.run_and_finish("window.page.refresh()")
    state = ("[window.page.kept, window.page.live].map(each => [each.setting.values, each.figures.peak_current])")
    before, link = tab.run(state), tab.run("location.hash")
    tab.open(DEFAULT_PAGE, link)
    assert tab.run(state) == before
    assert tab.run("document.getElementById('notes').textContent") == ""
    tab.open(DEFAULT_PAGE, re.sub("of=.{4}", "of=0000", link))
    assert "another page" in tab.run("document.getElementById('notes').textContent")


@pytest.mark.parametrize("value", [0.3, *slow("not a number")], ids=["sound", "unsound"])
def test_link_copied_immediately_after_a_change_has_the_new_value(tab: Browser, value: Any) -> None:
    """One script does both, so that the page cannot update its address in between."""
    tab.run_and_finish("window.page.refresh()")
    before = tab.run("location.hash")
    copied = tab.run("""(value => {
        let copied = null;
        Object.defineProperty(navigator, "clipboard", {configurable: true, value: {
            writeText: async text => { copied = text; }}});
        window.page.change("motor.resistance", value);
        document.getElementById("link").click();
        return copied;
    })(arguments[0])""", value)
    assert copied.partition("#")[2] not in ("", before.lstrip("#"))
    tab.open(DEFAULT_PAGE, "#" + copied.partition("#")[2])
    assert tab.run("window.page.live.setting.get('motor.resistance')") == (0.3 if value == 0.3 else 0.25)
    assert ("unknown to this page" in tab.run("document.getElementById('notes').textContent")) is (value != 0.3)


def test_simulate_gives_the_same_response_from_the_saved_files(tab: Browser, tmp_path: Path,
                                                  monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    for name, value in {"excitation.kind": "slew", "excitation.torque": -60.0, "controller.position.kp": 70.0,
                        "supply_voltage": 34.0, "angular_rate.x": 1.0, "encoder.enabled": False}.items():
        tab.set(name, value)
    for name, script in {"parameters.toml": "parameterFile(window.page.live.setting)",
                         "inputs.csv": "csv(window.page.inputs())",
                         "response.csv": "csv({...window.page.inputs(), ...window.page.live.run.outputs})"}.items():
        Path(name).write_text(tab.run(script), encoding="utf-8")
    done = CliRunner().invoke(app, ["simulate", "--input", "inputs.csv", "-p", "parameters.toml", "-o", "again.csv"])
    assert done.exit_code == 0, done.output
    found, again = (Path(name).read_text(encoding="utf-8").splitlines() for name in ("response.csv", "again.csv"))
    assert found[0] == again[0]
    one, other = (np.array([line.split(",") for line in lines[1:]], dtype=float) for lines in (found, again))
    np.testing.assert_array_equal(one, other)


def test_file_saved_immediately_after_a_change_has_the_new_value(tab: Browser) -> None:
    """Leaving a field by pressing a button changes the value and saves before the next frame."""
    saved = tab.run("""(buttons => {
        const files = {}, before = window.save;
        window.save = (name, text) => { files[name] = text; };
        for (const amplitude of [0.1, "not a number"]) {
            window.page.change("excitation.amplitude", amplitude);
            for (const name of buttons) document.getElementById(`save-${name}`).click();
        }
        window.save = before;
        return files;
    })(arguments[0])""", ["inputs", "response"])
    inputs, response = (saved[f"{name}.csv"].splitlines() for name in ("inputs", "response"))
    assert inputs[0] == "time,fin_command"
    assert float(inputs[-1].split(",")[1]) == 0.1  # the last value that has a response
    assert len(response) == len(inputs)
    assert response[0].startswith("time,fin_command,fin_angle")


def test_csv_file_is_the_excitation(tab: Browser, tmp_path: Path) -> None:
    path = tmp_path / "mine.csv"
    path.write_text("time,fin_command,aero_torque\n0,0,0\n0.1,0.1,-20\n0.4,0.1,-20\n", encoding="utf-8")
    tab.driver.find_element("id", "file").send_keys(str(path))
    tab.wait("window.page.live.setting.kind === 'csv' && window.page.live.run")
    assert tab.run("document.getElementById('file-name').textContent") == "mine.csv"
    assert tab.run("window.page.live.run.outputs.fin_angle.at(-1)") == pytest.approx(0.1, abs=radians(0.5))
    path.write_text("time,nonsense\n0,0\n1,1\n", encoding="utf-8")
    tab.driver.find_element("id", "file").send_keys(str(path))
    tab.wait("document.getElementById('problems').textContent")
    assert "mine.csv: nonsense is not an input" in tab.run("document.getElementById('problems').textContent")


def test_two_settings_are_shown_side_by_side(tab: Browser) -> None:
    tab.run("window.page.keep()")
    tab.set("excitation.torque", -80.0)
    tab.run_and_finish("window.page.refresh()")
    heads = tab.run("[...document.querySelectorAll('#figures thead th')].map(e => e.textContent)")
    assert heads == ["figure", "A, kept", "B, live", "definition"]
    kept, live = tab.run("[window.page.kept, window.page.live].map(each => each.figures.steady_error)")
    assert abs(kept) < abs(live)
    labels = tab.run("[...document.querySelectorAll('#main-plot .u-label')].map(e => e.textContent)")
    assert {"fin angle A", "fin angle B", "command"} <= set(labels)


def test_worker_does_the_long_computations(tab: Browser) -> None:
    """The page itself computes no response meanwhile, and would have the same results."""
    tab.driver.execute_script("""const {actuator} = window.page, run = actuator.run;
        window.runs = 0;
        actuator.run = function(...of) { ++window.runs; return run.apply(this, of); };""")
    tab.run_and_finish("Object.assign(window.page.live, {verdicts: null, responses: null}); window.page.refresh()")
    assert tab.run("[window.runs, window.page.live.verdicts.size > 20]") == [0, True]
    own, worked = tab.driver.execute_async_script("""const done = arguments[0], {page} = window;
        const {setting} = page.live, here = COMPUTATIONS.measured(page.actuator, setting);
        Promise.all([here, page.background.ask("measured", setting)]).then(both =>
            done(both.map(each => JSON.stringify(each))));""")
    assert own == worked
    assert len(own) > 1000


def test_page_computes_requirements_bode_plot_and_link_after_a_pause(tab: Browser) -> None:
    tab.set("controller.position.kp", 61.0)
    assert tab.run("document.body.classList.contains('waiting')")
    tab.wait("!document.body.classList.contains('waiting')")
    assert tab.run("window.page.live.verdicts.size > 20")
    assert "position.kp" in tab.run("location.hash")


def test_later_computation_ends_the_earlier_one(tab: Browser) -> None:
    tab.run_and_finish("window.page.refresh()")
    answers = tab.driver.execute_async_script("""const done = arguments[0], {page} = window, answered = [];
        page.background.ask("measured", page.live.setting).then(() => answered.push("first"));
        page.background.ask("responses", page.live.setting).then(() => answered.push("second"));
        setTimeout(() => page.background.ask("responses", page.live.setting).then(
            () => done([...answered, "third"])), 1);
        """)
    assert answers[-1] == "third"
    assert "first" not in answers


def test_change_ends_a_running_computation(tab: Browser) -> None:
    """No result then belongs to another setting, and the moving slider does not wait."""
    tab.run_and_finish("window.page.refresh()")
    ended = tab.run("""(({page}, {terminate}) => {
        const ended = [];
        page.background.ask("measured", page.live.setting);
        const asked = page.background.worker;
        Worker.prototype.terminate = function() { ended.push(this === asked); terminate.call(this); };
        page.change("controller.position.kp", 61);
        Worker.prototype.terminate = terminate;
        return ended;
    })(window, Worker.prototype)""")
    assert ended == [True]


def test_plot_is_updated_when_it_is_scrolled_into_view(tab: Browser) -> None:
    tab.run("scrollTo(0, 0)")
    tab.settle()
    tab.set("excitation.amplitude", 0.1)
    assert tab.run("window.page.bode[0].waiting !== null || !window.page.bode[0].uplot")
    tab.run("document.getElementById('bode').scrollIntoView()")
    tab.run_and_finish("window.page.refresh()")
    assert tab.run("window.page.bode[0].waiting === null && window.page.bode[0].uplot.data[0].length > 10")


def test_page_loads_no_other_file(tab: Browser) -> None:
    tab.open(DEFAULT_PAGE)
    assert tab.run("performance.getEntriesByType('resource').map(entry => entry.name)") == []
    assert not re.search(r"""(src|href)\s*=\s*["']https?:""", DEFAULT_PAGE.read_text(encoding="utf-8"))
