"""The site: built without a warning, complete, and with nothing loaded from elsewhere."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from lxml import etree, html
from typer.main import get_command

import emcas_fmu
from docs.thesis.entries import ENTRIES
from emcas_fmu.actuators import NAMES
from emcas_fmu.cli import app
from emcas_fmu.fmi.interface import FmuInterface

from .recipes import ROOT, build_site

pytestmark = pytest.mark.slow  # a minute or more; tests/docs/test_links.py looks for dead links in the files


@pytest.fixture(scope="module")
def site(once: Callable[..., Path]) -> Path:
    return once("site", build_site)


@pytest.fixture(scope="module")
def pages(site: Path) -> dict[str, etree._Element]:
    """Return the pages by their place, but actuators to move and the thesis's, which are no pages of MkDocs."""
    places = [path.relative_to(site) for path in site.rglob("*.html") if path.name != "404.html"]
    return {place.as_posix(): html.fromstring((site / place).read_text(encoding="utf-8"))
            for place in places if place.parent.name not in ("explore", "thesis")}


def test_every_page_is_in_the_navigation(site: Path, pages: dict[str, etree._Element]) -> None:
    front = pages["index.html"]
    linked = {(site / href).resolve() for href in front.xpath("//nav//a[contains(@class, 'md-nav__link')]/@href")}
    assert {site / page for page in pages} - linked == set()
    written = {path.relative_to(ROOT / "docs") for path in (ROOT / "docs").rglob("*.md")}
    expected = {path.with_name("index.md") if path.name == "README.md" else path for path in written}
    assert {path.with_suffix(".html").as_posix() for path in expected} <= set(pages)


def test_titles_and_alternative_texts(pages: dict[str, etree._Element]) -> None:
    titles = [page.findtext(".//title") for page in pages.values()]
    assert all(titles)
    for name, page in pages.items():
        assert len(page.xpath("//article//h1")) == 1, name
        assert not page.xpath("//img[not(@alt) or normalize-space(@alt) = '']"), name


def test_nothing_is_loaded_from_elsewhere(site: Path, pages: dict[str, etree._Element]) -> None:
    for name, page in pages.items():
        loaded = page.xpath("//script/@src | //link/@href | //*[self::img or self::iframe or self::source]/@src")
        assert [source for source in loaded if re.match(r"(https?:)?//", source)] == [], name
    for style in site.rglob("*.css"):
        text = style.read_text(encoding="utf-8")
        assert re.findall(r"(?:url\(|@import )['\"]?(?:https?:)?//[^)]*", text) == [], style


def test_no_block_is_broken(pages: dict[str, etree._Element]) -> None:
    """What the usual hosts take for a list, a table or code, MkDocs does too: no mark is left in the text."""
    for name, page in pages.items():
        texts = [" ".join(p.itertext()) for p in page.xpath("//article//p")]
        marks = re.compile(r"(?m)^\s*(?:[-*] |\| |```|:::)|:(?:mod|class|meth):|``")
        assert [text for text in texts if marks.search(text)] == [], name


def test_every_name_of_the_interface_is_documented(pages: dict[str, etree._Element]) -> None:
    headings = pages["reference/python.html"].xpath("//article//h2/@id")
    assert {f"emcas_fmu.api.{name}" for name in emcas_fmu.__all__} == set(headings)


def test_every_command_is_documented(pages: dict[str, etree._Element]) -> None:
    page = pages["reference/commands.html"]
    sections = set(page.xpath("//article//h2/@id"))
    text = " ".join(page.xpath("//article")[0].itertext())
    group: Any = get_command(app)
    commands = group.commands.items()
    assert {f"emcas-{name}" for name, _ in commands} <= sections
    for _, command in commands:
        assert all(option in text for param in command.params for option in param.opts if option.startswith("-"))


def test_every_variable_of_the_fmus_is_documented(pages: dict[str, etree._Element]) -> None:
    shown = set(pages["reference/fmu.html"].xpath("//article//td[1]/code/text()"))
    units = [FmuInterface(1, name) for name in NAMES]
    assert {variable.name for unit in units for variable in unit.variables} - shown == set()


def test_every_actuator_can_be_moved(site: Path, pages: dict[str, etree._Element]) -> None:
    linked = [href for href in pages["reference/fmu.html"].xpath("//article//a/@href") if "/explore/" in href]
    assert linked == [f"../explore/{name}.html" for name in NAMES]
    for name in NAMES:
        shown = html.fromstring((site / "explore" / f"{name}.html").read_text(encoding="utf-8"))
        assert name in shown.findtext(".//title")
        assert len(shown.xpath("//script[@id='actuator']")) == 1


def test_the_thesis_is_gone_through(site: Path, pages: dict[str, etree._Element]) -> None:
    assert "../thesis/thesis.html" in pages["tools/thesis.html"].xpath("//article//a/@href")
    shown = html.fromstring((site / "thesis/thesis.html").read_text(encoding="utf-8"))
    assert set(shown.xpath("//nav[@class='entries']/a/@title")) == {entry.title for entry in ENTRIES}
    assert "python -m docs.thesis --output thesis.html" in " ".join(shown.itertext())
    assert [path.name for path in (site / "thesis").iterdir()] == ["thesis.html"]


def test_source_files_are_no_links(pages: dict[str, etree._Element]) -> None:
    for name, page in pages.items():
        links = page.xpath("//article//a/@href")
        assert not [href for href in links if re.search(r"^[^:]*\.(py|c|toml|yml|md|ipynb)$", href)], name


def test_the_notebook_shows_its_pictures(pages: dict[str, etree._Element]) -> None:
    assert len(pages["examples/notebook/first_steps.html"].xpath("//article//img")) >= 3
