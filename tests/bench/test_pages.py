"""Pages as their templates and writer make them: tables, figures, how they were made."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

import emcas_fmu
from emcas_fmu.errors import EmcasError
from emcas_fmu.figures.plots import Picture
from emcas_fmu.pages.numbers import typeset, with_unit
from emcas_fmu.pages.page import environment, outlined, write_page
from emcas_fmu.pages.provenance import Source, made, made_by
from emcas_fmu.parameters import load_parameters
from emcas_fmu.support.dates import today

FOLDER = Path(emcas_fmu.__file__).parent
TEMPLATES = sorted(FOLDER.rglob("*.html.j2"))
WITH_TABLES = [path for path in TEMPLATES if "<table" in path.read_text(encoding="utf-8")]


@pytest.mark.parametrize("template", WITH_TABLES, ids=lambda path: str(path.relative_to(FOLDER)))
def test_a_table_scrolls_by_itself(template: Path) -> None:
    """Not the page with it. What is signed and what is said about the article have short cells that wrap."""
    for before, attributes in re.findall(r"(.*)<table([^>]*)>", template.read_text(encoding="utf-8")):
        if 'class="sign"' not in attributes and 'class="about"' not in attributes:
            assert before.startswith('<div class="wide"')


# The explorer is a program more than a page to print.
@pytest.mark.parametrize("template", [path for path in WITH_TABLES if path.parent.name != "explore"],
                         ids=lambda path: str(path.relative_to(FOLDER)))
def test_a_table_has_a_caption_and_headings_that_repeat(template: Path) -> None:
    text = template.read_text(encoding="utf-8")
    for table in re.findall(r'<div class="wide"><table[^>]*>(.*?)</table>', text, flags=re.DOTALL):
        assert re.match(r"\s*<caption[^>]*>.*</caption>\s*<thead>", table)


@pytest.mark.parametrize("template", [path for path in TEMPLATES
                                      if path.parent.name not in ("pages", "explore", "thesis")],
                         ids=lambda path: str(path.relative_to(FOLDER)))
def test_a_page_is_made_of_blocks(template: Path) -> None:
    """Its tables and figures are those of the macros, but what is signed."""
    text = template.read_text(encoding="utf-8")
    assert "<figure" not in text
    assert re.findall(r"<table([^>]*)>", text) in ([], [' class="sign"'])


def test_rows_of_a_table() -> None:
    """A tuple is shown item by item, a heading of numbers is right-aligned, and a table without rows says so."""
    template = environment().from_string(
        '{% call(name, value) m.table("Title", ["name", ">value"], rows) %}'
        '<td>{{ name }}</td>{{ m.cells([value]) }}{% endcall %}')
    text = re.sub(r"\s*\n\s*", "", template.render(rows=[("<a>", -2.0)]))
    assert '<thead><tr><th>name</th><th class="n">value</th></tr></thead>' in text
    assert '<tr><td>&lt;a&gt;</td><td class="n">−2</td></tr>' in text
    assert "<td>none</td>" in template.render(rows=[])


def test_figures_tables_and_sections_are_numbered_and_listed() -> None:
    body = "".join(f"<h2>Part {n}</h2><figcaption>f{n}</figcaption><caption>t{n}</caption>" for n in (1, 2, 3, 4))
    page = outlined(f'<h1>Title</h1>{body}<h2 id="mine">Last &amp; <code>least</code></h2>')
    assert re.findall(r"<b>(.*?)</b> (\w+)", page) == [
        (f"{word} {n}.", f"{word[0].lower()}{n}") for n in (1, 2, 3, 4) for word in ("Figure", "Table")]
    assert '<a href="#mine">Last &amp; least</a>' in page
    assert page.index("<nav") < page.index("<h2")
    assert "<nav" not in outlined("<h2>Only</h2>")


def test_tables_that_scroll_have_the_keyboards_focus_and_a_name() -> None:
    body = '<div class="wide"><table class="dense">\n<caption>Gains, "as <code>x</code>"</caption></table></div>' * 2
    assert re.findall(r'<div class="wide" tabindex="0" role="region" aria-label="(.*?)">', outlined(body)) == [
        "Table 1. Gains, &quot;as x&quot;", "Table 2. Gains, &quot;as x&quot;"]


def test_a_heading_without_words_is_none() -> None:
    template = environment().from_string('{% call(x) m.table("T", ["", "value"], [1]) %}<th>one</th>{% endcall %}')
    assert "<tr><td></td><th>value</th></tr>" in template.render()


def test_a_page_says_how_it_was_made_and_is_the_same_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "1775001600")
    mine = tmp_path / "mine.toml"
    mine.write_text("[motor.resistance]\nvalue = 0.3\nunit = \"Ohm\"\n", encoding="utf-8")
    parameters = load_parameters(mine).with_values({"motor.inductance": 7e-4})
    pages = [tmp_path / "one.html", tmp_path / "two.html"]
    for path in pages:
        with made_by(["emcas", "envelope", "-p", "a file.toml"]):
            write_page(path, "pages/picture.html.j2", [parameters], picture=Picture("Title", "<svg></svg>", "Words."))
    text = pages[0].read_text(encoding="utf-8")
    assert text == pages[1].read_text(encoding="utf-8")
    (source,) = made(parameters).sources
    for part in ("emcas envelope -p &#39;a file.toml&#39;", str(mine), source.sha256, source.values_sha256,
                 "changed afterwards: <code>motor.inductance</code>", f"emcas {emcas_fmu.__version__}", "2026-04-01"):
        assert part in text
    assert "uPlot" not in text  # a picture without curves needs no script


def test_a_date_that_is_none(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "yesterday")
    with pytest.raises(EmcasError, match="SOURCE_DATE_EPOCH=yesterday: expected seconds since 1970"):
        today()


def test_the_same_source_stands_once() -> None:
    source = Source("parameters", "mine.toml")
    assert made(source, source).sources == (source,)


@pytest.mark.parametrize(("value", "unit", "text"), [
    (0.0123, "s", "12.3 ms"), (15.0, "s", "15 s"), (-20.0, "deg", "−20°"), (24.0, "degC", "24 °C"), (0.4, "1", "0.4"),
    (float("inf"), "s", "not reached"), (None, "s", "–"), (2.0, "kg.m2", "2 kg·m²"),
    (2.544e-14, "deg", "0°"), (-2e-9, "deg", "−2e−09°"), (2.544e-14, "1", "2.544e−14")])
def test_a_figure_with_its_unit(value: float | None, unit: str, text: str) -> None:
    assert with_unit(value, unit) == text
    assert typeset("N.m/(rad/s)2") == "N·m/(rad/s)²"
