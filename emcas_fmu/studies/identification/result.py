"""The outcome of an identification: estimates with uncertainty, notes, pictures, and how it was done."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from itertools import combinations
from pathlib import Path
from typing import Any

from ... import __version__
from ...bench.writers import write_page
from ...figures.plots import Drawing, pictures
from ...parameters import ParameterSet
from .estimation import METHOD, Fit
from .records import Record, RecordError


@dataclass(frozen=True)
class Estimate:
    """A value with its 1-sigma uncertainty and its value in the base set, in `unit`.

    `name` is a parameter's where `parameter` holds; otherwise the model has none and it is reported only.
    """

    name: str
    value: float
    sigma: float
    unit: str
    base: float | None = None
    parameter: bool = True


def estimates(fit: Fit, base: ParameterSet) -> list[Estimate]:
    """Return the fitted values with names, which are those of parameters."""
    entries = {e.variable.name: e for e in base.entries}
    return [Estimate(name, float(value), float(sigma), entries[name].variable.unit, float(entries[name].value))
            for name, value, sigma in zip(fit.names, fit.values, fit.sigmas)]


def require_certain(estimates: Iterable[Estimate], worst: float, remedy: str) -> None:
    """Raise RecordError for an estimate whose relative 1 sigma is not below `worst`."""
    for e in estimates:
        if not e.sigma < worst * abs(e.value):
            raise RecordError(f"{e.name} is not supported by the data: {e.value:.3g} +- {e.sigma:.2g} {e.unit}; "
                              f"{remedy}")


@dataclass(frozen=True)
class Identification:
    """The outcome of one experiment.

    The residuals of the `fit` are in `unit`, a group per record. `assumed` are the parameters taken from the `base`
    set. `drawings` makes the pictures.
    """

    kind: str
    title: str
    records: Sequence[Record]
    base: ParameterSet
    assumed: Sequence[str]
    fit: Fit
    unit: str
    estimates: Sequence[Estimate]
    notes: Sequence[str]
    drawings: Callable[[], Iterable[Drawing]]
    method = METHOD

    def __getitem__(self, name: str) -> Estimate:
        return next(e for e in self.estimates if e.name == name)

    @property
    def files(self) -> str:
        """Names of the data files, for a note: all of a few, else their number and the first."""
        names = [r.name for r in self.records]
        return ", ".join(names) if len(names) <= 3 else f"{len(names)} files from {names[0]} to {names[-1]}"

    @property
    def given(self) -> dict[str, float]:
        """The assumed parameters."""
        return {name: float(self.base.values[name]) for name in self.assumed}

    @property
    def noise(self) -> list[dict[str, Any]]:
        """Per file the residuals' standard deviation and correlation time."""
        fit = self.fit
        return [{"file": record.name, "residual": float(deviation), "unit": self.unit,
                 "residuals": sum(len(fit.residuals[i]) for i in members), "correlation_time": float(time)}
                for record, members, deviation, time in zip(self.records, fit.groups, fit.deviations, fit.times)]

    @property
    def correlated(self) -> list[tuple[str, str, float]]:
        """Pairs of fitted values correlated by more than 0.8, strongest first, ten at most."""
        names, matrix = self.fit.names, self.fit.correlation
        pairs = [(names[i], names[j], float(matrix[i, j])) for j, i in combinations(range(len(names)), 2)
                 if abs(matrix[i, j]) > 0.8]
        return sorted(pairs, key=lambda pair: -abs(pair[2]))[:10]

    def write_report(self, path: Path) -> None:
        """Write a page with the pictures; the same result gives the same bytes."""
        write_page(path, "studies/identification/report.html.j2", [self.base], result=self,
                   figures=pictures(self.drawings()), records=list(zip(self.records, self.noise)))

    def document(self) -> Mapping[str, Any]:
        """Return everything but the pictures, for JSON."""
        entries = [asdict(e) for e in self.estimates]
        count = len(self.fit.names)
        return {"kind": self.kind, "title": self.title, "emcas_version": __version__, "method": self.method,
                "estimates": {entry.pop("name"): entry for entry in entries},
                "correlation": {"names": self.fit.names, "matrix": self.fit.correlation[:count, :count]},
                "given": self.given, "notes": self.notes, "residuals": self.noise,
                "files": [{"file": r.name, "rows": len(r), "sample_rate_hz": float(f"{1.0 / r.step:.6g}"),
                           "units": r.units, "sha256": r.sha256} for r in self.records]}
