"""The entries of a campaign file: what varies, how inputs go, which experiments; each checked with its unit."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from math import isfinite
from pathlib import Path
from typing import Any

from ..actuators import EXTENSIONS, NAMES, NONLINEAR, get
from ..errors import hint, require_known
from ..parameters import ParameterSet
from ..tuning.experiments import STEP
from ..variables import Variable
from .distributions import MOST_OUTSIDE, CampaignError, Kind, Value, distribution, number
from .experiments import COMMAND, EXPERIMENTS, LOAD, OPTIONAL, PROFILES, SAME, Experiment, Profile
from .plan import Factor

LONGEST = 300.0  # s, of an experiment: half a gigabyte of rows
# Of what is no input: rows are a millisecond apart, a spring is coupled once in each.
_LIMITS = {"Hz": (1e-3, 500.0), "s": (-LONGEST, LONGEST), "N.m/rad": (-1e6, 1e6)}


class Reader:
    """Collects factors, numbers, followers and experiments from a document."""

    def __init__(self, path: Path, base: ParameterSet) -> None:
        self.path, self.base, self.model = path, base.values, base.model
        chosen = get(base.model)
        self._parameters = {v.name: v for v in chosen.file_entries}
        self._inputs = {v.name: v for v in chosen.inputs}
        self.factors: list[Factor] = []
        self.numbers: dict[str, Value] = {}
        self.followers: dict[str, str] = {}
        self.experiments: list[Experiment] = []

    def read(self, document: Mapping[str, Any]) -> None:
        varying = table_of(document, "vary", f"{self.path}")
        for name, entry in _leaves(varying, self._parameters):
            self.parameter(name, entry)
        for name, leader in self.followers.items():
            self.check_follower(name, leader)
        common = self.profiles(table_of(document, "inputs", f"{self.path}"), "inputs")
        named = table_of(document, "experiments", f"{self.path}")
        if not named:
            raise CampaignError(f"{self.path}: nothing is done; give at least one [experiments.NAME] with a kind")
        for name in named:
            self.experiment(name, table_of(named, name, f"{self.path}: experiments"), common)

    def parameter(self, name: str, entry: Any) -> None:
        where = f"{self.path}: vary.{name}"
        variable = self._parameters.get(name)
        if variable is None:
            raise CampaignError(f"{where}: there is no parameter {name!r}"
                                f"{_elsewhere(name, self.model) or hint(name, self._parameters)}")
        if name in self.followers or name in [f.name for f in self.factors]:
            raise CampaignError(f"{where}: is given twice")
        if not isinstance(entry, Mapping):
            raise CampaignError(f"{where}: expected a table such as {{ distribution = \"uniform\", low = ..., "
                                "high = ... }}")
        if "follows" in entry:
            require_known(entry, ("follows",), where, CampaignError)
            self.followers[name] = entry["follows"]
            return
        self.setting(name, entry, Kind(where, variable.unit, variable.minimum, variable.maximum,
                                       float(self.base[name]), variable.kind))

    def check_follower(self, name: str, leader: Any) -> None:
        where, leaders = f"{self.path}: vary.{name}.follows", [f.name for f in self.factors if f.type == "Real"]
        if leader not in leaders:
            raise CampaignError(f"{where} = {leader!r}: is no number that varies{hint(leader, leaders)}")
        if self._parameters[name].kind != "Real" or not self.base[leader]:
            raise CampaignError(f"{where} = {leader!r}: there is no ratio to keep")

    def setting(self, name: str, written: Any, kind: Kind) -> None:
        """A number, or a table of a distribution."""
        if isinstance(written, Mapping):
            self.factors.append(Factor(name, kind.unit, kind.type, distribution(_counted(written, kind), kind)))
            return
        self.numbers[name] = number(written, kind)
        if not kind.minimum <= self.numbers[name] <= kind.maximum:
            raise CampaignError(f"{kind.where} = {written}: must be within {kind.minimum:g} .. {kind.maximum:g} "
                                f"{kind.unit}")

    def profiles(self, entries: Mapping[str, Any], prefix: str) -> dict[str, Profile]:
        found = {}
        known = {name: v for name, v in self._inputs.items() if name != COMMAND}
        for name, entry in _leaves(entries, known):
            where = f"{self.path}: {prefix}.{name}"
            if name not in known:
                what = "the command is that of an experiment" if name == COMMAND else f"there is no input {name!r}"
                raise CampaignError(f"{where}: {what}{_elsewhere(name, self.model) or hint(name, known)}; inputs are "
                                    f"{', '.join(known)}")
            kinds = [k for k in PROFILES if k != "spring" or name == LOAD]
            kinds = ["constant", "step", "window"] if known[name].kind == "Boolean" else kinds
            profile = Profile(name, self.kind(where, entry, kinds), f"{prefix}.{name}")
            self.fields(where, profile.prefix, entry, PROFILES[profile.kind], name)
            if profile.kind == "window":
                self.check_window(where, profile.prefix)
            found[name] = profile
        return found

    def kind(self, where: str, entry: Any, kinds: Any) -> str:
        if not isinstance(entry, Mapping) or entry.get("kind") not in kinds:
            given = entry.get("kind") if isinstance(entry, Mapping) else entry
            raise CampaignError(f"{where}: kind = {given!r}{hint(given, kinds)}; there is {', '.join(kinds)}")
        return str(entry["kind"])

    def fields(self, where: str, prefix: str, entry: Mapping[str, Any], units: Mapping[str, str], name: str,
               more: tuple[str, ...] = ()) -> None:
        require_known(entry, ("kind", *units, *more), where, CampaignError)
        for field, unit in units.items():
            if field in entry:
                self.setting(f"{prefix}.{field}", entry[field], self.of_input(f"{where}.{field}", name, field, unit))
            elif field not in OPTIONAL:
                raise CampaignError(f"{where}: {field} is missing; a {entry['kind']} has {', '.join(units)}")

    def of_input(self, where: str, name: str, field: str, unit: str) -> Kind:
        variable = self._inputs[name]
        if unit != SAME:
            return Kind(where, unit, *_LIMITS[unit])
        if name == COMMAND:
            limit = float(self.base["command.limit"]) * (1.0 + 1e-9)
            return Kind(where, variable.unit, -limit, limit)
        base = float(self.base[variable.key]) if variable.key else None
        limits = (-float("inf"), float("inf")) if field == "amplitude" else (variable.minimum, variable.maximum)
        return Kind(where, variable.unit, *limits, base, variable.kind)

    def limits(self, name: str, outside: float = 0.0) -> tuple[float, float]:
        """Between what a number lies, whether it is fixed or drawn."""
        if name in self.numbers:
            return float(self.numbers[name]), float(self.numbers[name])
        return next(f for f in self.factors if f.name == name).distribution.limits(outside)

    def check_window(self, where: str, prefix: str) -> None:
        """Some may be drawn the wrong way round, and are recorded; all may not."""
        (begin, _), (_, end) = (self.limits(f"{prefix}.{side}") for side in ("begin", "end"))
        if end < begin:
            raise CampaignError(f"{where}: end = {end:g} s is before begin = {begin:g} s; give an end that is later")

    def experiment(self, name: str, entry: Mapping[str, Any], common: Mapping[str, Profile]) -> None:
        where, prefix = f"{self.path}: experiments.{name}", f"experiments.{name}"
        if "." in name:
            raise CampaignError(f"{where}: a name without dots is needed")
        kind = self.kind(where, entry, EXPERIMENTS)
        self.fields(where, prefix, entry, EXPERIMENTS[kind], COMMAND, ("duration", "inputs"))
        duration = number(entry.get("duration", "1 s"), Kind(f"{where}.duration", "s"))
        if not (isfinite(duration) and 0.1 <= duration <= LONGEST):
            raise CampaignError(f"{where}.duration = {entry.get('duration')}: must be within 0.1 .. {LONGEST:g} s")
        if abs(duration / STEP - round(duration / STEP)) > 1e-6:
            raise CampaignError(f"{where}.duration = {entry['duration']}: must be a whole number of {STEP * 1e3:g} ms")
        if kind == "step" and self.numbers.get(f"{prefix}.amplitude") == 0.0:
            raise CampaignError(f"{where}.amplitude: a step needs an amplitude other than 0")
        if kind == "chirp":
            (_, low), (high, _) = (self.limits(f"{prefix}.{side}", MOST_OUTSIDE) for side in ("low", "high"))
            if not low < high:
                raise CampaignError(f"{where}: low (up to {low:g} Hz) must be below high (from {high:g} Hz on)")
        own = self.profiles(table_of(entry, "inputs", where), f"{prefix}.inputs")
        self.experiments.append(Experiment(name, kind, duration, tuple({**common, **own}.values())))


def _leaves(entries: Mapping[str, Any], known: Mapping[str, Variable], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Names with dots, quoted or not, with their tables."""
    for key, entry in entries.items():
        name = f"{prefix}{key}"
        nested = isinstance(entry, Mapping) and entry and all(isinstance(e, Mapping) for e in entry.values())
        if nested and name not in known:
            yield from _leaves(entry, known, f"{name}.")
        else:
            yield name, entry


def _elsewhere(name: str, model: str) -> str:
    """What to say of a parameter or input that another model, or one with an option, has."""
    for kind in (*NAMES, *(f"{NONLINEAR}+{option}" for option in EXTENSIONS)):
        if any(v.name == name for v in (*get(kind).parameters, *get(kind).inputs)):
            return f" of the {model} model; {kind} has one: name the model in [base], or with --model"
    return ""


def _counted(written: Mapping[str, Any], kind: Kind) -> Mapping[str, Any]:
    """`low`, `high` and `count` are levels evenly apart."""
    if "count" not in written or "distribution" in written:
        return written
    require_known(written, ("low", "high", "count"), kind.where, CampaignError)
    count = written["count"]
    if isinstance(count, bool) or not isinstance(count, int) or not 2 <= count <= 1_000_000 or len(written) < 3:
        raise CampaignError(f"{kind.where}: levels are given as low, high and a whole count of at least 2")
    low, high = (float(number(written[side], kind, side)) for side in ("low", "high"))
    levels = [low + (high - low) * k / (count - 1) for k in range(count)]
    return {"levels": [repr(level) if kind.unit == "1" else f"{level!r} {kind.unit}" for level in levels]}


def table_of(document: Mapping[str, Any], key: str, where: str) -> Mapping[str, Any]:
    """A table of a document, empty if there is none. Raises CampaignError for what is no table."""
    table = document.get(key, {})
    if not isinstance(table, Mapping):
        raise CampaignError(f"{where}: {key}: expected a table")
    return table
