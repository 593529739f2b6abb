"""The part of a campaign that workers need, and the parameters of a sample."""

from __future__ import annotations

import hashlib
import pickle
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...actuators import NONLINEAR, get
from ...actuators.declaration import Actuator
from ...bench.requirements import Specification
from .distributions import Distribution, Value
from .experiments import Experiment

UNJUDGED = Specification(())


@dataclass(frozen=True)
class Factor:
    """A quantity that varies between samples, in `unit`; `type` is Real, Integer or Boolean."""

    name: str
    unit: str
    type: str
    distribution: Distribution

    def value(self, drawn: Any) -> Any:
        """Return a drawn number, or an array of them, in the factor's type."""
        made = np.asarray(drawn).astype({"Boolean": bool, "Integer": np.int64, "Real": float}[self.type])
        return made if made.ndim else made.item()


@dataclass(frozen=True)
class Plan:
    """The part of a campaign that workers need.

    `base` are the parameters (flat, SI) of the actuator `model`, by its full name; `numbers` are the fixed numbers of
    motions and profiles by name. `followers` keep their ratio to a factor. `fmu` is the path of an FMU, or empty for
    the kernel, and `fin` the number of its fin, from 1. `model_sha256` is that of the user's file that declares the
    model, or empty. Every sample is judged by the `specification`, which contains only what can be measured of the
    model; its tests have their own inputs, so that only those factors matter to it that are parameters.
    """

    base: Mapping[str, Value]
    numbers: Mapping[str, Value]
    factors: tuple[Factor, ...]
    followers: Mapping[str, str]
    experiments: tuple[Experiment, ...]
    seed: int
    fmu: str = ""
    fmu_sha256: str = ""
    fin: int = 1
    model: str = NONLINEAR
    model_sha256: str = ""
    specification: Specification = UNJUDGED

    @property
    def actuator(self) -> Actuator:
        """The declaration of the model."""
        return get(self.model)

    @property
    def duration(self) -> float:
        """Approximate simulated time of a sample [s]."""
        tests = {(r.test, case) for r in self.specification.requirements if r.test for case in r.cases}
        return sum(e.duration for e in self.experiments) + sum(test.simulated for test, _ in tests)

    def packed(self) -> bytes:
        """Return the plan in the form in which it is sent to workers."""
        return pickle.dumps(self)

    def chosen(self, drawn: Iterable[Any]) -> dict[str, Any]:
        """Return the factors and their followers by name, for the values `drawn`: numbers, or arrays [samples]."""
        chosen = {f.name: f.value(x) for f, x in zip(self.factors, drawn, strict=True)}
        return chosen | {name: self.base[name] * (chosen[leader] / self.base[leader])
                         for name, leader in self.followers.items()}

    def varied(self, drawn: Iterable[Any]) -> tuple[dict[str, Any], dict[str, Any]]:
        """Return parameters (flat, SI) and numbers of motions and profiles for the values `drawn` of the factors.

        For many samples those that vary are arrays [samples].
        """
        values, numbers = dict[str, Any](self.base), dict[str, Any](self.numbers)
        for name, value in self.chosen(drawn).items():
            (values if name in values else numbers)[name] = value
        return values, numbers


def source_sha256(model: str) -> str:
    """Return the SHA-256 of the user's file that declares an actuator; empty for a shipped one."""
    source = get(model).source
    return "" if source is None else hashlib.sha256(source.read_bytes()).hexdigest()
