"""Pages of one look with nothing outside them: blocks of macros.html.j2 over base.html.j2."""

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
_LONG, _MOST_LISTED = 4, 40  # headings: of a page that has a list of contents, and of one whose h3 are in it


def stated(value: float | bool, unit: str, name: str = "") -> Markup:
    """Return a value with its unit, and the name of its parameter or input."""
    of = Markup(' <span class="quiet">{}</span>').format(code(name)) if name else ""
    return escape(with_unit(value, unit)) + of


def code(text: str) -> Markup:
    """Return a name as a page shows it; empty for an empty one."""
    return Markup("<code>{}</code>").format(text) if text else Markup("")


def prose(text: str) -> Markup:
    """Return a docstring or note as HTML.

    Names between backticks become code, without Sphinx role and package.
    """
    return Markup(re.sub(r"(?::\w+:)?(`{1,2})(?:emcas_fmu\.)?(.+?)\1", r"<code>\2</code>", str(escape(text))))


def css_text(text: str) -> str:
    """Return a text for a style sheet's quotes, escaped so that it ends neither the quotes nor the element."""
    return re.sub(r"[^\w .,+-]", lambda found: f"\\{ord(found[0]):x} ", text)


@cache
def environment() -> Environment:
    """Return Jinja's environment of the templates, with the filters for numbers, names and units that they use."""
    made = Environment(loader=PackageLoader("emcas_fmu", ""), undefined=StrictUndefined, trim_blocks=True,
                       lstrip_blocks=True, autoescape=select_autoescape(["html.j2", "xml.j2"]))
    made.filters.update(number=lambda value: number(value).replace("-", "−"), quantity=with_unit, unit=typeset,
                        percent=percent, beside=lambda value, limit: beside(value, limit).replace("-", "−"),
                        rounded=lambda value, form: rounded(value, form).replace("-", "−"))
    made.filters.update(code=code, prose=prose)
    made.filters["breakable"] = lambda name: Markup("_<wbr>").join(name.split("_"))
    made.filters["right"] = lambda names: [Markup(">") + name for name in names]  # columns of numbers
    made.filters["css"] = lambda text: Markup(css_text(text))
    made.filters["outlined"] = lambda body: Markup(outlined(str(body)))  # what is in it was escaped before
    made.tests["tuple"] = lambda row: type(row) is tuple  # none with names
    made.globals.update(version=__version__, applies=APPLIES, **{
        name: files("emcas_fmu.pages").joinpath(file).read_text(encoding="utf-8") for name, file in _SCRIPTS.items()})
    made.globals["m"] = made.get_template("pages/macros.html.j2").module  # the blocks that pages are made of
    return made


def page(template: str | Path, **context: Any) -> str:
    """Return the text of a template, named relative to the package (``studies/report/page.html.j2``) or any file.

    The same context gives the same text.
    """
    made = environment()
    found = made.from_string(template.read_text("utf-8")) if isinstance(template, Path) else made.get_template(template)
    return found.render(**context)


def write_page(path: Path, template: str | Path, of: Iterable[ParameterSet | Source], date: str = "",
               **context: Any) -> None:
    """Write the page of a template that extends ``pages/base.html.j2``; see `page`.

    It ends with its provenance: the sources `of` it, and the `date`, by default today.
    """
    how = made(*of)
    text = page(template, made=replace(how, date=date) if date else how, **context)
    write(path, text)


def _words(html: str) -> str:
    """Return a line of HTML without its elements, for an attribute."""
    return re.sub("<[^>]*>", "", html).replace('"', "&quot;")


def outlined(body: str) -> str:
    """Return a page's body with numbered figures and tables, and the contents before the first heading.

    Boxes in which a table scrolls get the keyboard's focus and its caption as name.
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
    if len(headings) < _LONG:
        return body
    deep = len(headings) <= _MOST_LISTED
    entries = "".join(
        f'<li{" class=deeper" if level == "3" else ""}><a href="#{name}">{_words(text)}</a></li>'
        for level, name, text in headings if deep or level == "2")
    contents = f'<nav class="contents" aria-label="Contents"><ol>{entries}</ol></nav>\n'
    return re.sub("(?=<h2)", lambda _: contents, body, count=1)
