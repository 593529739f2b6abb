"""A page in a browser: interactive charts, and static pictures without scripts and on paper."""

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
from emcas_fmu.pages.page import write_page
from emcas_fmu.pages.provenance import Source
from emcas_fmu.parameters import load_parameters
from emcas_fmu.plotting import plots
from emcas_fmu.studies.compare.sets import Column, SetComparison
from tests.explore.browser import Browser, chromium
from tests.looks.looks import contrast

PANELS = "charts[0].panels"
A4 = 687  # px between the margins of an upright A4 page


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with chromium() as browser:
        yield browser


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A page with one figure of two panels over time; the upper panel has two curves and a limit."""
    with plots.style():
        figure, grid = plots.figure(2, sharex=True)
        time = np.linspace(0.0, 400.0, 801)
        grid[0, 0].plot(time, 10.0 * (1.0 - np.exp(-time / 40.0)), label="fin angle")
        grid[0, 0].plot(time, 0.01 * time, label="model")
        grid[0, 0].axhline(10.0, label="required", **plots.LIMIT)
        grid[0, 0].set(ylabel="fin angle [deg]", xlim=(0.0, 400.0))
        grid[1, 0].plot(time, np.sin(time / 20.0))
        grid[1, 0].set(xlabel="time [ms]", ylabel="current [A]")
        plots.legend_above(grid[0, 0])
        picture = plots.picture(figure, "Step", "A step.")
    path = tmp_path_factory.mktemp("page") / "page.html"
    write_page(path, "pages/picture.html.j2", [Source("parameters", "mine.toml", "0" * 64)], picture=picture)
    return path


@pytest.fixture
def charts_page(browser: Browser, page: Path) -> Browser:
    browser.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": "", "features": []})
    browser.size(1400)
    browser.load(page)
    browser.wait("charts.length === 1")
    return browser


def drag(browser: Browser, start: tuple[float, float], end: tuple[float, float]) -> None:
    """Press, move and release the mouse; positions are fractions of the upper panel, from its upper left corner."""
    box = browser.run("(r => [r.left, r.top, r.width, r.height])"
                      "(document.querySelector('.u-over').getBoundingClientRect())")
    for kind, (x, y) in (("mouseMoved", start), ("mousePressed", start), ("mouseMoved", end), ("mouseReleased", end)):
        browser.driver.execute_cdp_cmd("Input.dispatchMouseEvent", {
            "type": kind, "x": box[0] + x * box[2], "y": box[1] + y * box[3], "button": "left", "clickCount": 1})


def test_charts_replace_the_picture(charts_page: Browser) -> None:
    assert charts_page.run("getComputedStyle(document.querySelector('.still')).display") == "none"
    assert charts_page.run("[...document.querySelectorAll('.toggles button')].map(b => b.textContent)") == [
        "fin angle", "model", "required", "whole range"]
    assert charts_page.run("document.querySelector('.panel').getAttribute('aria-label')") == (
        "fin angle [deg] against time [ms]; fin angle, model")
    assert charts_page.complaints == []


def test_dragging_zooms_both_panels_and_a_button_zooms_out(charts_page: Browser) -> None:
    drag(charts_page, (0.25, 0.4), (0.5, 0.42))
    for scale in charts_page.run(f"{PANELS}.map(p => [p.plot.scales.x.min, p.plot.scales.x.max])"):
        assert scale == pytest.approx([100.0, 200.0], abs=1.0)  # a pixel is about 0.4 ms
    assert charts_page.run("document.querySelector('.reset').hidden") is False
    charts_page.run("document.querySelector('.reset').click()")
    assert charts_page.run(f"{PANELS}.map(p => [p.plot.scales.x.min, p.plot.scales.x.max])") == [[0, 400], [0, 400]]


def test_last_number_of_an_axis_is_not_cut_off(charts_page: Browser) -> None:
    """The number is centred at the end of the axis: half of it is outside the frame."""
    half, margin = charts_page.run(
        "(plot => { plot.ctx.save(); plot.ctx.font = FONT; const half = plot.ctx.measureText('0.0125').width / 2; "
        f"plot.ctx.restore(); return [half, plot.width - plot.bbox.left - plot.bbox.width]; }})({PANELS}[1].plot)")
    assert half <= margin


def test_cursor_shows_time_and_values(charts_page: Browser) -> None:
    drag(charts_page, (0.5, 0.5), (0.5, 0.5))
    assert not charts_page.run("document.querySelector('.read').hidden")
    time, angle, model = (float(re.findall(r"[\d.]+", text)[0]) for text in charts_page.run(
        "[...document.querySelector('.read').children].map(row => row.textContent)"))
    assert time == pytest.approx(200.0, abs=0.5)
    # Five digits of values that are stored to 1/20000 of the axis.
    assert angle == pytest.approx(10.0 * (1.0 - np.exp(-time / 40.0)), abs=1e-3)
    assert model == pytest.approx(0.01 * time, abs=1e-3)


def test_button_of_a_curve_shows_and_hides_it(charts_page: Browser) -> None:
    switch = "[...document.querySelectorAll('.toggles button')].find(b => b.textContent === 'model')"
    for shown in (False, True):
        charts_page.run(f"{switch}.click()")
        assert charts_page.run(f"{PANELS}[0].plot.series[2].show") is shown
        assert charts_page.run(f"{switch}.getAttribute('aria-pressed')") == str(shown).lower()


def test_without_scripts_the_picture_and_its_text_are_shown(browser: Browser, page: Path) -> None:
    browser.driver.execute_cdp_cmd("Emulation.setScriptExecutionDisabled", {"value": True})
    try:
        browser.load(page)
    finally:
        browser.driver.execute_cdp_cmd("Emulation.setScriptExecutionDisabled", {"value": False})
    assert browser.run("typeof charts") == "undefined"
    text = browser.run("document.querySelector('.still').innerText")  # displayed text only
    assert {"fin angle [deg]", "time [ms]", "required"} <= set(text.split("\n"))


def test_printed_page_has_the_picture_in_black(charts_page: Browser) -> None:
    charts_page.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {
        "media": "print", "features": [{"name": "prefers-color-scheme", "value": "dark"}]})
    charts_page.size(A4)
    look = "getComputedStyle(document.querySelector('{}')).{}"
    assert charts_page.run(look.format(".still", "display")) != "none"
    assert charts_page.run(look.format(".live", "display")) == "none"
    assert charts_page.run(look.format("body", "color")) == "rgb(0, 0, 0)"
    assert charts_page.run("document.querySelector('.still svg').getBoundingClientRect().width") <= A4
    paper = base64.b64decode(charts_page.driver.execute_cdp_cmd("Page.printToPDF", {"preferCSSPageSize": True})["data"])
    assert len(re.findall(rb"/Type\s*/Page\b", paper)) == 1


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_contrast_of_text_is_sufficient(charts_page: Browser, scheme: str) -> None:
    """WCAG 2.1 (1.4.3) requires 4.5 to 1."""
    charts_page.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {
        "features": [{"name": "prefers-color-scheme", "value": scheme}]})

    def color(selector: str, style: str) -> list[int]:
        # A canvas converts every notation of a colour to bytes.
        rgba: list[int] = charts_page.run(
            "(() => { const c = document.createElement('canvas').getContext('2d'); c.fillStyle = "
            f"getComputedStyle(document.querySelector('{selector}')).{style}; c.fillRect(0, 0, 1, 1); "
            "return [...c.getImageData(0, 0, 1, 1).data]; })()")
        assert rgba[3] == 255 or style == "color"
        return rgba

    back = color("body", "backgroundColor")
    if scheme == "dark":  # also curves and bars, some of which are paler on a light page
        curve = "document.querySelector('.toggles i').style.setProperty('color', '{}')"
        for name in (*plots.COLORS, plots.GRAY):
            charts_page.run(curve.format(name.replace(plots.BLUE, "var(--blue)")))
            assert contrast(color(".toggles i", "color"), back) >= 4.5, name
        assert charts_page.run(f"{PANELS}[0].plot.series[1].stroke()") == charts_page.run("css('--blue')") != plots.BLUE
    for selector in ("body", "figcaption", ".about td", ".toggles button"):
        assert contrast(color(selector, "color"), back) >= 4.5, selector


@pytest.fixture(scope="module")
def simulation_page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("simulate") / "step.html"
    result = CliRunner().invoke(app, ["simulate", "--step", "10", "--plot", str(path)], env={"SOURCE_DATE_EPOCH": "0"})
    assert result.exit_code == 0, result.output
    return path


def test_printed_tables_fit_the_page_and_repeat_their_headings(browser: Browser, simulation_page: Path) -> None:
    browser.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": "print", "features": []})
    browser.size(A4)
    browser.load(simulation_page)
    assert set(browser.run("[...document.querySelectorAll('.wide thead')].map(e => getComputedStyle(e).display)")) == {
        "table-header-group"}
    assert browser.run("[...document.querySelectorAll('table')].filter(e => e.scrollWidth > document.body.clientWidth)"
                       ".length") == 0


def test_contents_link_to_every_section(browser: Browser, simulation_page: Path) -> None:
    browser.load(simulation_page)
    listed = browser.run("[...document.querySelectorAll('nav.contents a')].map(a => "
                         "document.querySelector(a.getAttribute('href')).textContent)")
    assert listed == browser.run("[...document.querySelectorAll('h2')].map(h => h.textContent)")
    assert listed[-1] == "How this page was made"


def test_page_explains_the_opposite_signs_of_its_errors(simulation_page: Path) -> None:
    text = simulation_page.read_text("utf-8")
    assert "is the clipped command minus the angle, the steady error the angle minus the command" in text


@pytest.fixture(scope="module")
def comparison_page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A page that compares five actuators, each with a met, a missed and a not judged requirement."""
    parameters = load_parameters()
    names = ["nonlinear", "worm-gear", "electrohydraulic", "elastic", "servo"]
    rows = [Judged("review", f"figure_{n}", f"Error held against a load, case {n}", value, "<=", 0.2, "deg",
                   skipped=value is None, how="largest distance from the command over the last third of the hold")
            for n, value in enumerate((0.1234, 0.2345, None))]
    path = tmp_path_factory.mktemp("compare") / "page.html"
    columns = tuple(Column(name, parameters, tuple(rows), {}) for name in names)
    write_page(path, "studies/compare/page.html.j2", [parameters], result=SetComparison(columns), pictures=[])
    return path


@pytest.fixture(scope="module")
def requirements_page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A page with a table of a met and a missed requirement."""
    path = tmp_path_factory.mktemp("requirements") / "page.html.j2"
    path.write_text('{% extends "pages/base.html.j2" %}{% block body %}<h1>Judged</h1>{{ m.sources(rows) }}'
                    "{% endblock %}", encoding="utf-8")
    rows = [Judged("review", "rate", "Rate of a 40 deg slew against 100 N.m", value, ">=", 200.0, "deg/s",
                   how="mean over the middle four fifths of the travel, the worse of both directions")
            for value in (214.4, 153.7)]
    write_page(path.with_suffix(""), path, [Source("parameters", "mine.toml")], rows=rows)
    return path.with_suffix("")


@pytest.mark.parametrize(("fixture", "width"), [
    ("requirements_page", 400), ("comparison_page", 400), ("comparison_page", 1400)])
def test_verdicts_are_visible_without_horizontal_scrolling(
        browser: Browser, fixture: str, width: int, request: pytest.FixtureRequest) -> None:
    browser.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": "", "features": []})
    browser.size(width)
    browser.load(request.getfixturevalue(fixture))
    right = browser.run("[...document.querySelectorAll('.wide .pass, .wide .fail, .wide .skip')]"
                        ".map(e => e.getBoundingClientRect().right)")
    assert len(right) == (2 if fixture == "requirements_page" else 15)
    assert max(right) <= width
    if fixture == "comparison_page":
        assert browser.run("[...document.querySelectorAll('.wide')].every(e => e.scrollWidth <= e.clientWidth)")


def test_scrolling_table_has_keyboard_focus_and_the_page_a_landmark(browser: Browser, requirements_page: Path) -> None:
    """WCAG 2.1 (2.1.1, 1.3.1) requires both."""
    browser.size(400)
    browser.load(requirements_page)
    boxes = "[...document.querySelectorAll('main *')].filter(e => e.scrollWidth > e.clientWidth + 1 && " \
            "['auto', 'scroll'].includes(getComputedStyle(e).overflowX))"
    assert browser.run(f"{boxes}.map(e => [e.tabIndex, e.getAttribute('role'), e.getAttribute('aria-label')])") == [
        [0, "region", "Table 1. Requirements: review"]]
    assert browser.run("[...document.body.children].map(e => e.tagName)") == ["MAIN"]
    assert browser.run("[...document.querySelectorAll('th')].filter(e => !e.textContent.trim()).length") == 0


@pytest.mark.parametrize("width", [400, 1400])
def test_page_is_not_wider_than_its_window(charts_page: Browser, width: int) -> None:
    charts_page.size(width)
    charts_page.wait(f"{PANELS}[0].plot.width <= {width}")
    assert charts_page.run("document.documentElement.scrollWidth") <= width
