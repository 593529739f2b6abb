"""Writers of results: JSON, JUnit, and self-contained pages of one layout."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping
from dataclasses import replace
from functools import cache
from importlib.resources import files
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined, select_autoescape
from junitparser import Failure, JUnitXml, Skipped, TestCase, TestSuite
from markupsafe import Markup, escape
from rich.box import SIMPLE_HEAD
from rich.table import Column, Table

from .. import __version__
from ..support.writing import whole, write
from .provenance import Source, made

if TYPE_CHECKING:
    from ..parameters import ParameterSet
    from .subject import Identification

_SCRIPTS = {"uplot": "uplot/uPlot.iife.min.js", "uplot_style": "uplot/uPlot.min.css",
            "uplot_licence": "uplot/LICENSE", "marks_script": "marks.js", "curves_script": "curves.js"}
_LONG, _MOST_LISTED = 4, 40  # least headings of a page with contents; most headings of contents that list h3, too


def plain(value: Any) -> Any:
    """Return a document for JSON: lists in place of arrays, and null in place of infinity and NaN."""
    if isinstance(value, Mapping):
        return {key: plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple, np.ndarray)):
        return [plain(item) for item in value]
    if isinstance(value, (float, np.floating)):
        return float(value) if isfinite(value) else None
    return value


def write_json(document: Mapping[str, Any], path: Path) -> None:
    """Write a document; the same document gives the same bytes."""
    text = json.dumps(plain(document), indent=1, allow_nan=False)
    write(path, text + "\n")


def junit_case(name: str, classname: str, failed: str = "", skipped: str = "", kind: str = "limit missed",
               time: float = 0.0) -> TestCase:
    """Return a test case; `failed` or `skipped` is the reason, `kind` the failure's type, `time` is in s."""
    case = TestCase(name, classname, time)
    if skipped:
        case.result = [Skipped(skipped)]
    elif failed:
        case.result = [Failure(failed, kind)]
    return case


def write_junit(name: str, suites: Mapping[str, Iterable[TestCase]], path: Path) -> None:
    """Write suites of test cases by title, for continuous integration."""
    document = JUnitXml(name)
    for title, cases in suites.items():
        suite = TestSuite(title)
        suite.add_testcases(list(cases))
        document.add_testsuite(suite)
    document.update_statistics()  # type: ignore[no-untyped-call]
    with whole(path) as file:
        document.write(file, pretty=True)


def terminal_table(*header: str | Column, title: str = "") -> Table:
    """Return a table for the terminal with a single line, below its header."""
    return Table(*header, title=title or None, title_justify="left", box=SIMPLE_HEAD, padding=(0, 1, 0, 0),
                 pad_edge=False)


def rounded(value: float, form: str) -> str:
    """Return a number in a format such as ``+.3f`` for people: 0 has no sign, inf and nan are a dash."""
    if not isfinite(value):
        return "–"
    text = format(value, form)
    return text if any(digit in text for digit in "123456789") else text.lstrip("+-")


def number(value: float | bool | None) -> str:
    """Return a figure for people: four digits, a dash for none, words for infinity."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if value is None or value != value:
        return "–"
    if not isfinite(value):
        return "not reached" if value > 0.0 else "-∞"
    return rounded(value, ".0f" if abs(value) >= 1e4 else ".4g")


def beside(value: float | bool | None, limit: float) -> str:
    """Return a figure for people as `number`, with more digits where they are needed to tell it from its limit."""
    text = number(value)
    if value is None or not isfinite(value) or value == limit:
        return text
    longer = (rounded(value, f".{digits}g") for digits in range(5, 18))
    return text if text != number(limit) else next((each for each in longer if each != number(limit)), text)


def percent(share: float) -> str:
    """Return a share in whole percent for people; one that would round to 0 has one significant digit."""
    value = 100.0 * share
    text = rounded(value, ".0f")
    return f"{text if text != '0' or not value else rounded(value, '.1g')} %".replace("-", "−")


def with_unit(value: float | bool | None, unit: str, limit: float | None = None) -> str:
    """Return a figure with its unit, typeset; a time of less than a second is in ms.

    With a `limit` it has the digits that are needed to tell it from the limit.
    """
    if unit == "s" and value and abs(value) < 1.0:
        value, unit, limit = value * 1e3, "ms", None if limit is None else limit * 1e3
    text, symbol = (number(value) if limit is None else beside(value, limit)).replace("-", "−"), typeset(unit)
    if not symbol or not text[-1].isdigit():
        return text
    return f"{text}{symbol}" if symbol[0] == "°" and symbol != "°C" else f"{text} {symbol}"


def stated(value: float | bool, unit: str, name: str = "") -> Markup:
    """Return a value with its unit, and the name of its parameter or input."""
    of = Markup(' <span class="quiet">{}</span>').format(code(name)) if name else ""
    return escape(with_unit(value, unit)) + of


def code(text: str) -> Markup:
    """Return a name as a page shows it; empty for an empty one."""
    return Markup("<code>{}</code>").format(text) if text else Markup("")


def typeset(unit: str) -> str:
    """Return a unit as a page shows it."""
    raised = re.sub(r"(?<=[A-Za-z)])[23]", lambda digit: "²³"[int(digit[0]) - 2], unit).replace(".", "·")
    return {"1": "", "deg": "°", "deg/s": "°/s", "degC": "°C"}.get(unit, raised)


def css_text(text: str) -> str:
    """Return a text for a style sheet's quotes, escaped so that it ends neither the quotes nor the element."""
    return re.sub(r"[^\w .,+-]", lambda found: f"\\{ord(found[0]):x} ", text)


@cache
def _environment() -> Environment:
    made = Environment(loader=PackageLoader("emcas_fmu", ""), undefined=StrictUndefined, trim_blocks=True,
                       lstrip_blocks=True, autoescape=select_autoescape(["html.j2", "xml.j2"]))
    made.filters.update(number=lambda value: number(value).replace("-", "−"), quantity=with_unit, unit=typeset,
                        percent=percent, beside=lambda value, limit: beside(value, limit).replace("-", "−"),
                        rounded=lambda value, form: rounded(value, form).replace("-", "−"))
    made.filters["code"] = code
    made.filters["breakable"] = lambda name: Markup("_<wbr>").join(name.split("_"))
    made.filters["right"] = lambda names: [Markup(">") + name for name in names]  # columns of numbers
    made.filters["css"] = lambda text: Markup(css_text(text))
    made.filters["outlined"] = lambda body: Markup(outlined(str(body)))  # what is in it was escaped before
    made.tests["tuple"] = lambda row: type(row) is tuple  # none with names
    made.globals.update(version=__version__, **{
        name: files("emcas_fmu.bench").joinpath(file).read_text(encoding="utf-8") for name, file in _SCRIPTS.items()})
    made.globals["m"] = made.get_template("bench/macros.html.j2").module  # the blocks that pages are made of
    return made


def page(template: str | Path, **context: Any) -> str:
    """Return the text of a template, named relative to the package (``studies/report/page.html.j2``) or any file.

    The same context gives the same text.
    """
    made = _environment()
    found = made.from_string(template.read_text("utf-8")) if isinstance(template, Path) else made.get_template(template)
    return found.render(**context)


def write_page(path: Path, template: str | Path, of: Iterable[ParameterSet | Identification | Source], date: str = "",
               **context: Any) -> None:
    """Write the page of a template that extends ``bench/base.html.j2``; see `page`.

    It ends with its provenance: the sources `of` it, and the `date`, by default today.
    """
    how = made(*of)
    text = page(template, made=replace(how, date=date) if date else how, **context)
    write(path, text)


def outlined(body: str) -> str:
    """Return a page's body with numbered figures and tables, and the contents before the first heading."""
    for element, word in (("figcaption", "Figure"), ("caption", "Table")):
        first, *others = body.split(f"<{element}>")
        body = first + "".join(f"<{element}><b>{word} {n}.</b> {rest}" for n, rest in enumerate(others, 1))
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
        f'<li{" class=deeper" if level == "3" else ""}><a href="#{name}">{re.sub("<[^>]*>", "", text)}</a></li>'
        for level, name, text in headings if deep or level == "2")
    contents = f'<nav class="contents" aria-label="Contents"><ol>{entries}</ol></nav>\n'
    return re.sub("(?=<h2)", lambda _: contents, body, count=1)
