"""The schema of a campaign file: factors, input profiles and experiments, each number checked with its unit."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from functools import partial
from math import inf
from typing import Annotated, Any

from pydantic import PlainValidator, create_model

from ... import motions
from ...actuators import EXTENSIONS, NAMES, get, parts
from ...bench.excitation import COMMAND, LOAD
from ...errors import EmcasError, hint
from ...motions import STEP
from ...parameters import ParameterSet
from ...parameters.schema import In, Table, each, kind_of, leaves
from ...variables import Variable
from .distributions import MOST_OUTSIDE, Factor, Value, distribution
from .experiments import OPTIONAL, PROFILES, REQUIREMENT, SAME, Experiment, Profile

LONGEST = 300.0  # s, of an experiment: half a gigabyte of rows
# Limits of numbers that are not inputs: rows are a millisecond apart, and a spring acts once in each.
_OTHERS = {unit: In(unit, *limits)
           for unit, limits in {"Hz": (1e-3, 500.0), "s": (-LONGEST, LONGEST), "N.m/rad": (-1e6, 1e6)}.items()}


def _duration(written: Any) -> float:
    duration = float(In("s", 0.1, LONGEST).limited(written))
    if abs(duration / STEP - round(duration / STEP)) > 1e-6:
        raise ValueError(f"must be a whole number of {STEP * 1e3:g} ms")
    return duration


class _Follower(Table):
    follows: str


class Entries(Table):
    """The tables of a campaign file, read by a `Reader`, the context, which collects factors and fixed numbers."""

    vary: Annotated[Any, PlainValidator(lambda written, info: info.context.read_factors(written))] = None
    inputs: Annotated[Any, PlainValidator(lambda written, info: info.context.profiles("inputs", written))] = None
    experiments: Annotated[Any, PlainValidator(lambda written, info: each(
        written, partial(info.context.experiment, info.data.get("inputs") or {})))] = None


class Reader:
    """Collects the factors, fixed numbers and followers of a campaign on the parameter set `base`."""

    def __init__(self, base: ParameterSet) -> None:
        self.base, self.model = base.values, base.model
        self._parameters = {e.variable.name: e.variable for e in base.entries}
        self._inputs = {v.name: v for v in get(base.model).inputs}
        self.factors: list[Factor] = []
        self.numbers: dict[str, Value] = {}
        self.followers: dict[str, str] = {}

    def read_factors(self, written: Any) -> None:
        """Read the table `vary`. Raises ValueError or ValidationError, as the others do."""
        each(_tables(written, self._parameters), self._parameter)
        each(((f"{name}.follows", leader) for name, leader in self.followers.items()), self._check_follower)

    def _parameter(self, name: str, entry: Any) -> None:
        variable = self._parameters.get(name)
        if variable is None:
            raise ValueError(f"there is no parameter {name!r}"
                             f"{_elsewhere(name, self.model) or hint(name, self._parameters)}")
        if not isinstance(entry, Mapping):
            raise ValueError("expected a table such as { distribution = \"uniform\", low = ..., high = ... }")
        if "follows" in entry:
            self.followers[name] = _Follower.model_validate(entry).follows
        else:
            self._keep(name, In.of(variable, float(self.base[name])), entry)

    def _check_follower(self, key: str, leader: str) -> None:
        name, leaders = key.removesuffix(".follows"), [f.name for f in self.factors if f.type == "Real"]
        if leader not in leaders:
            raise ValueError(f"is not a number that varies{hint(leader, leaders)}")
        if self._parameters[name].kind != "Real" or not self.base[leader]:
            raise ValueError("there is no ratio to keep")

    def _keep(self, name: str, unit: In, written: Any) -> None:
        """Store a number, or a factor if a table describes its distribution."""
        if isinstance(written, Mapping):
            self.factors.append(Factor(name, unit.unit, unit.type, distribution(written, unit)))
        else:
            self.numbers[name] = unit.limited(written)

    def profiles(self, prefix: str, entries: Any) -> dict[str, Profile]:
        """Return the profiles of a table of inputs, whose numbers are named `prefix`, a dot, input, dot and field."""
        inputs = {name: v for name, v in self._inputs.items() if name != COMMAND}
        return each(_tables(entries, inputs), partial(self._profile, prefix, inputs))

    def _profile(self, prefix: str, inputs: Mapping[str, Variable], name: str, entry: Any) -> Profile:
        if name not in inputs:
            what = "the command is that of an experiment" if name == COMMAND else f"there is no input {name!r}"
            raise ValueError(f"{what}{_elsewhere(name, self.model) or hint(name, inputs)}; inputs are "
                             f"{', '.join(inputs)}")
        kinds: Iterable[str] = [k for k in PROFILES if k != "spring" or name == LOAD]
        kind = kind_of(entry, ("constant", "step", "window") if inputs[name].kind == "Boolean" else kinds)
        profile = Profile(name, kind, f"{prefix}.{name}")
        create_model("profile", __base__=Table, kind=(str, ...), **self._fields(
            profile.prefix, name, PROFILES[kind])).model_validate(entry)
        if kind == "window":  # a sample whose end is before its begin fails; here all of them would
            (begin, _), (_, end) = (self._limits(f"{profile.prefix}.{side}") for side in ("begin", "end"))
            if end < begin:
                raise ValueError(f"end = {end:g} s is before begin = {begin:g} s; give an end that is later")
        return profile

    def _fields(self, prefix: str, name: str, units: Mapping[str, str]) -> dict[str, Any]:
        """Return the fields of a motion or profile of the input `name`, for a model; each stores its number."""
        return {field: (Annotated[Any, PlainValidator(partial(
            self._keep, f"{prefix}.{field}", self._unit(name, field, unit)))], None if field in OPTIONAL else ...)
            for field, unit in units.items()}

    def _unit(self, name: str, field: str, unit: str) -> In:
        variable = self._inputs[name]
        if unit != SAME:
            return _OTHERS[unit]
        if name == COMMAND:
            limit = float(self.base["command.limit"]) * (1.0 + 1e-9)
            return In(variable.unit, -limit, limit)
        written = In.of(variable, float(self.base[variable.key]) if variable.key else None)
        return replace(written, minimum=-inf, maximum=inf) if field == "amplitude" else written

    def _limits(self, name: str, outside: float = 0.0) -> tuple[float, float]:
        """Return the least and the largest value of a number, whether it is fixed or drawn."""
        if name in self.numbers:
            return float(self.numbers[name]), float(self.numbers[name])
        return next(f for f in self.factors if f.name == name).distribution.limits(outside)

    def experiment(self, common: Mapping[str, Profile], name: str, entry: Any) -> Experiment:
        """Return an experiment, which has the `common` profiles of inputs unless its table has others."""
        if "." in name or name == REQUIREMENT:
            raise ValueError(f"a name without dots is needed, and another than {REQUIREMENT}")
        kind, prefix = motions.motion_in(entry), f"experiments.{name}"
        units = {field: motions.FIELDS[field].unit for field in motions.KINDS[kind].shape}
        numbers = self._fields(prefix, COMMAND, {"amplitude": SAME, **units})
        numbers["duration"] = (Annotated[float, PlainValidator(_duration)], 1.0)
        profiles = Annotated[Any, PlainValidator(partial(self.profiles, f"{prefix}.inputs"))]
        table = motions.schema(kind, numbers, inputs=(profiles, {})).model_validate(entry)
        if motions.KINDS[kind].jumps and self.numbers.get(f"{prefix}.amplitude") == 0.0:
            raise ValueError(f"a {kind} needs an amplitude other than 0")
        if motions.KINDS[kind].sweeps:
            (_, low), (high, _) = (self._limits(f"{prefix}.{side}", MOST_OUTSIDE) for side in ("low", "high"))
            if not low < high:
                raise ValueError(f"low (up to {low:g} Hz) must be below high (from {high:g} Hz on)")
        return Experiment(name, kind, table.duration, tuple({**common, **table.inputs}.values()))


def _tables(entries: Any, variables: Mapping[str, Variable]) -> Iterator[tuple[str, Any]]:
    """Return dotted names, quoted or not, with their tables. Raises ValueError."""
    if not isinstance(entries, Mapping):
        raise ValueError("expected a table")
    return leaves(entries, lambda name, table: table and name not in variables and all(
        isinstance(entry, Mapping) for entry in table.values()))


def _elsewhere(name: str, model: str) -> str:
    """Return a hint to the extension, or the other actuator, that has a parameter or input of this name."""
    actuator, extensions = parts(model)
    for kind in (*("+".join((actuator, *extensions, more)) for more in EXTENSIONS if more not in extensions), *NAMES):
        try:
            chosen = get(kind)
        except EmcasError:  # the extension does not fit this actuator
            continue
        if any(v.name == name for v in (*chosen.parameters, *chosen.inputs)):
            return f" of the {get(model).name} model; {kind} has one: name the model in [base], or with --model"
    return ""
