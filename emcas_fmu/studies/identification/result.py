"""Description and result of an experiment: columns, assumptions, estimates with uncertainty, notes, plots."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from itertools import combinations
from pathlib import Path
from typing import Any

from ... import __version__
from ...figures.plots import Drawing, pictures
from ...pages.page import write_page
from ...parameters import ParameterSet
from .estimation import METHOD, Fit
from .records import Record, read_records, require


@dataclass(frozen=True)
class Estimate:
    """A value with its 1-sigma uncertainty, and the value in the base set, in `unit`.

    If `parameter` is false, the model has no parameter of this `name`: the estimate is only reported.
    """

    name: str
    value: float
    sigma: float
    unit: str
    base: float | None = None
    parameter: bool = True


def estimates(fit: Fit, base: ParameterSet) -> list[Estimate]:
    """Return the estimates of the fitted values with names, which are names of parameters."""
    entries = {e.variable.name: e for e in base.entries}
    return [Estimate(name, float(value), float(sigma), entries[name].variable.unit, float(entries[name].value))
            for name, value, sigma in zip(fit.names, fit.values, fit.sigmas)]


def require_certain(estimates: Iterable[Estimate], worst: float, remedy: str) -> None:
    """Raise RecordError for an estimate whose relative 1 sigma is not below `worst`."""
    for e in estimates:
        require(e.sigma < worst * abs(e.value), f"{e.name} is not supported by the data: {e.value:.3g} +- "
                f"{e.sigma:.2g} {e.unit}; {remedy}")


@dataclass(frozen=True)
class Experiment:
    """An experiment of a `kind`: `required` and `optional` columns, parameters `assumed` known, `unit` of residuals."""

    kind: str
    title: str
    required: Sequence[str]
    optional: Sequence[str]
    assumed: Sequence[str]
    unit: str

    def read(self, paths: Sequence[Path]) -> list[Record]:
        """Read the records. Raises RecordError."""
        return read_records(paths, self.required, self.optional)


@dataclass(frozen=True)
class Identification:
    """The result of an experiment; `drawings` makes its plots."""

    experiment: Experiment
    records: Sequence[Record]
    base: ParameterSet
    fit: Fit
    estimates: Sequence[Estimate]
    notes: Sequence[str]
    drawings: Callable[[], Iterable[Drawing]]
    method = METHOD

    def __getitem__(self, name: str) -> Estimate:
        return next(e for e in self.estimates if e.name == name)

    @property
    def files(self) -> str:
        """Names of the data files, for a note: up to three, otherwise their number, the first and the last."""
        names = [r.name for r in self.records]
        return ", ".join(names) if len(names) <= 3 else f"{len(names)} files from {names[0]} to {names[-1]}"

    @property
    def assumed(self) -> dict[str, float]:
        """The assumed parameters, from the base set."""
        return {name: float(self.base.values[name]) for name in self.experiment.assumed}

    @property
    def noise(self) -> list[dict[str, Any]]:
        """Standard deviation, number and correlation time of each file's residuals."""
        fit = self.fit
        return [{"file": record.name, "residual": float(deviation), "unit": self.experiment.unit, "residuals": count,
                 "correlation_time": float(time)} for record, deviation, count, time in zip(
                     self.records, fit.deviations, fit.counts, fit.times)]

    @property
    def correlated(self) -> list[tuple[str, str, float]]:
        """Pairs of fitted values correlated by more than 0.8, strongest first, ten at most."""
        names, matrix = self.fit.names, self.fit.correlation
        pairs = [(names[i], names[j], float(matrix[i, j])) for j, i in combinations(range(len(names)), 2)
                 if abs(matrix[i, j]) > 0.8]
        return sorted(pairs, key=lambda pair: -abs(pair[2]))[:10]

    def write_report(self, path: Path) -> None:
        """Write a page with the plots; the same result gives the same bytes."""
        write_page(path, "studies/identification/report.html.j2", [self.base], result=self,
                   figures=pictures(self.drawings()), records=list(zip(self.records, self.noise)))

    def document(self) -> Mapping[str, Any]:
        """Return everything except the plots, for JSON."""
        entries = [asdict(e) for e in self.estimates]
        count = len(self.fit.names)
        return {"kind": self.experiment.kind, "title": self.experiment.title, "emcas_version": __version__,
                "method": self.method, "estimates": {entry.pop("name"): entry for entry in entries},
                "correlation": {"names": self.fit.names, "matrix": self.fit.correlation[:count, :count]},
                "given": self.assumed, "notes": self.notes, "residuals": self.noise,
                "files": [{"file": r.name, "rows": len(r), "sample_rate_hz": float(f"{1.0 / r.step:.6g}"),
                           "units": r.units, "sha256": r.sha256} for r in self.records]}
