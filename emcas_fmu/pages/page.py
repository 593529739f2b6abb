"""Self-contained pages in one style: blocks of macros.html.j2 over base.html.j2."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import replace
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined, select_autoescape
from markupsafe import Markup, escape

from .. import __version__
from ..parameters import ParameterSet
from ..support.writing import write
from .credibility import APPLIES
from .numbers import beside, number, percent, rounded, typeset, with_unit
from .provenance import Source, made

_SCRIPTS = {"uplot": "uplot/uPlot.iife.min.js", "uplot_style": "uplot/uPlot.min.css",
            "uplot_licence": "uplot/LICENSE", "draw_script": "draw.js", "curves_script": "curves.js"}
_FEWEST_LISTED = 4  # headings from which a page has a list of contents
_MOST_LISTED = 40  # headings up to which the list includes h3


def stated(value: float | bool, unit: str, name: str = "") -> Markup:
    """Return a value with its unit, and the name of its parameter or input."""
    label = Markup(' <span class="quiet">{}</span>').format(code(name)) if name else ""
    return escape(with_unit(value, unit)) + label


def code(text: str) -> Markup:
    """Return a text as HTML code; an empty text stays empty."""
    return Markup("<code>{}</code>").format(text) if text else Markup("")


def prose(text: str) -> Markup:
    """Return a docstring or note as HTML: text between backticks becomes code, without Sphinx role and package name."""
    return Markup(re.sub(r"(?::\w+:)?(`{1,2})(?:emcas_fmu\.)?(.+?)\1", r"<code>\2</code>", str(escape(text))))


def css_text(text: str) -> Markup:
    """Return a text escaped for a quoted string of a style sheet: it ends neither the string nor the element."""
    return Markup(re.sub(r"[^\w .,+-]", lambda found: f"\\{ord(found[0]):x} ", text))


@cache
def environment() -> Environment:
    """Return Jinja's environment for the templates, with their filters for numbers, names and units."""
    jinja = Environment(loader=PackageLoader("emcas_fmu", ""), undefined=StrictUndefined, trim_blocks=True,
                       lstrip_blocks=True, autoescape=select_autoescape(["html.j2", "xml.j2"]))
    jinja.filters.update(number=lambda value: number(value).replace("-", "−"), quantity=with_unit, unit=typeset,
                        percent=percent, beside=lambda value, limit: beside(value, limit).replace("-", "−"),
                        rounded=lambda value, form: rounded(value, form).replace("-", "−"))
    jinja.filters.update(code=code, prose=prose, css=css_text)
    jinja.filters["breakable"] = lambda name: Markup("_<wbr>").join(name.split("_"))
    jinja.filters["right"] = lambda names: [Markup(">") + name for name in names]  # columns of numbers
    jinja.filters["outlined"] = lambda body: Markup(outlined(str(body)))  # the body is escaped already
    jinja.tests["tuple"] = lambda row: type(row) is tuple  # not a named tuple
    jinja.globals.update(version=__version__, applies=APPLIES, **{
        name: files("emcas_fmu.pages").joinpath(file).read_text(encoding="utf-8") for name, file in _SCRIPTS.items()})
    jinja.globals["m"] = jinja.get_template("pages/macros.html.j2").module  # the blocks that pages are made of
    return jinja


def page(template: str | Path, **context: Any) -> str:
    """Return the page of a template: a name in the package (``studies/report/page.html.j2``) or the path of a file."""
    jinja = environment()
    if isinstance(template, Path):
        return jinja.from_string(template.read_text("utf-8")).render(**context)
    return jinja.get_template(template).render(**context)


def write_page(path: Path, template: str | Path, of: Iterable[ParameterSet | Source], date: str = "",
               **context: Any) -> None:
    """Write the page of a template that extends ``pages/base.html.j2``; see `page`.

    The page ends with its provenance: the sources `of` which it is made, and the `date`, by default today. `context`
    are the template's variables.
    """
    how = made(*of)
    write(path, page(template, made=replace(how, date=date or how.date), **context))


def _words(html: str) -> str:
    """Return a line of HTML without its tags, for an attribute."""
    return re.sub("<[^>]*>", "", html).replace('"', "&quot;")


def outlined(body: str) -> str:
    """Return a page's body with numbered figures and tables; a long body gets a list of contents before the first h2.

    The box in which a table scrolls gets keyboard focus, and the table's caption as its label.
    """
    for element, word in (("figcaption", "Figure"), ("caption", "Table")):
        first, *others = body.split(f"<{element}>")
        body = first + "".join(f"<{element}><b>{word} {n}.</b> {rest}" for n, rest in enumerate(others, 1))
    body = re.sub(r'<div class="wide">(?=<table[^>]*>\s*<caption[^>]*>(.*?)</caption>)', lambda found: (
        f'<div class="wide" tabindex="0" role="region" aria-label="{_words(found[1])}">'), body)
    headings: list[tuple[str, str, str]] = []

    def listed(heading: re.Match[str]) -> str:
        level, chosen, text = heading.groups()
        name = chosen or f"section-{len(headings) + 1}"
        headings.append((level, name, text))
        return f'<h{level} id="{name}">{text}</h{level}>'

    body = re.sub(r'<h([23])(?: id="([^"]*)")?>(.*?)</h\1>', listed, body, flags=re.DOTALL)
    if len(headings) < _FEWEST_LISTED:
        return body
    deep = len(headings) <= _MOST_LISTED
    entries = "".join(
        f'<li{" class=deeper" if level == "3" else ""}><a href="#{name}">{_words(text)}</a></li>'
        for level, name, text in headings if deep or level == "2")
    contents = f'<nav class="contents" aria-label="Contents"><ol>{entries}</ol></nav>\n'
    return re.sub("(?=<h2)", lambda _: contents, body, count=1)
