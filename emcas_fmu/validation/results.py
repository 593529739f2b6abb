"""What a validation found, as plain data that turns into JSON and JUnit XML.

Angles are in deg, rates in deg/s, times in s, frequencies in Hz; every figure comes with its unit.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from math import isfinite
from pathlib import Path
from typing import Any, Literal

import junitparser

from .runs import Run

SCHEMA = "emcas-validation/1"
"""Name and version of the JSON layout; the number changes when a field changes its meaning or goes."""


class Verdict:
    """How what was measured stands to its limit, for data classes with these fields."""

    measured: float | None
    sense: Literal["<=", ">="]
    limit: float

    @property
    def margin(self) -> float | None:
        """Distance to the limit [unit], negative where it is missed."""
        if self.measured is None or not isfinite(self.measured):
            return None
        return self.measured - self.limit if self.sense == ">=" else self.limit - self.measured

    @property
    def passed(self) -> bool:
        """Whether the limit is kept; never true of a figure that is missing or not a number."""
        return self.margin is not None and bool(self.margin >= 0.0)


@dataclass(frozen=True)
class Criterion(Verdict):
    """One thing to pass: `measured` [unit] at least or at most `limit` [unit].

    ``measured`` is None where the run it needs was not made (skipped) or gave no such figure (failed,
    with the reason in ``note``).
    """

    group: Literal["trajectory", "table2"]
    name: str
    title: str
    measured: float | None
    sense: Literal["<=", ">="]
    limit: float
    unit: str
    source: str
    note: str = ""
    skipped: bool = False


@dataclass(frozen=True)
class VariableError:
    """Errors of one variable against the reference, in its unit."""

    maximum: float
    rms: float
    unit: str


@dataclass(frozen=True)
class CaseResult:
    """One reference case: how far the FMU came, its errors and its performance figures."""

    name: str
    title: str
    kind: str
    stop_time: float
    stopped: float | None
    wall_time: float
    messages: tuple[str, ...]
    errors: Mapping[str, VariableError]
    figures: Mapping[str, float]
    """Performance figures; the name ends in the unit."""


@dataclass(frozen=True)
class Comparison:
    """Linear model against the FMU for a step of `amplitude` [deg]; differences in % of the step, times in s."""

    amplitude: float
    largest_difference: float
    rms_difference: float
    rise_time_linear: float
    rise_time_fmu: float
    saturated_time: float


@dataclass(frozen=True)
class Finding:
    """Something measured that nothing is gated on; `holds` where it tests a claim."""

    name: str
    text: str
    holds: bool | None = None


@dataclass(frozen=True)
class Difference:
    """A parameter of the FMU that is not the default."""

    name: str
    value: float | bool
    default: float | bool
    unit: str


@dataclass(frozen=True)
class FmuInfo:
    """Which FMU was judged, and where."""

    path: str
    name: str
    guid: str
    version: str
    generation_tool: str
    sha256: str
    platform: str
    fmpy: str
    parameters: Mapping[str, float | bool]
    differences: tuple[Difference, ...]
    estimates: tuple[str, ...]
    """Names of default parameters that are engineering estimates."""


@dataclass(frozen=True)
class Series:
    """Time series of a run and of its reference (empty where it has none), SI, for the report.

    `run` is of the FMU as it was built, from which performance is judged; `exact` is the one to
    compare with the reference, with the start values of the case, true angle and speed fed back.
    """

    inputs: Mapping[str, Any]
    run: Run
    reference: Mapping[str, Any]
    exact: Run


@dataclass(frozen=True)
class Result:
    """A whole validation. `series` (by case) and `linear_series` (by amplitude [deg]) do not go into the JSON."""

    fmu: FmuInfo
    reference: str
    cases: tuple[CaseResult, ...]
    criteria: tuple[Criterion, ...]
    comparisons: tuple[Comparison, ...]
    findings: tuple[Finding, ...]
    notes: tuple[str, ...]
    series: Mapping[str, Series] = field(repr=False)
    linear_series: Mapping[float, tuple[Series, Any]] = field(repr=False)

    @property
    def passed(self) -> bool:
        """Whether something was judged and all of it passed."""
        judged = [c for c in self.criteria if not c.skipped]
        return bool(judged) and all(c.passed for c in judged)

    def as_dict(self) -> dict[str, Any]:
        """For JSON: figures that are infinite or not a number become None."""
        plain = {name: getattr(self, name) for name in ("reference", "notes")}
        for name in ("cases", "comparisons", "findings"):
            plain[name] = [asdict(item) for item in getattr(self, name)]
        criteria = [{**asdict(c), "margin": c.margin, "passed": c.passed} for c in self.criteria]
        document = {"schema": SCHEMA, "passed": self.passed, "fmu": asdict(self.fmu), **plain, "criteria": criteria}
        plainly: dict[str, Any] = finite(document)
        return plainly


def finite(value: Any) -> Any:
    """A document for JSON, which knows no infinity and no NaN: null."""
    if isinstance(value, Mapping):
        return {key: finite(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [finite(item) for item in value]
    if isinstance(value, float):
        return float(value) if isfinite(value) else None
    return value


def write_json(result: Result, path: Path) -> None:
    """Write everything but the time series."""
    path.write_text(json.dumps(result.as_dict(), indent=1, allow_nan=False) + "\n", encoding="utf-8", newline="\n")


def write_junit(result: Result, path: Path) -> None:
    """Write one test case a criterion, for continuous integration."""
    wall = {case.name: case.wall_time for case in result.cases}
    suites = junitparser.JUnitXml("emcas validate")
    for group, title in (("trajectory", "trajectory against the reference"), ("table2", "requirements of Table 2")):
        suite = junitparser.TestSuite(title)
        for criterion in (c for c in result.criteria if c.group == group):
            test = junitparser.TestCase(criterion.name, f"emcas.{group}", wall.get(criterion.name, 0.0))
            if criterion.skipped:
                test.result = [junitparser.Skipped(criterion.note)]
            elif not criterion.passed:
                test.result = [junitparser.Failure(describe(criterion), "limit missed")]
            suite.add_testcase(test)
        suites.add_testsuite(suite)
    suites.update_statistics()  # type: ignore[no-untyped-call]
    suites.write(str(path), pretty=True)


def describe(criterion: Criterion) -> str:
    """A criterion in a sentence."""
    c = criterion
    measured = "no value" if c.measured is None else f"{c.measured:.4g} {c.unit}"
    text = f"{c.title}: {measured}, required {c.sense} {c.limit:g} {c.unit}"
    return f"{text} ({c.note})" if c.note else text
