"""Description and result of an experiment: columns, assumptions, estimates with uncertainty, notes, plots.

A parameter file gets the identified values and the values of the base set that differ from the defaults: each
experiment can start from the file that the previous one has written.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from itertools import combinations
from math import floor, log10
from pathlib import Path
from typing import Any

from ... import __version__
from ...pages.page import write_page
from ...parameters import IDENTIFIED, MeasuredRecord, ParameterSet, file_entry, write_parameters
from ...plotting.plots import Drawing, pictures
from .estimation import METHOD, Fit
from .records import RecordFile, require

_REMARK = "Reported, no parameter: "


@dataclass(frozen=True)
class Estimate:
    """An estimated `value` with its 1 `sigma`, and the value in the `base` set (None without one), all in `unit`.

    If `parameter` is false, the model has no parameter with this `name`, and the estimate is only reported.
    """

    name: str
    value: float
    sigma: float
    unit: str
    base: float | None = None
    parameter: bool = True


def estimates(fit: Fit, base: ParameterSet) -> list[Estimate]:
    """Return the estimates of a fit's named values, which are parameters of the `base` set."""
    entries = {e.variable.name: e for e in base.entries}
    return [Estimate(name, float(value), float(sigma), entries[name].variable.unit, float(entries[name].value))
            for name, value, sigma in zip(fit.names, fit.values, fit.sigmas)]


def require_certain(estimates: Iterable[Estimate], worst: float, remedy: str) -> None:
    """Raise RecordError for an estimate whose relative 1 sigma is not below `worst`."""
    for e in estimates:
        require(e.sigma < worst * abs(e.value), f"{e.name} is not supported by the data: {e.value:.3g} +- "
                f"{e.sigma:.2g} {e.unit}; {remedy}")


@dataclass(frozen=True)
class IdentificationExperiment:
    """An experiment: its `required` and `optional` columns, the `assumed` parameters, and the `unit` of residuals."""

    kind: str
    title: str
    required: Sequence[str]
    optional: Sequence[str]
    assumed: Sequence[str]
    unit: str


@dataclass(frozen=True)
class Identification:
    """The result of an experiment; `drawings` returns its plots."""

    experiment: IdentificationExperiment
    records: Sequence[RecordFile]
    base: ParameterSet
    fit: Fit
    estimates: Sequence[Estimate]
    notes: Sequence[str]
    drawings: Callable[[], Iterable[Drawing]]
    method = METHOD
    template = "studies/identification/report.html.j2"

    def __getitem__(self, name: str) -> Estimate:
        return next(e for e in self.estimates if e.name == name)

    @property
    def files(self) -> str:
        """Names of the record files for a note; of more than three: their number, the first and the last name."""
        names = [r.name for r in self.records]
        return ", ".join(names) if len(names) <= 3 else f"{len(names)} files from {names[0]} to {names[-1]}"

    @property
    def assumed(self) -> dict[str, float]:
        """The assumed parameters with their values [SI] in the base set."""
        return {name: float(self.base.values[name]) for name in self.experiment.assumed}

    @property
    def noise(self) -> list[dict[str, Any]]:
        """Standard deviation, number and correlation time [samples] of each file's residuals."""
        fit = self.fit
        return [{"file": record.name, "residual": float(deviation), "unit": self.experiment.unit, "residuals": count,
                 "correlation_time": float(time)} for record, deviation, count, time in zip(
                     self.records, fit.deviations, fit.counts, fit.times)]

    @property
    def residuals(self) -> list[tuple[RecordFile, dict[str, Any]]]:
        """The records, each with the `noise` of its residuals."""
        return list(zip(self.records, self.noise, strict=True))

    @property
    def measured(self) -> list[MeasuredRecord]:
        """The records with their residuals, for the comments in a parameter file."""
        return [MeasuredRecord("", r.name, r.sha256, f"fitted, residual {noise['residual']:.2g} {noise['unit']}")
                for r, noise in self.residuals]

    @property
    def correlated(self) -> list[tuple[str, str, float]]:
        """Pairs of fitted values with a correlation above 0.8 in magnitude; the ten strongest, in falling order."""
        names, matrix = self.fit.names, self.fit.correlation
        pairs = [(names[i], names[j], float(matrix[i, j])) for j, i in combinations(range(len(names)), 2)
                 if abs(matrix[i, j]) > 0.8]
        return sorted(pairs, key=lambda pair: -abs(pair[2]))[:10]

    def write_report(self, path: Path) -> None:
        """Write a page with estimates and plots; the same result gives the same bytes."""
        write_page(path, self.template, [self.base], result=self, figures=pictures(self.drawings()))

    def document(self) -> Mapping[str, Any]:
        """Return the result for JSON, without the plots."""
        entries = [asdict(e) for e in self.estimates]
        count = len(self.fit.names)
        return {"kind": self.experiment.kind, "title": self.experiment.title, "emcas_version": __version__,
                "method": self.method, "estimates": {entry.pop("name"): entry for entry in entries},
                "correlation": {"names": self.fit.names, "matrix": self.fit.correlation[:count, :count]},
                "given": self.assumed, "notes": self.notes, "residuals": self.noise,
                "files": [{"file": r.name, "rows": len(r), "sample_rate_hz": float(f"{1.0 / r.step:.6g}"),
                           "units": r.units, "sha256": r.sha256} for r in self.records]}


def write_identified(result: Identification, path: Path, base_files: Iterable[Path] = ()) -> None:
    """Write a parameter file: the base set with the identified values, and the remarks of the `base_files`.

    Raises ParameterError if the values break limits or rules.
    """
    sizes = Counter(_array(e.variable.name) for e in result.base.entries)
    identified = [e for e in result.estimates if e.parameter]
    changes: dict[str, object] = {}
    for array in dict.fromkeys(_array(e.name) for e in identified):
        elements = [e for e in identified if _array(e.name) == array]
        entries = {array: elements} if len(elements) == sizes[array] else {e.name: [e] for e in elements}
        for name, members in entries.items():
            changes[name] = file_entry([_rounded(e) for e in members], members[0].unit, IDENTIFIED,
                                       _note(result, members))
    first = (f"Identified by emcas {__version__} ({result.experiment.kind}); values, units, 1-sigma uncertainties in "
             "the notes.")
    write_parameters(result.base.with_values(changes), path, [
        first, *(record.comment for record in result.measured), *_remarks(result, base_files)])


def _array(name: str) -> str:
    return name.partition("[")[0]


def _remarks(result: Identification, base_files: Iterable[Path]) -> list[str]:
    """Return remarks on estimates that are not parameters: those in the base files without a new one, then new ones."""
    new = [f"{_REMARK}{e.name} = {_rounded(e):g} {e.unit} (1 sigma {e.sigma:.2g}; {result.files})"
           for e in result.estimates if not e.parameter]
    replaced = tuple(line.partition(" = ")[0] + " = " for line in new)
    lines = [line.removeprefix("# ") for file in base_files
             for line in file.read_text(encoding="utf-8-sig").splitlines()]
    return [*(line for line in lines if line.startswith(_REMARK) and not line.startswith(replaced)), *new]


def _rounded(estimate: Estimate) -> float:
    """Return the value, rounded to the third significant digit of its sigma, as more digits are noise."""
    if not estimate.sigma > 0.0:
        return estimate.value
    return round(estimate.value, 2 - floor(log10(estimate.sigma))) + 0.0  # no -0


def _note(result: Identification, estimates: Sequence[Estimate]) -> str:
    sigmas = ", ".join(f"{e.sigma:.2g}" for e in estimates)
    unit = "" if estimates[0].unit == "1" else f" {estimates[0].unit}"
    return f"1 sigma {f'[{sigmas}]' if len(estimates) > 1 else sigmas}{unit}; {result.files}"
