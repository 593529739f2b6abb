"""Distributions of factors: read from tables of a TOML file, checked, with their quantiles."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cache
from inspect import signature
from math import inf, log1p, sqrt
from typing import Annotated, Any

import numpy as np
from pydantic import Field, PlainValidator, ValidationInfo, create_model
from scipy import stats

from ...errors import EmcasError
from ...parameters import Scalar
from ...parameters.schema import In, Table, WrittenNumber, kind_of
from ...simulation import Array

# Largest permitted probability that a drawn value is outside the limits of its parameter; such a sample fails.
MOST_OUTSIDE = 1e-3
_NUMBER = re.compile(r"\s*[+-]?(?:\d[\d_]*\.?[\d_]*|\.\d[\d_]*)(?:[eE][+-]?\d+)?")


def _lognormal(mean: float, sd: float) -> Any:
    variance = log1p((sd / mean) ** 2)
    return stats.lognorm(sqrt(variance), scale=mean * np.exp(-variance / 2.0))


_CONTINUOUS: Mapping[str, Callable[..., Any]] = {
    "uniform": lambda low, high: stats.uniform(low, high - low),
    "log-uniform": lambda low, high: stats.loguniform(low, high),
    "triangular": lambda low, mode, high: stats.triang((mode - low) / (high - low), low, high - low),
    "normal": lambda mean, sd: stats.norm(mean, sd),
    "truncated-normal": lambda mean, sd, low, high: stats.truncnorm((low - mean) / sd, (high - mean) / sd, mean, sd),
    "lognormal": _lognormal,
}
# Keys of each kind of distribution in a file; the default of `mean` is the value of the base set.
DISTRIBUTIONS: Mapping[str, tuple[str, ...]] = {
    **{kind: tuple(signature(make).parameters) for kind, make in _CONTINUOUS.items()}, "choice": ("levels", "weights")}


@cache
def _frozen(kind: str, *numbers: float) -> Any:
    return _CONTINUOUS[kind](*numbers)


class CampaignError(EmcasError):
    """A campaign that cannot be read or run; the message names the file, the entry and the remedy."""


@dataclass(frozen=True)
class Distribution:
    """A distribution in its entry's unit: its `numbers` by key, or the `levels` of a choice with `cumulated` shares."""

    kind: str
    numbers: Mapping[str, float]
    levels: tuple[Scalar, ...] = ()
    cumulated: tuple[float, ...] = ()

    def at(self, probability: Array | float) -> Array:
        """Return the quantiles at probabilities between 0 and 1, in the shape of `probability`."""
        if self.kind == "choice":
            index = np.searchsorted(self.cumulated, probability, side="right")
            return np.asarray(self.levels, dtype=float)[np.minimum(index, len(self.levels) - 1)]
        values: Array = np.asarray(_frozen(self.kind, *self.numbers.values()).ppf(probability), dtype=float)
        return values

    def limits(self, outside: float = 0.0) -> tuple[float, float]:
        """Return the smallest and the largest value; a tail is cut where a probability `outside` remains beyond it."""
        if self.kind == "choice":
            return float(min(self.levels)), float(max(self.levels))
        if "low" in self.numbers:
            return self.numbers["low"], self.numbers["high"]
        return float(self.at(outside)), float(self.at(1.0 - outside))


@dataclass(frozen=True)
class Factor:
    """A parameter or other number that varies between samples, in `unit`; `type` is Real, Integer or Boolean."""

    name: str
    unit: str
    type: str
    distribution: Distribution

    def value(self, drawn: Any) -> Any:
        """Return a drawn number, or an array of drawn numbers, in the factor's type."""
        typed = np.asarray(drawn).astype({"Boolean": bool, "Integer": np.int64, "Real": float}[self.type])
        return typed if typed.ndim else typed.item()


def _deviation(written: Any, info: ValidationInfo) -> float:
    """Return a standard deviation in the entry's unit; the file has a percentage of the mean, or a quantity."""
    unit: Any = info.context
    text = str(written).strip()
    if text.endswith("%") and unit.unit == "degC":
        raise ValueError("a percentage of a temperature has no meaning; write a difference such as 5 K")
    deviation = float(replace(unit, base=abs(info.data.get("mean", 0.0))).number(written))
    if unit.unit == "degC":  # number() converts a difference of 5 degC or 5 K as a temperature: subtract its offset
        deviation -= float(unit.number(_NUMBER.sub("0", text, count=1)))
    return deviation


def _mean(written: Any, info: ValidationInfo) -> float:
    unit: Any = info.context
    if written is None and unit.base is None:
        raise ValueError("is missing; this entry has no default")
    return float(unit.base if written is None else unit.number(written))


_FIELDS: Mapping[str, Any] = {
    "mean": (Annotated[float, PlainValidator(_mean), Field(validate_default=True)], None),
    "sd": (Annotated[float, PlainValidator(_deviation)], ...),
    "levels": (Annotated[list[WrittenNumber], Field(min_length=1)], ...),
    "weights": (list[float] | None, None),
    **dict.fromkeys(("low", "mode", "high"), (WrittenNumber, ...)),
}
_TABLES: Mapping[str, type[Table]] = {
    kind: create_model(kind, __base__=Table, distribution=(str, kind), **{key: _FIELDS[key] for key in keys})
    for kind, keys in DISTRIBUTIONS.items()}


class _EvenLevels(Table):
    """Equidistant levels."""

    low: WrittenNumber
    high: WrittenNumber
    count: Annotated[int, Field(ge=2, le=1_000_000)]


def distribution(written: Mapping[str, Any], unit: In) -> Distribution:
    """Return the distribution that a table describes, in `unit`. Raises ValueError or ValidationError."""
    if "count" in written and "distribution" not in written:
        even = _EvenLevels.model_validate(written, context=unit)
        width = even.high - even.low
        written = {"levels": [f"{even.low + width * k / (even.count - 1)!r}{unit.suffix}" for k in range(even.count)]}
    entries = {"distribution": "choice", **written} if "levels" in written else written
    kind = kind_of(entries, DISTRIBUTIONS, "distribution")
    if kind != "choice" and unit.type != "Real":
        raise ValueError(f"{'true and false have' if unit.type == 'Boolean' else 'a whole number has'} no such "
                         "distribution; write levels = [...]")
    table: Any = _TABLES[kind].model_validate(written, context=unit)
    return _checked(_choice(tuple(table.levels), table.weights) if kind == "choice" else
                    Distribution(kind, {key: getattr(table, key) for key in DISTRIBUTIONS[kind]}), unit)


def _checked(read: Distribution, unit: In) -> Distribution:
    """Return a distribution. Raises ValueError if its numbers contradict each other or its values exceed the limits."""
    n, suffix = read.numbers, unit.suffix
    if "low" in n and not n["low"] < n["high"]:
        raise ValueError(f"low = {n['low']:g} must be below high = {n['high']:g}{suffix}")
    if "mode" in n and not n["low"] <= n["mode"] <= n["high"]:
        raise ValueError(f"mode = {n['mode']:g} must be within {n['low']:g} .. {n['high']:g}{suffix}")
    if "sd" in n and not n["sd"] > 0.0:
        raise ValueError(f"sd = {n['sd']:g}{suffix}: must be above 0 (a percentage refers to the mean)")
    for kind, key in (("lognormal", "mean"), ("log-uniform", "low")):
        if read.kind == kind and not n[key] > 0.0:
            raise ValueError(f"{key} = {n[key]:g}: a {kind} distribution needs a {key} above 0")
    if read.kind == "truncated-normal" and np.isnan(read.at(0.5)):
        raise ValueError("low and high are too far from the mean for this sd; move them, or increase the sd")
    low, high = read.limits()
    if "low" in n or read.kind == "choice":
        outside, remedy = float(low < unit.minimum or high > unit.maximum), ""
    else:  # with tails
        law = _frozen(read.kind, *n.values())
        outside = float(law.cdf(unit.minimum) + law.sf(unit.maximum))
        remedy = f": a share of {outside:.2g} of the samples does not; use distribution = \"truncated-normal\""
    if outside > MOST_OUTSIDE:
        raise ValueError(f"must stay {unit.limits}{remedy}")
    return read


def _choice(levels: tuple[Scalar, ...], weights: list[float] | None) -> Distribution:
    shares = [1.0] * len(levels) if weights is None else weights
    if len(shares) != len(levels) or not all(0.0 < w < inf for w in shares):
        raise ValueError(f"weights must be {len(levels)} finite numbers above 0, one for each level")
    cumulated = np.cumsum(shares)
    return Distribution("choice", {}, levels, tuple((cumulated / cumulated[-1]).tolist()))
