"""A page with figures in a browser: curves that answer, and what stays without a script and on paper."""

from __future__ import annotations

import base64
import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from emcas_fmu.bench.verdict import Judged
from emcas_fmu.cli import app
from emcas_fmu.figures import plots
from emcas_fmu.pages.page import write_page
from emcas_fmu.pages.provenance import Source
from emcas_fmu.parameters import load_parameters
from emcas_fmu.studies.compare.sets import Column, Result
from tests.explore.browser import Browser, chromium
from tests.looks.looks import contrast

CURVES = "charts[0].panels"
A4 = 687  # px between the margins of a page on end


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with chromium() as opened:
        yield opened


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A page of one figure: two panels over one time, the upper one with two curves and a limit."""
    with plots.style():
        made, grid = plots.figure(2, sharex=True)
        time = np.linspace(0.0, 400.0, 801)
        grid[0, 0].plot(time, 10.0 * (1.0 - np.exp(-time / 40.0)), label="fin angle")
        grid[0, 0].plot(time, 0.01 * time, label="model")
        grid[0, 0].axhline(10.0, label="required", **plots.LIMIT)
        grid[0, 0].set(ylabel="fin angle [deg]", xlim=(0.0, 400.0))
        grid[1, 0].plot(time, np.sin(time / 20.0))
        grid[1, 0].set(xlabel="time [ms]", ylabel="current [A]")
        plots.legend_above(grid[0, 0])
        shown = plots.picture(made, "Step", "A step.")
    path = tmp_path_factory.mktemp("page") / "page.html"
    write_page(path, "pages/picture.html.j2", [Source("parameters", "mine.toml", "0" * 64)], picture=shown)
    return path


@pytest.fixture
def opened(browser: Browser, page: Path) -> Browser:
    browser.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": "", "features": []})
    browser.size(1400)
    browser.load(page)
    browser.wait("charts.length === 1")
    return browser


def drag(browser: Browser, start: tuple[float, float], end: tuple[float, float]) -> None:
    """Press, move and let go, in shares of the upper panel from its left upper corner."""
    box = browser.run("(r => [r.left, r.top, r.width, r.height])"
                      "(document.querySelector('.u-over').getBoundingClientRect())")
    for kind, (x, y) in (("mouseMoved", start), ("mousePressed", start), ("mouseMoved", end), ("mouseReleased", end)):
        browser.driver.execute_cdp_cmd("Input.dispatchMouseEvent", {
            "type": kind, "x": box[0] + x * box[2], "y": box[1] + y * box[3], "button": "left", "clickCount": 1})


def test_curves_take_the_place_of_the_picture(opened: Browser) -> None:
    assert opened.run("getComputedStyle(document.querySelector('.still')).display") == "none"
    assert opened.run("[...document.querySelectorAll('.toggles button')].map(b => b.textContent)") == [
        "fin angle", "model", "required", "whole range"]
    assert opened.run("document.querySelector('.panel').getAttribute('aria-label')") == (
        "fin angle [deg] against time [ms]; fin angle, model")
    assert opened.complaints == []


def test_dragging_zooms_every_panel_of_the_time_and_a_button_zooms_out(opened: Browser) -> None:
    drag(opened, (0.25, 0.4), (0.5, 0.42))
    for scale in opened.run(f"{CURVES}.map(p => [p.plot.scales.x.min, p.plot.scales.x.max])"):
        # A pixel of 1000 is 0.4 ms.
        assert scale == pytest.approx([100.0, 200.0], abs=1.0)
    assert opened.run("document.querySelector('.reset').hidden") is False
    opened.run("document.querySelector('.reset').click()")
    assert opened.run(f"{CURVES}.map(p => [p.plot.scales.x.min, p.plot.scales.x.max])") == [[0, 400], [0, 400]]


def test_the_last_number_of_an_axis_is_not_cut(opened: Browser) -> None:
    """It is centred at the end of the axis, so that half of it is beside the frame."""
    half, beside = opened.run(
        "(plot => { plot.ctx.save(); plot.ctx.font = FONT; const half = plot.ctx.measureText('0.0125').width / 2; "
        f"plot.ctx.restore(); return [half, plot.width - plot.bbox.left - plot.bbox.width]; }})({CURVES}[1].plot)")
    assert half <= beside


def test_the_cursor_reads_values(opened: Browser) -> None:
    drag(opened, (0.5, 0.5), (0.5, 0.5))
    assert not opened.run("document.querySelector('.read').hidden")
    at, angle, model = (float(re.findall(r"[\d.]+", text)[0]) for text in opened.run(
        "[...document.querySelector('.read').children].map(row => row.textContent)"))
    assert at == pytest.approx(200.0, abs=0.5)
    # Five digits are shown, of values kept to 1/20000 of the axis.
    assert angle == pytest.approx(10.0 * (1.0 - np.exp(-at / 40.0)), abs=1e-3)
    assert model == pytest.approx(0.01 * at, abs=1e-3)


def test_a_name_switches_its_curve(opened: Browser) -> None:
    switch = "[...document.querySelectorAll('.toggles button')].find(b => b.textContent === 'model')"
    for shown in (False, True):
        opened.run(f"{switch}.click()")
        assert opened.run(f"{CURVES}[0].plot.series[2].show") is shown
        assert opened.run(f"{switch}.getAttribute('aria-pressed')") == str(shown).lower()


def test_without_a_script_the_picture_stays_with_its_words(browser: Browser, page: Path) -> None:
    browser.driver.execute_cdp_cmd("Emulation.setScriptExecutionDisabled", {"value": True})
    try:
        browser.load(page)
    finally:
        browser.driver.execute_cdp_cmd("Emulation.setScriptExecutionDisabled", {"value": False})
    assert browser.run("typeof charts") == "undefined"
    words = browser.run("document.querySelector('.still').innerText")  # of what is displayed
    assert {"fin angle [deg]", "time [ms]", "required"} <= set(words.split("\n"))


def test_paper_gets_the_picture_in_dark_ink(opened: Browser) -> None:
    opened.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {
        "media": "print", "features": [{"name": "prefers-color-scheme", "value": "dark"}]})
    opened.size(A4)
    look = "getComputedStyle(document.querySelector('{}')).{}"
    assert opened.run(look.format(".still", "display")) != "none"
    assert opened.run(look.format(".live", "display")) == "none"
    assert opened.run(look.format("body", "color")) == "rgb(0, 0, 0)"
    assert opened.run("document.querySelector('.still svg').getBoundingClientRect().width") <= A4
    paper = base64.b64decode(opened.driver.execute_cdp_cmd("Page.printToPDF", {"preferCSSPageSize": True})["data"])
    assert len(re.findall(rb"/Type\s*/Page\b", paper)) == 1


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_text_stands_out(opened: Browser, scheme: str) -> None:
    """4.5 to 1, as WCAG 2.1 (1.4.3) asks of text."""
    opened.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {
        "features": [{"name": "prefers-color-scheme", "value": scheme}]})

    def color(selector: str, what: str) -> list[int]:
        # A canvas turns every notation of a colour into bytes.
        shown: list[int] = opened.run(
            "(() => { const c = document.createElement('canvas').getContext('2d'); c.fillStyle = "
            f"getComputedStyle(document.querySelector('{selector}')).{what}; c.fillRect(0, 0, 1, 1); "
            "return [...c.getImageData(0, 0, 1, 1).data]; })()")
        assert shown[3] == 255 or what == "color"
        return shown

    back = color("body", "backgroundColor")
    if scheme == "dark":  # curves and bars, too; on a light page some are paler
        curve = "document.querySelector('.toggles i').style.setProperty('color', '{}')"
        for each in (*plots.COLORS, plots.GRAY):
            opened.run(curve.format(each.replace(plots.BLUE, "var(--blue)")))
            assert contrast(color(".toggles i", "color"), back) >= 4.5, each
        drawn = opened.run("charts[0].panels[0].plot.series[1].stroke()")
        assert drawn == opened.run("css('--blue')") != plots.BLUE
    for selector in ("body", "figcaption", ".about td", ".toggles button"):
        assert contrast(color(selector, "color"), back) >= 4.5, selector


@pytest.fixture(scope="module")
def simulated(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("simulated") / "step.html"
    result = CliRunner().invoke(app, ["simulate", "--step", "10", "--plot", str(path)], env={"SOURCE_DATE_EPOCH": "0"})
    assert result.exit_code == 0, result.output
    return path


def test_tables_on_paper_keep_columns_and_headings(browser: Browser, simulated: Path) -> None:
    browser.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": "print", "features": []})
    browser.size(A4)
    browser.load(simulated)
    assert set(browser.run("[...document.querySelectorAll('.wide thead')].map(e => getComputedStyle(e).display)")) == {
        "table-header-group"}
    assert browser.run("[...document.querySelectorAll('table')].filter(e => e.scrollWidth > document.body.clientWidth)"
                       ".length") == 0


def test_contents_lead_to_every_section(browser: Browser, simulated: Path) -> None:
    browser.load(simulated)
    listed = browser.run("[...document.querySelectorAll('nav.contents a')].map(a => "
                         "document.querySelector(a.getAttribute('href')).textContent)")
    assert listed == browser.run("[...document.querySelectorAll('h2')].map(h => h.textContent)")
    assert listed[-1] == "How this page was made"


def test_errors_of_opposite_sign_say_so(simulated: Path) -> None:
    assert "tracking error is command minus angle, the steady error angle minus command" in simulated.read_text("utf-8")


@pytest.fixture(scope="module")
def compared(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The page of five actuators, each with requirements met, missed and not judged."""
    parameters = load_parameters()
    names = ["nonlinear", "worm-gear", "electrohydraulic", "elastic", "servo"]
    found = [Judged("review", f"figure_{n}", f"Error held against a load, case {n}", value, "<=", 0.2, "deg",
                    skipped=value is None, how="largest distance from the command over the last third of the hold")
             for n, value in enumerate((0.1234, 0.2345, None))]
    path = tmp_path_factory.mktemp("compared") / "page.html"
    columns = tuple(Column(name, parameters, tuple(found), {}) for name in names)
    write_page(path, "studies/compare/page.html.j2", [parameters], result=Result(columns), pictures=[])
    return path


@pytest.fixture(scope="module")
def judged(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A table of requirements as pages have it."""
    path = tmp_path_factory.mktemp("judged") / "page.html.j2"
    path.write_text('{% extends "pages/base.html.j2" %}{% block body %}<h1>Judged</h1>{{ m.sources(rows) }}'
                    "{% endblock %}", encoding="utf-8")
    rows = [Judged("review", "rate", "Rate of a 40 deg slew against 100 N.m", value, ">=", 200.0, "deg/s",
                   how="mean over the middle four fifths of the travel, the worse of both directions")
            for value in (214.4, 153.7)]
    write_page(path.with_suffix(""), path, [Source("parameters", "mine.toml")], rows=rows)
    return path.with_suffix("")


@pytest.mark.parametrize(("shown", "width"), [("judged", 400), ("compared", 400), ("compared", 1400)])
def test_verdicts_are_seen_without_scrolling_sideways(
        browser: Browser, shown: str, width: int, request: pytest.FixtureRequest) -> None:
    browser.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": "", "features": []})
    browser.size(width)
    browser.load(request.getfixturevalue(shown))
    right = browser.run("[...document.querySelectorAll('.wide .pass, .wide .fail, .wide .skip')]"
                        ".map(e => e.getBoundingClientRect().right)")
    assert len(right) == (2 if shown == "judged" else 15)
    assert max(right) <= width
    if shown == "compared":
        assert browser.run("[...document.querySelectorAll('.wide')].every(e => e.scrollWidth <= e.clientWidth)")


def test_what_scrolls_has_the_keyboards_focus(browser: Browser, judged: Path) -> None:
    """All of a page is in a landmark, too, as WCAG asks (2.1.1, 1.3.1)."""
    browser.size(400)
    browser.load(judged)
    boxes = "[...document.querySelectorAll('main *')].filter(e => e.scrollWidth > e.clientWidth + 1 && " \
            "['auto', 'scroll'].includes(getComputedStyle(e).overflowX))"
    assert browser.run(f"{boxes}.map(e => [e.tabIndex, e.getAttribute('role'), e.getAttribute('aria-label')])") == [
        [0, "region", "Table 1. Requirements: review"]]
    assert browser.run("[...document.body.children].map(e => e.tagName)") == ["MAIN"]
    assert browser.run("[...document.querySelectorAll('th')].filter(e => !e.textContent.trim()).length") == 0


@pytest.mark.parametrize("width", [400, 1400])
def test_no_page_wider_than_its_window(opened: Browser, width: int) -> None:
    opened.size(width)
    opened.wait(f"{CURVES}[0].plot.width <= {width}")
    assert opened.run("document.documentElement.scrollWidth") <= width
