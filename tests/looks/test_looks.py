"""Every kind of page looks as approved (narrow and light, wide and dark, printed), and axe finds no violations."""

from __future__ import annotations

import base64
import io
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from PIL import Image, ImageColor

from emcas_fmu.plotting import plots
from tests.docs.recipes import build_site
from tests.explore.browser import Browser
from tests.hosts.host import missing

from .looks import APPROVED, LOOKS, approve, camera, contrast, differences, emulate, open_page, take_picture
from .pages import NAMES, page_path

try:
    from axe_core_python.selenium import Axe
except ImportError:
    Axe = None

pytestmark = [pytest.mark.slow, pytest.mark.drawn]  # 3 minutes
PLANTED: Mapping[str, Mapping[str, tuple[str, str]]] = {  # page, defect: script, words of the difference
    "simulate": {
        "nothing": ("0", ""),
        "column": ("document.querySelectorAll('tr').forEach(row => row.lastElementChild.style.visibility = 'hidden')",
                   "differs in"),
        "chart empty": ("document.querySelectorAll('canvas').forEach(chart => chart.style.visibility = 'hidden')",
                        "differs in"),
        "curves": ("charts[0].panels.forEach(panel => panel.plot.series.slice(1).forEach((_, n) => "
                   "panel.plot.setSeries(n + 1, {show: false})))", "differs in"),
        "picture": ("document.querySelector('figure .live').remove()", "px high"),
        "figure": ("document.querySelector('figure').remove()", "parts, approved"),
        "inverted": ("document.documentElement.style.filter = 'invert(1)'", "differs in")},
    "explore": {
        "nothing": ("0", ""),
        "Nichols chart": ("document.querySelectorAll('#loop canvas')[2].style.visibility = 'hidden'", "differs in"),
        "mechanism": ("document.querySelector('.mechanism svg').style.visibility = 'hidden'", "differs in"),
        "values": ("document.querySelectorAll('#figures td:nth-child(2)').forEach(value => "
                   "value.style.visibility = 'hidden')", "differs in"),
        "row": ("document.querySelectorAll('#figures tr')[2].style.visibility = 'hidden'", "differs in"),
        "verdicts": ("const {style} = $('strip'), colors = getComputedStyle(document.documentElement); "
                     "style.setProperty('--pass', colors.getPropertyValue('--fail')); "
                     "style.setProperty('--fail', colors.getPropertyValue('--pass'))", "differs in")}}


class Findings(NamedTuple):
    """Differences from the approved pictures of a page, and violations of axe's rules, each with its look."""

    differences: list[str]
    violations: list[str]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("looks")


@pytest.fixture(scope="module")
def browser(folder: Path) -> Iterator[Browser]:
    with camera(folder) as browser:
        yield browser


@pytest.fixture(scope="module")
def page(folder: Path, once: Callable[..., Path]) -> Callable[[str], Path]:
    """Function that returns the path of a page."""
    return lambda name: page_path(name, folder, lambda: once("site", build_site))


def violations(browser: Browser) -> list[str]:
    """Return the rules of axe that the open page violates, each with its first element.

    The elements of pictures are removed before: screen readers ignore them, and axe would check them with every rule.
    """
    browser.run("document.querySelectorAll('svg[role=img]').forEach(picture => picture.replaceChildren())")
    rules: list[dict[str, Any]] = Axe().run(browser.driver, options={"resultTypes": ["violations"]})["violations"]
    return [f"{each['id']}, {len(each['nodes'])} elements: {each['nodes'][0]['html'][:200]}" for each in rules]


@pytest.fixture(scope="module", params=NAMES)
def findings(request: pytest.FixtureRequest, browser: Browser, folder: Path, page: Callable[[str], Path]) -> Findings:
    name, result = request.param, Findings([], [])
    for look in LOOKS:
        open_page(browser, page(name), look)
        picture, parts = take_picture(browser)
        if texts := differences(picture, parts, APPROVED / f"{name}_{look}.png"):
            new = folder / f"{name}_{look}.png"
            picture.save(new)
            result.differences.append(f"{look}: {'; '.join(texts)}; new picture: {new}")
        for scheme in ("light", "dark") if Axe and look != "print" else ():
            emulate(browser, "screen", scheme)
            browser.settle()
            result.violations.extend(f"{look}, {scheme}: {each}" for each in violations(browser))
    return result


def test_page_looks_as_approved(findings: Findings) -> None:
    """If a change is intended and the new pictures are right, approve them: python -m tests.looks NAME."""
    assert not findings.differences, "\n".join(findings.differences)


def test_axe_finds_no_violation(findings: Findings) -> None:
    if Axe is None:
        missing("there is no axe (pip install axe-core-python)")
    assert not findings.violations, "\n".join(findings.violations)


@pytest.mark.parametrize("look", ["400_light", "1400_dark"])
@pytest.mark.parametrize(("name", "defect"), [(name, defect) for name, each in PLANTED.items() for defect in each])
def test_planted_defect_is_a_difference(browser: Browser, folder: Path, page: Callable[[str], Path], look: str,
                                        name: str, defect: str) -> None:
    approved, (script, words) = folder / f"planted_{name}_{look}.png", PLANTED[name][defect]
    if not approved.is_file():
        open_page(browser, page(name), look)
        approve(*take_picture(browser), approved)
    open_page(browser, page(name), look)
    browser.run(f"(() => {{ {script}; }})()")
    browser.settle()
    texts = differences(*take_picture(browser), approved)
    assert any(words in text for text in texts) if words else not texts, texts


def test_colours_of_figures_have_enough_contrast_on_dark_pages(browser: Browser, page: Callable[[str], Path]) -> None:
    """The page inverts pictures: white becomes the page's background, and every colour has a contrast of 4.5 to it."""
    colors, side = [ImageColor.getrgb(name)[:3] for name in ("#ffffff", *plots.COLORS, plots.GRAY)], 20
    picture, data = Image.new("RGB", (side * len(colors), side)), io.BytesIO()
    for n, color in enumerate(colors):
        picture.paste(color, (side * n, 0, side * (n + 1), side))
    picture.save(data, "png")
    open_page(browser, page("models"), "1400_dark")
    x, y = browser.run("(async image => { image.src = arguments[0]; image.style.width = `${arguments[1]}px`;"
                       "await image.decode(); const box = image.getBoundingClientRect();"
                       "return [box.left, box.top + scrollY]; })(document.querySelector('article img'))",
                       f"data:image/png;base64,{base64.b64encode(data.getvalue()).decode()}", picture.width)
    shown = np.asarray(take_picture(browser)[0])
    paper, *curves = shown[round(y + 0.5 * side), [round(x + side * (n + 0.5)) for n in range(len(colors))]].tolist()
    assert paper == shown[round(y), round(x) - 5].tolist()
    assert min(contrast(curve, paper) for curve in curves) >= 4.5
