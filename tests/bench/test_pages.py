"""Templates and writer of pages: tables, figures, contents, provenance."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

import emcas_fmu
from emcas_fmu.errors import EmcasError
from emcas_fmu.pages.numbers import typeset, with_unit
from emcas_fmu.pages.page import environment, outlined, write_page
from emcas_fmu.pages.provenance import Source, made, made_by
from emcas_fmu.parameters import load_parameters
from emcas_fmu.plotting.plots import Picture
from emcas_fmu.support.dates import today

FOLDER = Path(emcas_fmu.__file__).parent
TEMPLATES = sorted(FOLDER.rglob("*.html.j2"))
WITH_TABLES = [path for path in TEMPLATES if "<table" in path.read_text(encoding="utf-8")]


@pytest.mark.parametrize("template", WITH_TABLES, ids=lambda path: str(path.relative_to(FOLDER)))
def test_wide_table_scrolls_without_the_page(template: Path) -> None:
    """The tables of signatures and of the article need not scroll: their cells are short and wrap."""
    for before, attributes in re.findall(r"(.*)<table([^>]*)>", template.read_text(encoding="utf-8")):
        if 'class="sign"' not in attributes and 'class="about"' not in attributes:
            assert before.startswith('<div class="wide"')


# The explorer's page is not printed.
@pytest.mark.parametrize("template", [path for path in WITH_TABLES if path.parent.name != "explore"],
                         ids=lambda path: str(path.relative_to(FOLDER)))
def test_table_has_a_caption_and_repeated_headings(template: Path) -> None:
    text = template.read_text(encoding="utf-8")
    for table in re.findall(r'<div class="wide"><table[^>]*>(.*?)</table>', text, flags=re.DOTALL):
        assert re.match(r"\s*<caption[^>]*>.*</caption>\s*<thead>", table)


@pytest.mark.parametrize("template", [path for path in TEMPLATES
                                      if path.parent.name not in ("pages", "explore", "thesis")],
                         ids=lambda path: str(path.relative_to(FOLDER)))
def test_page_uses_the_macros_for_tables_and_figures(template: Path) -> None:
    """Only the table of signatures is written in the template."""
    text = template.read_text(encoding="utf-8")
    assert "<figure" not in text
    assert re.findall(r"<table([^>]*)>", text) in ([], [' class="sign"'])


def test_table_macro() -> None:
    """A tuple is unpacked, a heading with > is right-aligned, and a table without rows contains "none"."""
    template = environment().from_string(
        '{% call(name, value) m.table("Title", ["name", ">value"], rows) %}'
        '<td>{{ name }}</td>{{ m.cells([value]) }}{% endcall %}')
    text = re.sub(r"\s*\n\s*", "", template.render(rows=[("<a>", -2.0)]))
    assert '<thead><tr><th>name</th><th class="n">value</th></tr></thead>' in text
    assert '<tr><td>&lt;a&gt;</td><td class="n">−2</td></tr>' in text
    assert "<td>none</td>" in template.render(rows=[])


def test_figures_and_tables_are_numbered_and_sections_are_listed() -> None:
    body = "".join(f"<h2>Part {n}</h2><figcaption>f{n}</figcaption><caption>t{n}</caption>" for n in (1, 2, 3, 4))
    page = outlined(f'<h1>Title</h1>{body}<h2 id="mine">Last &amp; <code>least</code></h2>')
    assert re.findall(r"<b>(.*?)</b> (\w+)", page) == [
        (f"{word} {n}.", f"{word[0].lower()}{n}") for n in (1, 2, 3, 4) for word in ("Figure", "Table")]
    assert '<a href="#mine">Last &amp; least</a>' in page
    assert page.index("<nav") < page.index("<h2")
    assert "<nav" not in outlined("<h2>Only</h2>")


def test_scrolling_tables_have_keyboard_focus_and_a_label() -> None:
    body = '<div class="wide"><table class="dense">\n<caption>Gains, "as <code>x</code>"</caption></table></div>' * 2
    assert re.findall(r'<div class="wide" tabindex="0" role="region" aria-label="(.*?)">', outlined(body)) == [
        "Table 1. Gains, &quot;as x&quot;", "Table 2. Gains, &quot;as x&quot;"]


def test_empty_heading_is_a_data_cell() -> None:
    template = environment().from_string('{% call(x) m.table("T", ["", "value"], [1]) %}<th>one</th>{% endcall %}')
    assert "<tr><td></td><th>value</th></tr>" in template.render()


def test_page_contains_its_provenance_and_is_reproducible(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
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
    for item in ("emcas envelope -p &#39;a file.toml&#39;", str(mine), source.sha256, source.values_sha256,
                 "changed afterwards: <code>motor.inductance</code>", f"emcas {emcas_fmu.__version__}", "2026-04-01"):
        assert item in text
    assert "uPlot" not in text  # a picture without curves has no script


def test_invalid_source_date_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "yesterday")
    with pytest.raises(EmcasError, match="SOURCE_DATE_EPOCH=yesterday: expected seconds since 1970"):
        today()


def test_duplicate_source_is_listed_once() -> None:
    source = Source("parameters", "mine.toml")
    assert made(source, source).sources == (source,)


@pytest.mark.parametrize(("value", "unit", "text"), [
    (0.0123, "s", "12.3 ms"), (15.0, "s", "15 s"), (-20.0, "deg", "−20°"), (24.0, "degC", "24 °C"), (0.4, "1", "0.4"),
    (float("inf"), "s", "not reached"), (None, "s", "–"), (2.0, "kg.m2", "2 kg·m²"),
    (2.544e-14, "deg", "0°"), (-2e-9, "deg", "−2e−09°"), (2.544e-14, "1", "2.544e−14")])
def test_number_with_its_unit_as_shown_on_pages(value: float | None, unit: str, text: str) -> None:
    assert with_unit(value, unit) == text
    assert typeset("N.m/(rad/s)2") == "N·m/(rad/s)²"
