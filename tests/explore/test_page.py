"""The page in a browser: the same numbers as the kernel's, and usable by hand, keyboard, link and file."""

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

from .browser import SHOWN, Browser, written
from .test_linear import check_margins

MODELS = (*NAMES, DIRECT_DRIVE, *TOGETHER)
SETTING = "excitation.kind=slew&excitation.amplitude=0.15&excitation.torque=-40"
STEP = 1e-3


def computed(browser: Browser, path: Path) -> tuple[np.ndarray[Any, Any], np.ndarray[Any, Any]]:
    """Return the inputs and the outputs of a slew under load, as a page has them."""
    browser.open(path, "#" + "B=" + SETTING.replace("=", "%3D").replace("&", "%26"))
    assert browser.complaints == []
    run = browser.run("(({live: {setting, run}}) => { const inputs = setting.inputs(run.excitation); return {rows: "
                      "run.excitation.time.length, inputs: DATA.inputs.map(({name}) => typeof inputs[name] === "
                      "'object' ? [...inputs[name]] : Number(inputs[name])), outputs: DATA.outputs.map(name => "
                      "[...run.outputs[name]])}; })(window.page)")
    table = np.column_stack([np.broadcast_to(column, run["rows"]) for column in run["inputs"]])
    return table, np.array(run["outputs"]).T


def check_kernel(model: str, table: np.ndarray[Any, Any], found: np.ndarray[Any, Any]) -> None:
    """Fail unless outputs are the compiled kernel's to the bit."""
    inputs = dict(zip((v.name for v in get(model).inputs), table.T, strict=True))
    _, *columns = simulate_one(load_parameters(model=model).values, (len(table) - 1) * STEP, STEP, "compiled", model,
                               **inputs).values()
    np.testing.assert_array_equal(found, np.column_stack(columns))


def test_numbers_are_the_kernel_s(browser: Browser) -> None:
    table, found = computed(browser, SHOWN)
    assert np.ptp(found[:, 0]) > radians(1.0)
    check_kernel("nonlinear", table, found)


@pytest.mark.slow  # zig makes its C library for a browser: a minute, once
@pytest.mark.parametrize("model", MODELS, ids=lambda model: Path(model).stem)
def test_numbers_of_every_actuator_are_the_kernel_s(browser: Browser, model: str, tmp_path: Path) -> None:
    """Its margins are compared here, too, since zig needs ten seconds for a page of many extensions."""
    if importlib.util.find_spec("ziglang") is None:
        missing("there is no ziglang (pip install ziglang)")
    path = written(tmp_path, model)
    assert path.stat().st_size < 1_000_000
    table, found = computed(browser, path)
    assert np.ptp(found[:, 0]) > radians(1.0) or "homing" in model  # which begins by looking for its zero
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
def test_what_the_kernel_refuses_is_refused_in_its_words(opened: Browser, changes: dict[str, float]) -> None:
    for name, value in changes.items():
        opened.set(name, value)
    said = opened.run("[...document.querySelectorAll('#problems p')].map(p => p.textContent)")
    expected = check_parameters({**load_parameters().values, **changes})
    assert expected
    assert said == expected
    assert opened.run("document.body.classList.contains('stale')")
    for name in changes:
        opened.set(name, None)
    assert opened.run("document.getElementById('problems').textContent") == ""


def test_warnings_are_the_rules_own(opened: Browser) -> None:
    opened.set("friction.temperature", -40.0)
    values = {**load_parameters().values, "friction.temperature": -40.0}
    said = opened.run("[...document.querySelectorAll('#warnings p')].map(p => p.textContent)")
    assert said == check_combinations(values, get("nonlinear"), warnings=True)
    assert said


@pytest.mark.parametrize("width", [pytest.param(320, marks=SLOW), 400, pytest.param(768, marks=SLOW), 1400])
def test_nothing_is_wider_than_the_window(opened: Browser, width: int) -> None:
    opened.size(width)
    opened.settled()
    opened.driver.find_element("id", "search").send_keys("friction")  # opens a long list
    opened.run("document.getElementById('keep').click()")
    opened.settled()
    wide = opened.run("[...document.querySelectorAll('body *')].filter(e => !e.closest('.wide') && "
                      "e.getBoundingClientRect().right > innerWidth + 0.5).map(e => e.outerHTML.slice(0, 80))")
    assert wide == []
    assert opened.run("document.documentElement.scrollWidth") <= width


def test_a_key_moves_a_slider_and_the_response(opened: Browser) -> None:
    from selenium.webdriver.common.keys import Keys

    name = "controller.position.kp"
    before = opened.run("[window.page.live.setting.get(arguments[0]), window.page.live.figures.rise_time]", name)
    slider = opened.driver.find_element("css selector", f"[data-name='{name}'] input[type=range]")
    opened.run("arguments[0].focus()", slider)
    slider.send_keys(Keys.ARROW_RIGHT * 20)
    opened.settled()
    after = opened.run("[window.page.live.setting.get(arguments[0]), window.page.live.figures.rise_time]", name)
    step = 3 * before[0] / 200  # a slider ends at three times the start; the first key goes to the next step there is
    assert after[0] == pytest.approx(before[0] + 20 * step, abs=step)
    assert after[1] < before[1]
    assert slider.get_attribute("aria-valuetext").endswith("1/s")


SLIDER = ("(s => [s.checkVisibility(), Number(s.min), Number(s.value), Number(s.max)])"
          "(document.querySelector(`[data-name='${arguments[0]}'] input[type=range]`))")


def test_sliders_end_within_the_limits_and_show_their_value(opened: Browser) -> None:
    values = opened.run("Object.fromEntries(window.page.controls.filter(each => each.range).map("
                        "({control, factor}) => [control.name, window.page.live.setting.get(control.name) / factor]))")
    assert {"excitation.torque", "supply_voltage", "controller.position.kp"} <= values.keys()
    for name, value in values.items():
        visible, least, at, most = opened.run(SLIDER, name)
        assert least <= value <= most, name
        assert not visible or at == pytest.approx(value, abs=(most - least) / 200)
    opened.set("controller.position.kp", -5.0)
    assert opened.run(SLIDER, "controller.position.kp")[1] == 0.0
    opened.set("controller.position.kp", None)
    # Three times nothing is no range; a value that is typed makes one, which stays.
    assert not opened.run(SLIDER, "controller.load_observer")[0]
    opened.set("controller.load_observer", 40.0)
    assert opened.run(SLIDER, "controller.load_observer") == [True, 0.0, pytest.approx(40.0, abs=0.6), 120.0]
    opened.set("controller.load_observer", 0.0)
    assert opened.run(SLIDER, "controller.load_observer") == [True, 0.0, 0.0, 120.0]


def typed(browser: Browser, name: str, text: str) -> str:
    """Type a text in the field beside a slider, and return the problems that it makes."""
    from selenium.webdriver.common.keys import Keys

    field = browser.driver.find_element("css selector", f"[data-name='{name}'] input[type=text]")
    field.send_keys(Keys.CONTROL + "a")
    field.send_keys(text + Keys.TAB)
    browser.settled()
    said: str = browser.run("document.getElementById('problems').textContent")
    return said


def test_a_slider_reaches_to_what_is_accepted_until_reset(opened: Browser) -> None:
    name = "controller.position.kp"
    before = opened.run(SLIDER, name)
    assert "is above its maximum 100000" in typed(opened, name, "1e6")
    assert typed(opened, name, "53.8") == ""
    assert opened.run(SLIDER, name)[1::2] == before[1::2]
    assert typed(opened, name, "400") == ""
    assert opened.run(SLIDER, name)[1:] == [0.0, 400.0, 400.0]
    opened.run("document.getElementById('reset').click()")
    opened.settled()
    assert opened.run(SLIDER, name) == before


def test_the_slider_of_the_temperature_covers_the_table_of_friction(opened: Browser) -> None:
    assert opened.run(SLIDER, "friction.temperature")[1::2] == [-40.0, 71.0]


@pytest.mark.parametrize(("text", "said"), [
    ("10 deg", "excitation.amplitude: '10 deg' is not a number; the unit is °"),
    ("abc", "excitation.amplitude: 'abc' is not a number; the unit is °"),
])
def test_a_text_is_no_number(opened: Browser, text: str, said: str) -> None:
    assert typed(opened, "excitation.amplitude", text) == said
    assert opened.run("document.getElementById('first-excitation.amplitude').value") == text
    assert typed(opened, "excitation.amplitude", "10") == ""


@pytest.mark.parametrize("command", [10.0, 0.4, 0.3])
def test_commands_are_warned_of_as_by_simulate(opened: Browser, tmp_path: Path, command: float) -> None:
    path = tmp_path / "mine.csv"
    path.write_text(f"time,fin_command\n0,0\n0.1,{command}\n", encoding="utf-8")
    opened.driver.find_element("id", "file").send_keys(str(path))
    opened.wait("window.page.live.setting.kind === 'csv' && window.page.live.run")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", EmcasWarning)
        expected = simulate(excitation=csv_file(path)).warnings
    assert bool(expected) == (command > 0.35)  # command.limit is 20 deg
    assert (*opened.run("window.page.live.warnings"),) == expected


def test_statuses_and_flags_are_said_by_name(opened: Browser) -> None:
    panel = {"names": ["word"], "items": [], "bits": ["stall", "no_drive"], "shown": ["", 1]}
    assert opened.run("[0, 1, 3].map(toWords(arguments[0]))", panel) == ["none", "stall", "stall, no drive"]
    found = opened.run("traces(arguments[0], {word: [0, 2, 3]}, [1]).map(({label, y}) => [label, y])", panel)
    assert found == [["no drive", [0.0, 0.6, 0.6]]]
    status = {"items": ["idle", "homing"], "bits": []}
    assert opened.run("[1, 2].map(toWords(arguments[0]))", status) == status["items"]


def test_speeds_are_in_rpm_and_frequencies_end_with_the_data(opened: Browser) -> None:
    opened.rested("window.page.refresh()")
    shown = opened.run("DATA.panels.find(({names}) => names[0] === 'motor_speed').shown")
    assert shown == ["rpm", pytest.approx(np.pi / 30.0)]
    opened.run("window.page.bode[0].redraw()")  # it is out of view
    opened.settled()
    ends, last = opened.run("(({chart}) => [chart.scales.x.max, chart.data[0].at(-1)])(window.page.bode[0])")
    assert ends == last


@pytest.mark.parametrize("width", [400, pytest.param(1400, marks=SLOW)])
def test_a_problem_is_seen_wherever_one_has_scrolled_to(opened: Browser, width: int) -> None:
    opened.size(width)
    opened.set("motor.resistance", 0.0)
    for place in ("0", "document.body.scrollHeight / 2", "document.body.scrollHeight"):
        opened.run(f"scrollTo(0, {place})")
        box = opened.run("(b => [b.top, b.bottom, b.height])(document.getElementById('problems')."
                         "getBoundingClientRect())")
        assert 0 <= box[0] < box[1] <= 900.5
        assert box[2] > 10


def test_a_kept_setting_that_cannot_be_shown_is_said(opened: Browser) -> None:
    opened.open(SHOWN, "#A=excitation.kind%3Dcsv&B=")
    assert "A is not shown: choose a CSV file" in opened.run("document.getElementById('warnings').textContent")
    assert opened.run("document.getElementById('problems').textContent") == ""


def test_every_field_has_a_name_and_a_place_in_order(opened: Browser) -> None:
    opened.rested("window.page.refresh()")
    unnamed = opened.run("[...document.querySelectorAll('input, select, button')].filter(e => !(e.labels?.length || "
                         "e.getAttribute('aria-label') || e.textContent.trim())).map(e => e.outerHTML)")
    assert unnamed == []
    assert opened.run("[...document.querySelectorAll('[tabindex]')].every(e => e.tabIndex <= 0)")
    assert opened.run("[...document.querySelectorAll('[role=img]')].every("
                      "e => e.getAttribute('aria-label').length > 20)")
    assert opened.run("document.querySelector('[aria-live]').textContent").startswith("rise time")


def test_a_typed_value_acts_and_is_put_back(opened: Browser) -> None:
    from selenium.webdriver.common.keys import Keys

    row = opened.driver.find_element("css selector", "[data-name='excitation.amplitude']")
    field = row.find_element("css selector", "input[type=text]")
    field.send_keys(Keys.CONTROL + "a")
    field.send_keys("5,5" + Keys.TAB)
    opened.settled()
    assert opened.run("window.page.live.run.excitation.columns.fin_command.at(-1)") == pytest.approx(radians(5.5))
    row.find_element("css selector", ".again").click()
    opened.settled()
    assert opened.run("window.page.live.run.excitation.columns.fin_command.at(-1)") == radians(10.0)


def test_a_link_restores_both_settings(opened: Browser) -> None:
    opened.set("motor.resistance", 0.3)
    opened.run("window.page.keep()")
    opened.set("excitation.kind", "sine")
    opened.set("friction.temperature", -6.0)
    opened.rested("window.page.refresh()")
    state = ("[window.page.kept, window.page.live].map(each => [each.setting.values, each.figures.peak_current])")
    before, link = opened.run(state), opened.run("location.hash")
    opened.open(SHOWN, link)
    assert opened.run(state) == before
    assert opened.run("document.getElementById('notes').textContent") == ""
    opened.open(SHOWN, re.sub("of=.{4}", "of=0000", link))
    assert "another page" in opened.run("document.getElementById('notes').textContent")


@pytest.mark.parametrize("value", [0.3, *slow("not a number")], ids=["sound", "unsound"])
def test_a_link_copied_at_once_is_of_what_is_set(opened: Browser, value: Any) -> None:
    """Within one script, so that no time passes in which the address would follow by itself."""
    opened.rested("window.page.refresh()")
    before = opened.run("location.hash")
    copied = opened.run("""(value => {
        let copied = null;
        Object.defineProperty(navigator, "clipboard", {configurable: true, value: {
            writeText: async text => { copied = text; }}});
        window.page.change("motor.resistance", value);
        document.getElementById("link").click();
        return copied;
    })(arguments[0])""", value)
    assert copied.partition("#")[2] not in ("", before.lstrip("#"))
    opened.open(SHOWN, "#" + copied.partition("#")[2])
    assert opened.run("window.page.live.setting.get('motor.resistance')") == (0.3 if value == 0.3 else 0.25)
    assert ("unknown to this page" in opened.run("document.getElementById('notes').textContent")) is (value != 0.3)


def test_files_give_the_same_response_in_simulate(opened: Browser, tmp_path: Path,
                                                  monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    for name, value in {"excitation.kind": "slew", "excitation.torque": -60.0, "controller.position.kp": 70.0,
                        "supply_voltage": 34.0, "angular_rate.x": 1.0, "encoder.enabled": False}.items():
        opened.set(name, value)
    for name, script in {"parameters.toml": "parameterFile(window.page.live.setting)",
                         "inputs.csv": "csv(window.page.inputs())",
                         "response.csv": "csv({...window.page.inputs(), ...window.page.live.run.outputs})"}.items():
        Path(name).write_text(opened.run(script), encoding="utf-8")
    done = CliRunner().invoke(app, ["simulate", "--input", "inputs.csv", "-p", "parameters.toml", "-o", "again.csv"])
    assert done.exit_code == 0, done.output
    found, again = (Path(name).read_text(encoding="utf-8").splitlines() for name in ("response.csv", "again.csv"))
    assert found[0] == again[0]
    one, other = (np.array([line.split(",") for line in lines[1:]], dtype=float) for lines in (found, again))
    np.testing.assert_array_equal(one, other)


def test_a_file_saved_at_once_is_of_what_is_set(opened: Browser) -> None:
    """A tap beside a field changes its value and presses the button before the next frame."""
    saved = opened.run("""(buttons => {
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


def test_a_csv_file_is_flown(opened: Browser, tmp_path: Path) -> None:
    path = tmp_path / "mine.csv"
    path.write_text("time,fin_command,aero_torque\n0,0,0\n0.1,0.1,-20\n0.4,0.1,-20\n", encoding="utf-8")
    opened.driver.find_element("id", "file").send_keys(str(path))
    opened.wait("window.page.live.setting.kind === 'csv' && window.page.live.run")
    assert opened.run("document.getElementById('file-name').textContent") == "mine.csv"
    assert opened.run("window.page.live.run.outputs.fin_angle.at(-1)") == pytest.approx(0.1, abs=radians(0.5))
    path.write_text("time,nonsense\n0,0\n1,1\n", encoding="utf-8")
    opened.driver.find_element("id", "file").send_keys(str(path))
    opened.wait("document.getElementById('problems').textContent")
    assert "mine.csv: nonsense is not an input" in opened.run("document.getElementById('problems').textContent")


def test_two_settings_stand_side_by_side(opened: Browser) -> None:
    opened.run("window.page.keep()")
    opened.set("excitation.torque", -80.0)
    opened.rested("window.page.refresh()")
    heads = opened.run("[...document.querySelectorAll('#figures thead th')].map(e => e.textContent)")
    assert heads == ["figure", "A, kept", "B, live", "definition"]
    kept, live = opened.run("[window.page.kept, window.page.live].map(each => each.figures.steady_error)")
    assert abs(kept) < abs(live)
    labels = opened.run("[...document.querySelectorAll('#main-plot .u-label')].map(e => e.textContent)")
    assert {"fin angle A", "fin angle B", "command"} <= set(labels)


def test_long_computations_are_in_a_worker(opened: Browser) -> None:
    """The page itself computes no response while the requirements are judged; answers are the same as its own."""
    opened.driver.execute_script("""const {actuator} = window.page, run = actuator.run;
        window.runs = 0;
        actuator.run = function(...of) { ++window.runs; return run.apply(this, of); };""")
    opened.rested("Object.assign(window.page.live, {verdicts: null, responses: null}); window.page.refresh()")
    assert opened.run("[window.runs, window.page.live.verdicts.size > 20]") == [0, True]
    own, worked = opened.driver.execute_async_script("""const done = arguments[0], {page} = window;
        const {setting} = page.live, here = COMPUTATIONS.measured(page.actuator, setting);
        Promise.all([here, page.background.ask("measured", setting)]).then(both =>
            done(both.map(each => JSON.stringify(each))));""")
    assert own == worked
    assert len(own) > 1000


def test_a_page_left_alone_computes_the_rest(opened: Browser) -> None:
    """Requirements, Bode plot and link follow by themselves, once nothing has changed for a while."""
    opened.set("controller.position.kp", 61.0)
    assert opened.run("document.body.classList.contains('waiting')")
    opened.wait("!document.body.classList.contains('waiting')")
    assert opened.run("window.page.live.verdicts.size > 20")
    assert "position.kp" in opened.run("location.hash")


def test_a_later_computation_ends_an_earlier_one(opened: Browser) -> None:
    opened.rested("window.page.refresh()")
    answers = opened.driver.execute_async_script("""const done = arguments[0], {page} = window, answered = [];
        page.background.ask("measured", page.live.setting).then(() => answered.push("first"));
        page.background.ask("responses", page.live.setting).then(() => answered.push("second"));
        setTimeout(() => page.background.ask("responses", page.live.setting).then(
            () => done([...answered, "third"])), 1);
        """)
    assert answers[-1] == "third"
    assert "first" not in answers


def test_a_change_ends_a_computation(opened: Browser) -> None:
    """At once, so that no answer is of another setting, and a slider that moves has the processor."""
    opened.rested("window.page.refresh()")
    ended = opened.run("""(({page}, {terminate}) => {
        const ended = [];
        page.background.ask("measured", page.live.setting);
        const asked = page.background.worker;
        Worker.prototype.terminate = function() { ended.push(this === asked); terminate.call(this); };
        page.change("controller.position.kp", 61);
        Worker.prototype.terminate = terminate;
        return ended;
    })(window, Worker.prototype)""")
    assert ended == [True]


def test_plots_out_of_view_are_drawn_when_they_come_into_it(opened: Browser) -> None:
    opened.run("scrollTo(0, 0)")
    opened.settled()
    opened.set("excitation.amplitude", 0.1)
    assert opened.run("window.page.bode[0].waiting !== null || !window.page.bode[0].uplot")
    opened.run("document.getElementById('bode').scrollIntoView()")
    opened.rested("window.page.refresh()")
    assert opened.run("window.page.bode[0].waiting === null && window.page.bode[0].uplot.data[0].length > 10")


def test_the_page_is_one_file_that_asks_for_nothing(opened: Browser) -> None:
    opened.open(SHOWN)
    assert opened.run("performance.getEntriesByType('resource').map(entry => entry.name)") == []
    assert not re.search(r"""(src|href)\s*=\s*["']https?:""", SHOWN.read_text(encoding="utf-8"))
