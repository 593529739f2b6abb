"""How an entry of a campaign is distributed: from a table in a TOML file to values for numbers between 0 and 1."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from math import inf, log1p, sqrt
from typing import Any

import numpy as np
from scipy import stats

from ..errors import EmcasError, hint, require_known
from ..simulation import Array
from ..units import UnitError, describe, quantity

Value = float | int | bool
# Of all samples, how many may lie outside the limits before the entry is refused: tails fail one by one.
MOST_OUTSIDE = 1e-3
_NUMBER = re.compile(r"\s*[+-]?(?:\d[\d_]*\.?[\d_]*|\.\d[\d_]*)(?:[eE][+-]?\d+)?")
# The numbers of each kind; a `mean` left out is the value of the base set.
KINDS: Mapping[str, tuple[str, ...]] = {
    "uniform": ("low", "high"),
    "log-uniform": ("low", "high"),
    "triangular": ("low", "mode", "high"),
    "normal": ("mean", "sd"),
    "truncated-normal": ("mean", "sd", "low", "high"),
    "lognormal": ("mean", "sd"),
    "choice": ("levels",),
}


class CampaignError(EmcasError):
    """A campaign that cannot be used or carried out; the message names file, entry and remedy."""


@dataclass(frozen=True)
class Kind:
    """What an entry is: its unit and limits, and the value (table's unit) a percentage of it refers to."""

    where: str
    unit: str
    minimum: float = -inf
    maximum: float = inf
    base: float | None = None
    type: str = "Real"


@dataclass(frozen=True)
class Distribution:
    """`numbers` by name in the entry's unit; `levels` of a choice, each with the share of samples up to it."""

    kind: str
    numbers: Mapping[str, float]
    levels: tuple[Value, ...] = ()
    cumulated: tuple[float, ...] = ()

    def __reduce__(self) -> tuple[Any, ...]:  # SciPy's object is large, and made again where it is needed
        return type(self), (self.kind, self.numbers, self.levels, self.cumulated)

    @cached_property
    def _frozen(self) -> Any:
        n = self.numbers
        if self.kind in ("uniform", "log-uniform"):
            make = stats.uniform if self.kind == "uniform" else stats.loguniform
            return make(n["low"], n["high"] - n["low"]) if self.kind == "uniform" else make(n["low"], n["high"])
        width = n["high"] - n["low"] if "high" in n else 0.0
        if self.kind == "triangular":
            return stats.triang((n["mode"] - n["low"]) / width, n["low"], width)
        if self.kind == "lognormal":
            variance = log1p((n["sd"] / n["mean"]) ** 2)
            return stats.lognorm(sqrt(variance), scale=n["mean"] * np.exp(-variance / 2.0))
        if self.kind == "truncated-normal":
            ends = ((n[side] - n["mean"]) / n["sd"] for side in ("low", "high"))
            return stats.truncnorm(*ends, n["mean"], n["sd"])
        return stats.norm(n["mean"], n["sd"])

    def at(self, share: Array | float) -> Array:
        """Values in the entry's unit below which the given shares (0 to 1, any shape) of all samples lie."""
        if self.kind == "choice":
            which = np.searchsorted(self.cumulated, share, side="right")
            return np.asarray(self.levels, dtype=float)[np.minimum(which, len(self.levels) - 1)]
        found: Array = np.asarray(self._frozen.ppf(share), dtype=float)
        return found

    def limits(self, outside: float = 0.0) -> tuple[float, float]:
        """Values all samples lie between, but for a share `outside` at either end of one with tails."""
        if self.kind == "choice":
            return float(min(self.levels)), float(max(self.levels))
        if "low" in self.numbers:
            return self.numbers["low"], self.numbers["high"]
        return float(self.at(outside)), float(self.at(1.0 - outside))

    def outside(self, minimum: float, maximum: float) -> float:
        """Share of samples outside two limits."""
        if self.kind == "choice":
            values = np.asarray(self.levels, dtype=float)
            return float(np.mean((values < minimum) | (values > maximum)))
        if "low" in self.numbers:  # a bounded one has no tails: all of it must be inside
            return float(self.numbers["low"] < minimum or self.numbers["high"] > maximum)
        return float(self._frozen.cdf(minimum) + self._frozen.sf(maximum))


def distribution(written: Mapping[str, Any], kind: Kind) -> Distribution:
    """The distribution a table describes. Raises CampaignError, naming the entry."""
    name = written.get("distribution", "choice" if "levels" in written else None)
    if name not in KINDS:
        raise CampaignError(f"{kind.where}: distribution = {name!r}{hint(name, KINDS)}; there is {', '.join(KINDS)}")
    keys = KINDS[name]
    weights = ("weights",) if name == "choice" else ()
    require_known(written, ("distribution", *keys, *weights), kind.where, CampaignError)
    if name == "choice":
        return _choice(written, kind)
    if kind.type != "Real":
        raise CampaignError(f"{kind.where}: {'true and false have' if kind.type == 'Boolean' else 'a whole number has'}"
                            " no such distribution; give levels = [...]")
    numbers: dict[str, float] = {}
    for key in keys:
        if key not in written and not (key == "mean" and kind.base is not None):
            raise CampaignError(f"{kind.where}: {key} is missing; a {name} distribution has {', '.join(keys)}")
        if key == "sd":
            numbers[key] = _deviation(written[key], kind, numbers["mean"])
        else:
            numbers[key] = number(written[key], kind, key) if key in written else float(kind.base or 0.0)
    found = Distribution(name, numbers)
    _sound(found, kind)
    return found


def _sound(found: Distribution, kind: Kind) -> None:
    n, where = found.numbers, kind.where
    if "low" in n and not n["low"] < n["high"]:
        raise CampaignError(f"{where}: low = {n['low']:g} must be below high = {n['high']:g} {kind.unit}")
    if "mode" in n and not n["low"] <= n["mode"] <= n["high"]:
        raise CampaignError(f"{where}: mode = {n['mode']:g} must be within {n['low']:g} .. {n['high']:g} {kind.unit}")
    if "sd" in n and not n["sd"] > 0.0:
        raise CampaignError(f"{where}: sd = {n['sd']:g} {kind.unit}: must be above 0 (a percentage is one of the mean)")
    if found.kind == "lognormal" and not n["mean"] > 0.0:
        raise CampaignError(f"{where}: mean = {n['mean']:g}: a lognormal needs a mean above 0")
    if found.kind == "log-uniform" and not n["low"] > 0.0:
        raise CampaignError(f"{where}: low = {n['low']:g}: a log-uniform needs a low above 0")
    if found.kind == "truncated-normal" and found._frozen.ppf(0.5) != found._frozen.ppf(0.5):
        raise CampaignError(f"{where}: low and high are too far from the mean for a normal distribution")
    inside(found, kind)


def inside(found: Distribution, kind: Kind) -> None:
    """Raise CampaignError for what lies outside the entry's limits, but for tails."""
    share = found.outside(kind.minimum, kind.maximum)
    if share > (0.0 if found.kind == "choice" else MOST_OUTSIDE):
        remedy = "" if found.kind == "choice" or "low" in found.numbers else (
            f": {share:.2g} of the samples are not; truncate it (distribution = \"truncated-normal\")")
        raise CampaignError(f"{kind.where}: must stay within {kind.minimum:g} .. {kind.maximum:g} {kind.unit}{remedy}")


def _choice(written: Mapping[str, Any], kind: Kind) -> Distribution:
    listed = written.get("levels")
    if not isinstance(listed, list) or not listed:
        raise CampaignError(f"{kind.where}: levels must be a list of values, at least one")
    levels = tuple(number(level, kind, "levels") for level in listed)
    weights = written.get("weights", [1.0] * len(levels))
    if (not isinstance(weights, list) or len(weights) != len(levels)
            or not all(_plain(w) and 0.0 < float(w) < inf for w in weights)):
        raise CampaignError(f"{kind.where}: weights must be {len(levels)} finite numbers above 0, one for each level")
    shares = np.cumsum([float(w) for w in weights])
    found = Distribution("choice", {}, levels, tuple((shares / shares[-1]).tolist()))
    inside(found, kind)
    return found


def number(written: Any, kind: Kind, key: str = "") -> Any:
    """A value in the entry's unit from what a file says. Raises CampaignError, naming the entry."""
    where = f"{kind.where}{f'.{key}' if key else ''}"
    if kind.type == "Boolean":
        if not isinstance(written, bool):
            raise CampaignError(f"{where} = {written}: expected true or false")
        return written
    if not isinstance(written, str) and not _plain(written):
        raise CampaignError(f"{where}: expected {describe(kind.unit)}")
    text = str(written).strip()
    try:
        if text.endswith("%") and kind.base is not None:
            if kind.unit == "degC":
                raise UnitError("a percentage of a temperature says nothing; give it with a unit such as degC")
            found = quantity(text, "", "1") * float(kind.base)
        else:
            found = quantity(text, "", kind.unit)
    except UnitError as error:
        raise CampaignError(f"{where} = {written}: {error}") from error
    if kind.type == "Integer":
        if not float(found).is_integer():
            raise CampaignError(f"{where} = {written}: expected a whole number")
        return int(found)
    return found


def _deviation(written: Any, kind: Kind, mean: float) -> float:
    """A standard deviation: a percentage of the mean, or a difference in the entry's unit."""
    text = str(written).strip()
    if text.endswith("%"):
        if kind.unit == "degC":
            raise CampaignError(f"{kind.where}.sd = {written}: a percentage of a temperature says nothing; give a "
                                "difference such as 5 K")
        return float(number(text, Kind(f"{kind.where}.sd", "1"))) * abs(mean)
    plain = Kind(kind.where, kind.unit)
    found = float(number(written, plain, "sd"))
    if kind.unit == "degC":  # 5 degC, and 5 K, of difference: what 0 of that unit is cancels
        found -= float(number(_NUMBER.sub("0", text, count=1), plain, "sd"))
    return found


def _plain(written: Any) -> bool:
    return isinstance(written, (int, float)) and not isinstance(written, bool)
