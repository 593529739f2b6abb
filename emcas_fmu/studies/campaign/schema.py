"""The schema of a campaign file: factors, input profiles and experiments. The unit of every number is checked."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from functools import partial
from math import inf
from typing import Annotated, Any

from pydantic import PlainValidator

from ...actuators import EXTENSIONS, NAMES, get, parts
from ...bench.excitation import COMMAND, LOAD
from ...errors import EmcasError, hint
from ...motions import EXCITATIONS, FIELDS, motion_in
from ...parameters import ParameterSet, Scalar
from ...parameters.schema import In, Table, each, kind_of, leaves
from ...variables import Variable
from .distributions import MOST_OUTSIDE, Factor, distribution
from .experiments import OPTIONAL_FIELDS, PROFILES, REQUIREMENT, Experiment, Profile


class _Follower(Table):
    follows: str


class Entries(Table):
    """The tables of a campaign file; the validation context is the `Reader`, which collects factors and numbers."""

    vary: Annotated[Any, PlainValidator(lambda written, info: info.context.read_factors(written))] = None
    inputs: Annotated[Any, PlainValidator(lambda written, info: info.context.profiles("inputs", written))] = None
    experiments: Annotated[Any, PlainValidator(lambda written, info: each(
        written, partial(info.context.experiment, info.data.get("inputs") or {})))] = None


class Reader:
    """Collects the factors, fixed numbers and followers of a campaign for the parameter set `base`."""

    def __init__(self, base: ParameterSet) -> None:
        self.base, self.model = base.values, base.model
        self._parameters = {e.variable.name: e.variable for e in base.entries}
        self._inputs = {v.name: v for v in get(base.model).inputs}
        self.factors: list[Factor] = []
        self.numbers: dict[str, Scalar] = {}
        self.followers: dict[str, str] = {}

    def read_factors(self, written: Any) -> None:
        """Read the table `vary`. All methods raise ValueError or ValidationError for a wrong entry."""
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
            raise ValueError(f"{leader} is not a real number that varies{hint(leader, leaders)}")
        if self._parameters[name].kind != "Real" or not self.base[leader]:
            raise ValueError(f"there is no ratio to keep: {name} must be a real number, and {leader} must not be 0")

    def _keep(self, name: str, unit: In, written: Any) -> None:
        """Store a fixed number, or a factor if `written` is a table with its distribution."""
        if isinstance(written, Mapping):
            self.factors.append(Factor(name, unit.unit, unit.type, distribution(written, unit)))
        else:
            self.numbers[name] = unit.limited(written)

    def profiles(self, prefix: str, entries: Any) -> dict[str, Profile]:
        """Return the profiles in a table of inputs, and store their numbers as ``PREFIX.INPUT.FIELD``."""
        inputs = {name: v for name, v in self._inputs.items() if name != COMMAND}
        return each(_tables(entries, inputs), partial(self._profile, prefix, inputs))

    def _profile(self, prefix: str, inputs: Mapping[str, Variable], name: str, entry: Any) -> Profile:
        if name not in inputs:
            problem = "the experiment determines the command" if name == COMMAND else f"there is no input {name!r}"
            raise ValueError(f"{problem}{_elsewhere(name, self.model) or hint(name, inputs)}; inputs are "
                             f"{', '.join(inputs)}")
        kinds: Iterable[str] = [k for k in PROFILES if k != "spring" or name == LOAD]
        kind = kind_of(entry, ("constant", "step", "window") if inputs[name].kind == "Boolean" else kinds)
        profile = Profile(name, kind, f"{prefix}.{name}")
        formats = {field: known or self._like(inputs[name], field) for field, known in PROFILES[kind].items()}
        Table.of_kind("profile", self._fields(profile.prefix, formats)).model_validate(entry)
        if kind == "window":  # if only some windows end before they begin, only their samples fail
            (begin, _), (_, end) = (self._limits(f"{profile.prefix}.{side}") for side in ("begin", "end"))
            if end < begin:
                raise ValueError(f"end = {end:g} s is before begin = {begin:g} s; write a later end")
        return profile

    def _fields(self, prefix: str, formats: Mapping[str, In]) -> dict[str, Any]:
        """Return pydantic fields for a motion or profile, from formats; validating a field stores its number."""
        return {field: (Annotated[Any, PlainValidator(partial(self._keep, f"{prefix}.{field}", each))],
                        None if field in OPTIONAL_FIELDS else ...) for field, each in formats.items()}

    def _like(self, variable: Variable, field: str) -> In:
        of_input = In.of(variable, float(self.base[variable.key]) if variable.key else None)
        return replace(of_input, minimum=-inf, maximum=inf) if field == "amplitude" else of_input

    def _limits(self, name: str, outside: float = 0.0) -> tuple[float, float]:
        """Return the smallest and the largest value of a number; tails end at the probability `outside`."""
        if name in self.numbers:
            return float(self.numbers[name]), float(self.numbers[name])
        return next(f for f in self.factors if f.name == name).distribution.limits(outside)

    def experiment(self, common: Mapping[str, Profile], name: str, entry: Any) -> Experiment:
        """Return an experiment; its profiles replace the `common` profiles of the same inputs."""
        if "." in name or name == REQUIREMENT:
            raise ValueError(f"the name of an experiment must have no dot and must not be {REQUIREMENT}")
        kind, prefix = motion_in(entry), f"experiments.{name}"
        limit = float(self.base["command.limit"]) * (1.0 + 1e-9)
        motion = EXCITATIONS[kind]
        amplitude = replace(FIELDS["amplitude"], minimum=-limit, maximum=limit, nonzero=motion.jumps)
        fields = self._fields(prefix, {"amplitude": amplitude, **{each: FIELDS[each] for each in motion.shape}})
        fields["duration"] = replace(FIELDS["duration"], default=1.0).definition
        fields["inputs"] = (Annotated[Any, PlainValidator(partial(self.profiles, f"{prefix}.inputs"))], {})
        table = Table.of_kind(kind, fields).model_validate(entry)
        if EXCITATIONS[kind].sweeps:
            (_, low), (high, _) = (self._limits(f"{prefix}.{side}", MOST_OUTSIDE) for side in ("low", "high"))
            if not low < high:
                raise ValueError(f"low (at most {low:g} Hz) must be below high (at least {high:g} Hz)")
        return Experiment(name, kind, table.duration, tuple({**common, **table.inputs}.values()))


def _tables(entries: Any, variables: Mapping[str, Variable]) -> Iterator[tuple[str, Any]]:
    """Return pairs of dotted name and table; a file may have quoted names or nested tables. Raises ValueError."""
    if not isinstance(entries, Mapping):
        raise ValueError("expected a table")
    return leaves(entries, lambda name, table: table and name not in variables and all(
        isinstance(entry, Mapping) for entry in table.values()))


def _elsewhere(name: str, model: str) -> str:
    """Return a hint if another actuator or one more extension has this parameter or input; otherwise an empty text."""
    actuator, extensions = parts(model)
    for other in (*("+".join((actuator, *extensions, more)) for more in EXTENSIONS if more not in extensions), *NAMES):
        try:
            declaration = get(other)
        except EmcasError:  # the extension does not fit this actuator
            continue
        if any(v.name == name for v in (*declaration.parameters, *declaration.inputs)):
            return f" of the {get(model).name} model; {other} has one: set the model in [base] or with --model"
    return ""
