"""Writing results: JSON, JUnit, and pages of one look with nothing outside them."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from functools import cache
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined, select_autoescape
from junitparser import Failure, JUnitXml, Skipped, TestCase, TestSuite

from .. import __version__


def plain(value: Any) -> Any:
    """Return a document for JSON, which knows neither arrays nor infinity nor NaN: lists, and null."""
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
    path.write_text(text + "\n", encoding="utf-8", newline="\n")


def junit_case(name: str, classname: str, failed: str = "", skipped: str = "", kind: str = "limit missed",
               time: float = 0.0) -> TestCase:
    """Return a test case: `failed` and `skipped` say why it is; `kind` is the failure's type, `time` [s]."""
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
    document.write(str(path), pretty=True)


def rounded(value: float, form: str) -> str:
    """Return a number in a format such as ``+.3f`` for people: 0 has no sign, a dash stands for inf and nan."""
    if not isfinite(value):
        return "–"
    text = format(value, form)
    return text if any(digit in text for digit in "123456789") else text.lstrip("+-")


def number(value: float | bool | None) -> str:
    """Return a figure for people: four digits, a dash for none, infinity as a word."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if value is None or value != value:
        return "–"
    if not isfinite(value):
        return "not reached" if value > 0.0 else "-∞"
    return rounded(value, ".0f" if abs(value) >= 1e4 else ".4g")


def with_unit(value: float | bool | None, unit: str) -> str:
    """Return a figure with its unit, typeset."""
    text, symbol = number(value).replace("-", "−"), typeset(unit)
    if not symbol or not text[-1].isdigit():
        return text
    return f"{text}{symbol}" if symbol.startswith("°") else f"{text} {symbol}"


def typeset(unit: str) -> str:
    """Return a unit as a page shows it."""
    return {"1": "", "deg": "°", "deg/s": "°/s"}.get(unit, unit.replace("N.m", "N·m"))


@cache
def _environment() -> Environment:
    made = Environment(loader=PackageLoader("emcas_fmu", ""), undefined=StrictUndefined, trim_blocks=True,
                       lstrip_blocks=True, autoescape=select_autoescape(["html.j2", "xml.j2"]))
    made.filters.update(number=lambda value: number(value).replace("-", "−"), quantity=with_unit, unit=typeset,
                        rounded=lambda value, form: rounded(value, form).replace("-", "−"))
    made.globals["version"] = __version__
    return made


def page(template: str, **context: Any) -> str:
    """Return a document of a template, named from the package on (``studies/report/page.html.j2``).

    The same context gives the same text.
    """
    return _environment().get_template(template).render(**context)


def write_page(path: Path, template: str, **context: Any) -> None:
    """Write the page of a template that extends ``bench/base.html.j2``; see `page`."""
    path.write_text(page(template, **context), encoding="utf-8", newline="\n")
