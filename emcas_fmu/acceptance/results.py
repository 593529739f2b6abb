"""An acceptance test's result as JSON and as JUnit XML."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict
from math import isfinite
from pathlib import Path
from typing import Any

import junitparser
import numpy as np

from .. import __version__
from .campaign import Campaign
from .requirements import Judged

SCHEMA = "emcas-acceptance/1"
"""Name and version of the JSON layout; the number changes when a field changes its meaning or goes."""


def as_dict(campaign: Campaign, date: str = "") -> dict[str, Any]:
    """For JSON: figures that are infinite or not a number become None."""
    outcomes = campaign.outcomes
    document = {
        "schema": SCHEMA, "passed": campaign.passed, "tool": f"emcas {__version__}", "date": date or None,
        "identification": asdict(campaign.identification), "rated_load_n_m": campaign.load,
        "requirements": [{**asdict(j), "margin": j.margin, "margin_percent": j.margin_percent, "passed": j.passed}
                         for j in campaign.judged],
        "figures": {name: o.figures for name, o in outcomes.items()},
        "curves": {name: o.curves for name, o in outcomes.items() if o.curves},
        "methods": {name: {"method": o.method, "estimate": o.estimate or None, "stopped": o.stopped or None,
                           "notes": o.notes, "figures": {q.key: q.how for q in o.columns()}}
                    for name, o in outcomes.items()},
    }
    plain: dict[str, Any] = _plain(document)
    return plain


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple, np.ndarray)):
        return [_plain(item) for item in value]
    if isinstance(value, (float, np.floating)):
        return float(value) if isfinite(value) else None
    return value


def write_json(campaign: Campaign, path: Path, date: str = "") -> None:
    """Write figures, curves, methods and requirements; not the time series."""
    text = json.dumps(as_dict(campaign, date), indent=1, allow_nan=False)
    path.write_text(text + "\n", encoding="utf-8", newline="\n")


def write_junit(campaign: Campaign, path: Path) -> None:
    """Write a test case for each requirement and each test."""
    suites = junitparser.JUnitXml("emcas report")
    for source in dict.fromkeys(j.source for j in campaign.judged):
        suite = junitparser.TestSuite(f"requirements of {source}")
        for j in (j for j in campaign.judged if j.source == source):
            case = junitparser.TestCase(j.name, "emcas.requirement", 0.0)
            if not j.passed:
                case.result = [junitparser.Failure(describe(j), "limit missed")]
            suite.add_testcase(case)
        suites.add_testsuite(suite)
    suite = junitparser.TestSuite("tests finished")
    for name, outcome in campaign.outcomes.items():
        case = junitparser.TestCase(name, "emcas.test", 0.0)
        if outcome.stopped:
            case.result = [junitparser.Failure(outcome.stopped, "not finished")]
        suite.add_testcase(case)
    suites.add_testsuite(suite)
    suites.update_statistics()  # type: ignore[no-untyped-call]
    suites.write(str(path), pretty=True)


def describe(j: Judged) -> str:
    """A requirement and its figure in a sentence."""
    measured = "no value" if j.measured is None else f"{j.measured:.4g} {j.unit}"
    return f"{j.title}: {measured}, required {j.sense} {j.limit:g} {j.unit} ({j.how})"
