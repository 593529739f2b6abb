"""The site is built without a warning, is complete, and loads nothing from other hosts."""

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
    """Return MkDocs' pages by path: all except those of `emcas explore` and of the thesis."""
    paths = [path.relative_to(site) for path in site.rglob("*.html") if path.name != "404.html"]
    return {path.as_posix(): html.fromstring((site / path).read_text(encoding="utf-8"))
            for path in paths if path.parent.name not in ("explore", "thesis")}


def test_every_page_is_in_the_navigation(site: Path, pages: dict[str, etree._Element]) -> None:
    front = pages["index.html"]
    linked = {(site / href).resolve() for href in front.xpath("//nav//a[contains(@class, 'md-nav__link')]/@href")}
    assert {site / page for page in pages} - linked == set()
    written = {path.relative_to(ROOT / "docs") for path in (ROOT / "docs").rglob("*.md")}
    expected = {path.with_name("index.md") if path.name == "README.md" else path for path in written}
    assert {path.with_suffix(".html").as_posix() for path in expected} <= set(pages)


def test_pages_have_titles_and_pictures_alternative_texts(pages: dict[str, etree._Element]) -> None:
    for name, page in pages.items():
        assert page.findtext(".//title"), name
        assert len(page.xpath("//article//h1")) == 1, name
        assert not page.xpath("//img[not(@alt) or normalize-space(@alt) = '']"), name


def test_nothing_is_loaded_from_other_hosts(site: Path, pages: dict[str, etree._Element]) -> None:
    for name, page in pages.items():
        loaded = page.xpath("//script/@src | //link/@href | //*[self::img or self::iframe or self::source]/@src")
        assert [source for source in loaded if re.match(r"(https?:)?//", source)] == [], name
    for style in site.rglob("*.css"):
        text = style.read_text(encoding="utf-8")
        assert re.findall(r"(?:url\(|@import )['\"]?(?:https?:)?//[^)]*", text) == [], style


def test_no_markdown_mark_is_left_in_the_text(pages: dict[str, etree._Element]) -> None:
    """MkDocs recognises the same lists, tables and code blocks as GitHub."""
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
    assert {variable.name for name in NAMES for variable in FmuInterface(1, name).variables} - shown == set()


def test_every_actuator_has_a_page_of_emcas_explore(site: Path, pages: dict[str, etree._Element]) -> None:
    linked = [href for href in pages["reference/fmu.html"].xpath("//article//a/@href") if "/explore/" in href]
    assert linked == [f"../explore/{name}.html" for name in NAMES]
    for name in NAMES:
        shown = html.fromstring((site / "explore" / f"{name}.html").read_text(encoding="utf-8"))
        assert name in shown.findtext(".//title")
        assert len(shown.xpath("//script[@id='actuator']")) == 1


def test_page_of_the_thesis_has_every_entry(site: Path, pages: dict[str, etree._Element]) -> None:
    assert "../thesis/thesis.html" in pages["tools/thesis.html"].xpath("//article//a/@href")
    shown = html.fromstring((site / "thesis/thesis.html").read_text(encoding="utf-8"))
    assert set(shown.xpath("//nav[@class='entries']/a/@title")) == {entry.title for entry in ENTRIES}
    assert "python -m docs.thesis --output thesis.html" in " ".join(shown.itertext())
    assert [path.name for path in (site / "thesis").iterdir()] == ["thesis.html"]


def test_no_link_targets_a_source_file(pages: dict[str, etree._Element]) -> None:
    for name, page in pages.items():
        links = page.xpath("//article//a/@href")
        assert not [href for href in links if re.search(r"^[^:]*\.(py|c|toml|yml|md|ipynb)$", href)], name


def test_notebook_has_its_pictures(pages: dict[str, etree._Element]) -> None:
    assert len(pages["examples/notebook/first_steps.html"].xpath("//article//img")) >= 3
