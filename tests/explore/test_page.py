"""The page in a browser: the same numbers as the kernel's, and usable by hand, keyboard, link and file."""

from __future__ import annotations

import importlib.util
import json
import platform
import re
import subprocess
import sys
from collections.abc import Iterator
from math import radians
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from emcas_fmu.actuators import NAMES, get
from emcas_fmu.cli import app
from emcas_fmu.compiler import Platform, zig
from emcas_fmu.parameters import check_combinations, check_parameters, load_parameters
from emcas_fmu.runtime.compiled import run_table
from emcas_fmu.studies.explore import page
from tests.hosts.host import missing
from tests.own_actuator.example import MODEL as DIRECT_DRIVE
from tests.tools.test_every_actuator import TOGETHER

from .browser import Browser, chromium, written

# zig makes its C library for a browser, and for the program beside it: a minute each, once.
pytestmark = pytest.mark.slow

MODELS = (*NAMES, DIRECT_DRIVE, *TOGETHER)
SETTING = "excitation.shape=slew&excitation.amplitude=0.15&excitation.load=-40"
STEP = 1e-3


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    if importlib.util.find_spec("ziglang") is None:
        missing("there is no ziglang (pip install ziglang)")
    with chromium() as opened:
        yield opened


@pytest.fixture(scope="module")
def made(browser: Browser, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The default actuator's page."""
    return written(tmp_path_factory.mktemp("page"), "nonlinear")


@pytest.fixture
def opened(browser: Browser, made: Path) -> Browser:
    """The default actuator's page, as it opens."""
    browser.size(1400)
    browser.open(made)
    return browser


def by_program(model: str, values: Any, table: np.ndarray[Any, Any], folder: Path) -> np.ndarray[Any, Any]:
    """Return the outputs of the same C as a program of this machine, with musl's libm as the page's."""
    compiler = zig()
    assert compiler is not None
    sources = {"run.c": (Path(__file__).parent / "run.c").read_text(encoding="utf-8"), **page.sources(model)}
    machine = {"AMD64": "x86_64", "arm64": "aarch64"}.get(platform.machine(), platform.machine())
    target = Platform("musl", "", f"{machine}-linux-musl", ("-static",))
    program = folder / "run"
    program.write_bytes(compiler.library(sources, "run.c", target, "run"))
    program.chmod(0o700)
    numbers = [float(values[v.name]) for v in get(model).parameters] + table.ravel().tolist()
    given = " ".join([str(len(table)), *(x.hex() for x in (STEP, *numbers))])
    done = subprocess.run([program], input=given.encode(), capture_output=True, check=True)
    return np.frombuffer(done.stdout).reshape(len(table), -1)


@pytest.mark.parametrize("model", MODELS, ids=lambda model: Path(model).stem)
def test_numbers_are_the_kernel_s(browser: Browser, model: str, tmp_path: Path) -> None:
    """To the bit of the same C with the same libm; the local libm's last digits grow by the loop's gain."""
    browser.open(written(tmp_path, model), "#" + "B=" + SETTING.replace("=", "%3D").replace("&", "%26"))
    assert browser.complaints == []
    run = browser.run("(({live: {setting, run}}) => { const inputs = setting.inputs(run.excitation); return {rows: "
                      "run.excitation.time.length, inputs: DATA.inputs.map(({name}) => typeof inputs[name] === "
                      "'object' ? [...inputs[name]] : Number(inputs[name])), outputs: DATA.outputs.map(({name}) => "
                      "[...run.outputs[name]])}; })(window.page)")
    table = np.column_stack([np.broadcast_to(column, run["rows"]) for column in run["inputs"]])
    found, values = np.array(run["outputs"]).T, load_parameters(model=model).values
    assert np.ptp(found[:, 0]) > radians(1.0) or "homing" in model  # which begins by looking for its zero
    if sys.platform == "linux":
        np.testing.assert_array_equal(found, by_program(model, values, table, tmp_path))
    kernel = run_table(values, STEP, table, model)
    # Measured up to 3e-11, a pump's voltage; an encoder's count or the end of a stick may fall a row later.
    scale = np.maximum(np.max(np.abs(kernel), axis=0), 1e-300)
    apart = np.max(np.abs(found - kernel) / scale, axis=1)
    assert np.mean(apart < 1e-8) > 0.99


WRONG = (
    {"controller.position.kp": -1.0}, {"motor.resistance": 0.0, "drive.kp": 1e9}, {"fin.stop_angle": 0.2},
    {"friction.coulomb.positive[1]": 0.9}, {"fin.start_angle": 1.2}, {"drive.transport_delay": 0.1},
    {"controller.sample_time": 0.1, "solver.max_tick": 1e-7}, {"command.latency": 1.9},
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


@pytest.mark.parametrize("width", [320, 400, 768, 1400])
def test_nothing_is_wider_than_the_window(opened: Browser, width: int) -> None:
    opened.size(width)
    opened.settled()
    opened.driver.find_element("id", "search").send_keys("friction")  # opens a long list
    opened.rested("document.getElementById('keep').click()")
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


def test_every_field_has_a_name_and_a_place_in_order(opened: Browser) -> None:
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


def test_a_link_restores_both_settings(opened: Browser, made: Path) -> None:
    opened.set("motor.resistance", 0.3)
    opened.run("window.page.keep()")
    opened.set("excitation.shape", "sine")
    opened.set("friction.temperature", -6.0)
    opened.rested("window.page.refresh()")
    state = ("[window.page.kept, window.page.live].map(each => [each.setting.values, each.figures.peak_current, "
             "each.runs.chirp_1deg.frequency.bandwidth])")
    before, link = opened.run(state), opened.run("location.hash")
    opened.open(made, link)
    assert opened.run(state) == before
    assert opened.run("document.getElementById('notes').textContent") == ""
    opened.open(made, re.sub("of=.{4}", "of=0000", link))
    assert "another page" in opened.run("document.getElementById('notes').textContent")
    assert opened.complaints == []


def test_files_give_the_same_response_in_simulate(opened: Browser, tmp_path: Path,
                                                  monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    for name, value in {"excitation.shape": "slew", "excitation.load": -60.0, "controller.position.kp": 70.0,
                        "supply_voltage": 34.0, "angular_rate.x": 1.0, "encoder.enabled": False}.items():
        opened.set(name, value)
    for name, script in {"parameters.toml": "parameterFile(window.page.live.setting)",
                         "inputs.csv": "csv(window.page.inputs())",
                         "response.csv": "csv(window.page.response())"}.items():
        Path(name).write_text(opened.run(script), encoding="utf-8")
    done = CliRunner().invoke(app, ["simulate", "--input", "inputs.csv", "-p", "parameters.toml", "-o", "again.csv"])
    assert done.exit_code == 0, done.output
    found, again = (Path(name).read_text(encoding="utf-8").splitlines() for name in ("response.csv", "again.csv"))
    assert found[0] == again[0]
    one, other = (np.array([line.split(",") for line in lines[1:]], dtype=float) for lines in (found, again))
    # Another libm, as above; without an encoder there is no count that could fall a row later.
    assert np.all(np.abs(one - other) <= 1e-8 * np.max(np.abs(other), axis=0))


def test_a_csv_file_is_flown(opened: Browser, tmp_path: Path) -> None:
    path = tmp_path / "mine.csv"
    path.write_text("time,fin_command,aero_torque\n0,0,0\n0.1,0.1,-20\n0.4,0.1,-20\n", encoding="utf-8")
    opened.driver.find_element("id", "file").send_keys(str(path))
    opened.wait("window.page.live.setting.shape === 'csv' && window.page.live.run")
    assert opened.run("document.getElementById('file-name').textContent") == "mine.csv"
    assert opened.run("window.page.live.run.outputs.fin_angle.at(-1)") == pytest.approx(0.1, abs=radians(0.5))
    path.write_text("time,nonsense\n0,0\n1,1\n", encoding="utf-8")
    opened.driver.find_element("id", "file").send_keys(str(path))
    opened.wait("document.getElementById('problems').textContent")
    assert "mine.csv: nonsense is no input" in opened.run("document.getElementById('problems').textContent")


def test_two_settings_stand_side_by_side(opened: Browser) -> None:
    opened.run("window.page.keep()")
    opened.set("excitation.load", -80.0)
    opened.rested("window.page.refresh()")
    heads = opened.run("[...document.querySelectorAll('#figures-head th')].map(e => e.textContent)")
    assert heads == ["figure", "A, kept", "B, live", "definition"]
    kept, live = opened.run("[window.page.kept, window.page.live].map(each => each.figures.steady_error)")
    assert abs(kept) < abs(live)
    labels = opened.run("[...document.querySelectorAll('#main-plot .u-label')].map(e => e.textContent)")
    assert {"fin angle A", "fin angle B", "command"} <= set(labels)


def test_the_page_is_one_file_that_asks_for_nothing(opened: Browser, made: Path) -> None:
    assert made.stat().st_size < 1_000_000
    assert opened.run("performance.getEntriesByType('resource').map(entry => entry.name)") == []
    assert opened.complaints == []
    text = made.read_text(encoding="utf-8")
    assert not re.search(r"""(src|href)\s*=\s*["']https?:""", text)
    data = json.loads(text.split('id="data">')[1].split("</script>")[0])
    assert [p["name"] for p in data["parameters"]] == [v.name for v in get("nonlinear").parameters]
