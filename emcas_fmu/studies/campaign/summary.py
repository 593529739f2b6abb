"""Summarise a campaign: percentiles of every figure, sensitivities with their uncertainty, the worst samples."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from math import atanh, inf, isfinite, nan, sqrt, tanh
from typing import Any

import numpy as np
import pyarrow as pa
from scipy import stats

from ... import __version__
from ...actuators import NONLINEAR
from ...bench.measure import bound
from ...bench.metrics import Figure, shown
from ...pages.numbers import rounded
from ...simulation import Array
from .experiments import REQUIREMENT, lacking
from .extension_outputs import Finding, findings, tallies
from .quantiles import CONFIDENCE, PERCENTILES, Chance, percentiles
from .sample import OK, columns
from .study import Campaign

WORST = 3  # samples listed for each figure
_FEWEST = 10  # smallest number of samples for sensitivities
# Largest differences that count as rounding errors: relative to the largest value, and absolute [SI] for figures that
# are almost zero, such as errors that have decayed.
_RELATIVE, _ABSOLUTE = 1e-9, 1e-12
_NUMBER = re.compile(r"(?<!\S)[(),;:]*[+-]?(?:\d+\.?\d*(?:e[+-]?\d+)?|inf|nan)[(),;:]*(?!\S)")


@dataclass(frozen=True)
class Effect:
    """Sensitivity of a figure to a factor: Spearman's rank correlation with its 95 % interval (`low` to `high`), and
    the standardised coefficient in a linear regression on all factors with its standard error."""

    factor: str
    rank_correlation: float
    low: float
    high: float
    standardised_coefficient: float
    standard_error: float

    @property
    def sure(self) -> bool:
        """Whether the interval of the rank correlation excludes zero."""
        return self.low > 0.0 or self.high < 0.0


@dataclass(frozen=True)
class Spread:
    """The distribution of a figure [SI] over the samples that did not fail; `name` is the column's name.

    `values` are the finite values, with their `mean` and `sd`; `without` is the number of samples without a finite
    value. `percentiles`, `smallest` and `largest` include these samples: a figure that does not exist counts as an
    infinite value, worse than all others. `explained` is the share of the variance that the regression explains.
    `worst` has pairs of sample index and figure, the worst first.
    """

    name: str
    figure: Figure
    values: Array
    without: int
    mean: float
    sd: float
    percentiles: Mapping[int, float]
    smallest: float
    largest: float
    explained: float
    effects: tuple[Effect, ...]
    worst: tuple[tuple[int, float], ...]

    @property
    def varies(self) -> bool:
        """Whether the figure differs between samples by more than rounding errors."""
        return varies(np.array([self.smallest, self.largest]), _ABSOLUTE)


@dataclass(frozen=True)
class Summary:
    """The results of a campaign; `done` is the number of samples that were run, including those that failed."""

    study: Campaign
    done: int
    spreads: tuple[Spread, ...]
    failures: tuple[tuple[str, int, int], ...]
    """For each reason: message, number of samples, and index of the first sample."""
    tallies: Mapping[str, Mapping[str, int]]
    findings: tuple[Finding, ...]
    chances: tuple[Chance, ...]
    """One for each requirement, then one for all requirements together."""

    @property
    def by_name(self) -> Mapping[str, Spread]:
        """The figures by the names of their columns."""
        return {s.name: s for s in self.spreads}

    def spreads_of(self, experiment: str) -> list[Spread]:
        """Return the figures of an experiment."""
        return [s for s in self.spreads if s.name.startswith(f"{experiment}.")]

    @property
    def failed(self) -> int:
        """Number of samples that failed."""
        return sum(count for _, count, _ in self.failures)


def summarise(study: Campaign, table: pa.Table) -> Summary:
    """Return the summary of the rows of a campaign, of which some may still be missing."""
    good = table.filter(pa.compute.equal(table["status"], OK))
    factors = {f.name: np.asarray(good[f.name].to_numpy(), dtype=float) for f in study.factors}
    parameters = {name: x for name, x in factors.items() if name in study.base}
    index = good["index"].to_numpy()
    spreads = tuple(_spread(name, figure, good[name].to_numpy(), index,
                            parameters if name.startswith(f"{REQUIREMENT}.") else factors)
                    for name, figure in columns(study).items()) if good.num_rows else ()
    requirements = study.specification.requirements if table.num_rows else ()
    kept = [r.kept(table[f"{REQUIREMENT}.{r.name}"].to_numpy()) for r in requirements]
    chances = tuple(Chance(r, int(np.sum(met)), table.num_rows) for r, met in zip(
        (*requirements, None), (*kept, np.all(kept, axis=0)), strict=True)) if requirements else ()
    return Summary(study, table.num_rows, spreads, _failures(table), tallies(study, good),
                   tuple(findings(study, good)), chances)


def _failures(table: pa.Table) -> tuple[tuple[str, int, int], ...]:
    """Return the reasons for failures by frequency; … replaces numbers in messages, which differ between samples."""
    bad = table.filter(pa.compute.not_equal(table["status"], OK))
    samples: dict[str, list[int]] = {}
    for index, error in zip(bad["index"].to_pylist(), bad["error"].to_pylist(), strict=True):
        reason = _NUMBER.sub("…", error.partition("\n")[0]) or "no reason given"
        samples.setdefault(reason, []).append(index)
    return tuple(sorted(((reason, len(indices), indices[0]) for reason, indices in samples.items()),
                        key=lambda failure: -failure[1]))


def _spread(name: str, figure: Figure, values: Array, index: Array, factors: Mapping[str, Array]) -> Spread:
    # A missing figure, such as the time to a level that is never reached, is worse than any other.
    ordered = np.where(np.isnan(values), figure.bad * inf, values)
    shares = percentiles(ordered, PERCENTILES)
    finite = values[np.isfinite(values)]
    worst = np.lexsort((index, -figure.bad * ordered))[:WORST]
    # Factors of other experiments do not affect this one, but would sometimes seem to do so by chance.
    acting = {factor: x for factor, x in factors.items()
              if not factor.startswith("experiments.") or factor.startswith(f"experiments.{name.partition('.')[0]}.")}
    explained, effects = sensitivities(ordered, acting)
    mean, sd = (float(finite.mean()), float(finite.std())) if len(finite) else (nan, nan)
    return Spread(
        name, figure, finite, len(values) - len(finite), mean, sd, shares,
        float(ordered.min()), float(ordered.max()), explained, effects,
        tuple((int(index[k]), float(ordered[k])) for k in worst))


def varies(values: Array, rounding: float = 0.0) -> bool:
    """Return whether values differ by more than relative rounding errors and the absolute error `rounding`."""
    finite = values[np.isfinite(values)]
    if not len(finite) or len(finite) < len(values):
        return len(np.unique(values)) > 1
    return bool(np.ptp(finite) > max(rounding, _RELATIVE * float(np.abs(finite).max())))


def sensitivities(figure: Array, factors: Mapping[str, Array]) -> tuple[float, tuple[Effect, ...]]:
    """Return the share of the variance that a regression explains, and the effects of factors on a figure.

    `figure` and each factor are arrays [samples]. Ranks use all samples, including infinite figures; the regression
    uses the finite figures. Too few samples give nan and no effects; a factor or figure that varies only by rounding
    errors has no effect. The interval of a rank correlation is Fisher's, with the variance (1 + r^2/2)/(n - 3) of
    Bonett and Wright (2000).
    """
    varying = {name: x for name, x in factors.items() if varies(x)}
    if len(figure) < max(_FEWEST, len(varying) + 3) or not varying or not varies(figure, _ABSOLUTE):
        return nan, ()
    coefficients, errors, explained = _regression(figure, varying)
    ranks = [float(stats.spearmanr(x, figure).statistic) for x in varying.values()]
    effects = [Effect(name, rank, *_interval(rank, len(figure)), coefficient, error)
               for name, rank, coefficient, error in zip(varying, ranks, coefficients, errors, strict=True)]
    return explained, tuple(sorted(effects, key=lambda e: -abs(e.rank_correlation)))


def _interval(rank: float, n: int) -> tuple[float, float]:
    if abs(rank) >= 1.0:
        return rank, rank
    half = float(stats.norm.ppf(0.5 + CONFIDENCE / 2.0)) * sqrt((1.0 + rank**2 / 2.0) / (n - 3))
    return tanh(atanh(rank) - half), tanh(atanh(rank) + half)


def _regression(figure: Array, factors: Mapping[str, Array]) -> tuple[list[float], list[float], float]:
    """Return standardised coefficients (least squares), their standard errors and the explained share of variance."""
    finite = np.isfinite(figure)
    x, y = np.column_stack([column[finite] for column in factors.values()]), figure[finite]
    n, count = x.shape
    if n < count + 3 or not varies(y, _ABSOLUTE) or not all(map(varies, x.T)):
        return [nan] * count, [nan] * count, nan
    x, y = (x - x.mean(axis=0)) / x.std(axis=0), (y - y.mean()) / y.std()
    coefficients, *_ = np.linalg.lstsq(x, y)
    residual = float(np.sum((y - x @ coefficients) ** 2))
    errors = np.sqrt(residual / (n - count - 1) * np.diag(np.linalg.pinv(x.T @ x)))
    return coefficients.tolist(), errors.tolist(), 1.0 - residual / n


def text(figure: Figure, value: float) -> str:
    """Return a figure [SI] as text in the unit that is shown, without the unit; in words if it is not finite."""
    if isfinite(value):
        return rounded(value * shown(figure.unit)[1], ".4g")
    if value * figure.bad > 0.0:
        return "not reached"
    return "–" if value != value else "beyond the sweep" if value > 0.0 else "no response"


def measured(spread: Spread, value: float) -> str:
    """Return a figure [SI] as `text` does; a bandwidth that is only a bound is marked by < or >, and 0 is in words."""
    if spread.figure.unit != "Hz" or not isfinite(value):
        return text(spread.figure, value)
    if spread.name.startswith(f"{REQUIREMENT}."):
        return bound(value) + text(spread.figure, value)
    return text(spread.figure, value) if value else "below the sweep"


def _requirements(summary: Summary) -> dict[str, Any]:
    """Return the requirements with the numbers of samples that meet them, for JSON; empty without requirements."""
    if not summary.chances:
        return {}
    *each, together = ({"met": c.met, "samples": c.samples, "share": c.share, "low": c.interval[0],
                        "high": c.interval[1]} for c in summary.chances)
    specification = summary.study.specification
    names = ("name", "title", "source", "how", "sense", "limit", "unit", "cases")
    return {"requirements": {
        "file": specification.file, "confidence": CONFIDENCE, "all": together,
        "each": [{**{name: getattr(r, name) for name in names}, **counts}
                 for r, counts in zip(specification.requirements, each, strict=True)],
        "not_judged": {j.name: j.note for j in summary.study.left_out}}}


def as_dict(summary: Summary, command: str) -> dict[str, Any]:
    """Return the summary for JSON, in SI; `command` runs the campaign."""
    study = summary.study
    of_model = {} if study.model == NONLINEAR else {
        "model": study.actuator.name, "left_out": lacking(study.model),
        "tallies": [{"name": name, "samples": counts} for name, counts in summary.tallies.items()],
        "findings": [asdict(finding) for finding in summary.findings]}
    return {
        "schema": "emcas-campaign-summary/2", "version": __version__, "guid": study.guid, "command": command,
        "method": study.method, "seed": study.seed, "samples": study.samples, "done": summary.done,
        "failed": summary.failed, "runs": "FMU" if study.fmu else "kernel", "fmu_sha256": study.fmu_sha256,
        "fin": study.fin, **of_model,
        "factors": [{"name": f.name, "unit": f.unit, "distribution": f.distribution.kind, **f.distribution.numbers,
                     **({"levels": f.distribution.levels} if f.distribution.levels else {})} for f in study.factors],
        "follow": dict(study.followers),
        "failures": [{"error": e, "samples": n, "first": first} for e, n, first in summary.failures],
        **_requirements(summary),
        "figures": [{
            "name": s.name, "unit": s.figure.unit, "title": s.figure.title, "samples": len(s.values) + s.without,
            "without": s.without, "mean": s.mean, "sd": s.sd, "smallest": s.smallest, "largest": s.largest,
            "percentiles": s.percentiles, "explained": s.explained, "sensitivities": [asdict(e) for e in s.effects],
            "worst": [{"index": index, "value": value} for index, value in s.worst]} for s in summary.spreads],
    }
