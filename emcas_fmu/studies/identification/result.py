"""What an identification gives: estimates with uncertainty, notes, pictures, and how it was done."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from ... import __version__
from ...bench import writers
from .estimation import Fit
from .records import Array, Record, summary


@dataclass(frozen=True)
class Estimate:
    """A value with its 1-sigma uncertainty, in `unit`.

    `name` is a parameter's where `parameter` holds; otherwise the model has none and it is reported only.
    `base` is the value in the parameter set the identification started from.
    """

    name: str
    value: float
    sigma: float
    unit: str
    parameter: bool = True
    base: float | None = None


@dataclass(frozen=True)
class Picture:
    """A figure for the report, drawn when asked for."""

    title: str
    caption: str
    draw: Callable[[], Figure]


@dataclass(frozen=True)
class Identification:
    """The outcome of one experiment. `given` are the parameters it took for known."""

    kind: str
    title: str
    records: Sequence[Record]
    estimates: Sequence[Estimate]
    given: Mapping[str, float]
    method: str
    notes: Sequence[str]
    pictures: Sequence[Picture]
    correlation: tuple[Sequence[str], Array]
    noise: Sequence[Mapping[str, Any]]

    def __getitem__(self, name: str) -> Estimate:
        return next(e for e in self.estimates if e.name == name)

    @property
    def files(self) -> str:
        """Names of the data files, for a note: all of a few, else their number and the first."""
        names = [r.name for r in self.records]
        return ", ".join(names) if len(names) <= 3 else f"{len(names)} files from {names[0]} to {names[-1]}"


def noise(records: Sequence[Record], fit: Fit, groups: Sequence[Sequence[int]], unit: str) -> list[dict[str, Any]]:
    """Per file the residuals' standard deviation and correlation time."""
    return [{"file": record.name, "residual": float(deviation), "unit": unit,
             "residuals": sum(len(fit.residuals[i]) for i in members), "correlation_time": float(time)}
            for record, members, deviation, time in zip(records, groups, fit.deviations, fit.times, strict=True)]


def write_json(result: Identification, path: Path) -> None:
    """Everything but the pictures, for machines."""
    names, matrix = result.correlation
    document = {
        "kind": result.kind, "title": result.title, "emcas_version": __version__, "method": result.method,
        "estimates": {e.name: {"value": e.value, "sigma": e.sigma, "unit": e.unit, "base": e.base,
                               "parameter": e.parameter} for e in result.estimates},
        "correlation": {"names": list(names), "matrix": matrix.tolist()},
        "given": dict(result.given), "notes": list(result.notes), "residuals": list(result.noise),
        "files": [summary(r) for r in result.records],
    }
    writers.write_json(document, path)
