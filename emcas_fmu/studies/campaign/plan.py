"""What a worker needs of a campaign, and the parameters of a sample."""

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
    """One thing that varies, in `unit`; `type` is Real, Integer or Boolean."""

    name: str
    unit: str
    type: str
    distribution: Distribution

    def value(self, drawn: Any) -> Any:
        """Return a number drawn, or an array of them, as what the factor is."""
        made = np.asarray(drawn).astype({"Boolean": bool, "Integer": np.int64, "Real": float}[self.type])
        return made if made.ndim else made.item()


@dataclass(frozen=True)
class Plan:
    """All a worker needs: flat parameters (SI), numbers of profiles by name, what varies, what is done.

    `followers` are parameters that keep their ratio to one that varies. `fmu` is the path of an FMU,
    with its SHA-256, or empty for the kernel; `fin`, from 1, which of a unit of several. `model` is one of
    :mod:`emcas_fmu.actuators`, whose parameters `base` has, by its full name; `model_sha256` is of the user's file
    that declares it, or empty. `specification` is what every sample is judged by, without what cannot be measured of
    the model; its tests have inputs of their own, so that of the numbers drawn parameters alone reach it.
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
        """What the samples are run with."""
        return get(self.model)

    @property
    def duration(self) -> float:
        """About how long a sample is simulated [s]."""
        tests = {(r.test, case) for r in self.specification.requirements if r.test for case in r.cases}
        return sum(e.duration for e in self.experiments) + sum(test.simulated for test, _ in tests)

    def packed(self) -> bytes:
        """Return the plan as it is sent to a worker."""
        return pickle.dumps(self)

    def chosen(self, drawn: Iterable[Any]) -> dict[str, Any]:
        """Return the factors with the values `drawn`, and the parameters that follow them.

        Of each factor a number, or an array of those of many samples.
        """
        chosen = {f.name: f.value(x) for f, x in zip(self.factors, drawn, strict=True)}
        return chosen | {name: self.base[name] * (chosen[leader] / self.base[leader])
                         for name, leader in self.followers.items()}

    def varied(self, drawn: Iterable[Any]) -> tuple[dict[str, Any], dict[str, Any]]:
        """Return parameters (flat, SI) and numbers of profiles of a sample whose factors have the values `drawn`.

        Of many samples those that vary are arrays.
        """
        values, numbers = dict[str, Any](self.base), dict[str, Any](self.numbers)
        for name, value in self.chosen(drawn).items():
            (values if name in values else numbers)[name] = value
        return values, numbers


def source_sha256(model: str) -> str:
    """Return the SHA-256 of the user's file that declares an actuator; empty for one that is no file."""
    source = get(model).source
    return "" if source is None else hashlib.sha256(source.read_bytes()).hexdigest()
