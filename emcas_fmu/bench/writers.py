"""Writers of results: JSON, CSV and JUnit files."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np
from junitparser import Failure, JUnitXml, Skipped, TestCase, TestSuite

from ..support.writing import whole, write


def plain(value: Any) -> Any:
    """Return a document for JSON, with lists for arrays and None for infinity and NaN."""
    if isinstance(value, Mapping):
        return {key: plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple, np.ndarray)):
        return [plain(item) for item in value]
    if isinstance(value, (float, np.floating)):
        return float(value) if isfinite(value) else None
    return value


def write_json(document: Mapping[str, Any], path: Path) -> None:
    """Write a document as JSON; equal documents give equal bytes."""
    text = json.dumps(plain(document), indent=1, allow_nan=False)
    write(path, text + "\n")


def write_csv(columns: Mapping[str, Any], path: Path | str) -> None:
    """Write arrays of equal length as CSV under their names, with 17 digits, which preserve every bit."""
    with whole(path) as file:
        np.savetxt(file, np.column_stack(list(columns.values())), fmt="%.17g", delimiter=",", header=",".join(columns),
                   comments="")


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
    """Write test suites as JUnit XML; `suites` maps a title to test cases."""
    document = JUnitXml(name)
    for title, cases in suites.items():
        suite = TestSuite(title)
        suite.add_testcases(list(cases))
        document.add_testsuite(suite)
    document.update_statistics()  # type: ignore[no-untyped-call]
    with whole(path) as file:
        document.write(file, pretty=True)
