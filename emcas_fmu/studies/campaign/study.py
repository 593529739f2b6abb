"""A campaign, read from TOML: factors, experiments and the parameters or FMU that they apply to."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from math import prod
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, PlainValidator
from scipy.stats import qmc

from ...actuators import NONLINEAR, full_name, get
from ...actuators.declaration import Actuator
from ...bench.fmu_subject import open_subject
from ...bench.requirements import Specification, load_requirements
from ...bench.subject import ParameterSubject
from ...bench.verdict import Judged, judged
from ...errors import EmcasError
from ...fmi.interface import MOST_FINS, FmuInterface, start_values
from ...fmi.package import interface_guid
from ...parameters import (
    ParameterSet,
    broken_rules,
    check_combinations,
    check_parameters,
    load_parameters,
    parameter_file,
    schema,
)
from ...parameters.schema import Table
from ...rules import Rule
from ...simulation import Array
from .distributions import MOST_OUTSIDE, CampaignError, Factor, Value
from .experiments import Experiment
from .schema import Entries, Reader

MOST_SAMPLES = 100_000_000
SHIPPED = "shipped"  # stands for models/requirements.toml


class _Campaign(Table):
    samples: Annotated[int, Field(ge=1, le=MOST_SAMPLES)] | None = None
    seed: Annotated[int, Field(ge=0, le=2**63 - 1)] = 1
    method: Literal["monte-carlo", "latin-hypercube", "sobol", "grid"] = "monte-carlo"


def _names(written: object) -> tuple[str, ...]:
    names = tuple(written) if isinstance(written, list) else (written,)
    if not all(isinstance(name, str) for name in names):
        raise ValueError("must be the name of a file, or a list of them")
    return tuple(map(str, names))


class _Base(Table):
    model: str | None = None
    parameters: Annotated[tuple[str, ...], PlainValidator(_names)] = ()
    fmu: str | None = None
    fin: Annotated[int, Field(ge=1, le=MOST_FINS)] | None = None


class _File(Table):
    campaign: _Campaign = _Campaign()
    base: _Base = _Base()
    vary: Any = None
    inputs: Any = None
    experiments: Any = None


@dataclass(frozen=True)
class Study:
    """A campaign of the file `path`, whose `text` contains the `document`; it is sent to the workers.

    `guid` is that of its FMU, or of the FMU that would be built from its parameters. `base` are the parameters (flat,
    SI) of the actuator `model`, by its full name; `numbers` are the fixed numbers of motions and profiles by name.
    `followers` keep their ratio to a factor. `fmu` is the path of an FMU, or empty for the kernel, and `fin` the number
    of its fin, from 1. `model_sha256` is that of the user's file that declares the model, or empty. Every sample is
    judged by the `specification`, which contains only what can be measured of the model; its tests have their own
    inputs, so that only those factors matter to it that are parameters. `left_out` are the requirements that cannot be
    measured, with the reasons. `warnings` are those of the parameters with all factors at their medians and with each
    at either end, one for each rule.
    """

    path: Path
    text: str
    document: Mapping[str, Any]
    method: str
    samples: int
    seed: int
    guid: str
    base: Mapping[str, Value]
    numbers: Mapping[str, Value]
    factors: tuple[Factor, ...]
    followers: Mapping[str, str]
    experiments: tuple[Experiment, ...]
    fmu: str
    fmu_sha256: str
    fin: int
    model: str
    model_sha256: str
    specification: Specification
    left_out: tuple[Judged, ...]
    warnings: tuple[str, ...] = ()

    @property
    def actuator(self) -> Actuator:
        """The declaration of the model."""
        return get(self.model)

    @property
    def duration(self) -> float:
        """Approximate simulated time of a sample [s]."""
        tests = {(r.test, case) for r in self.specification.requirements if r.test for case in r.cases}
        return sum(e.duration for e in self.experiments) + sum(test.simulated for test, _ in tests)

    def draw(self, indices: Sequence[int]) -> Array:
        """Return the values [indices, factors] of samples in the factors' units, which depend on index and seed only.

        Sample i of a ``monte-carlo`` campaign has its own generator, seeded with (seed, i); of a ``sobol`` one it is
        point i of a scrambled sequence, of a ``latin-hypercube`` row i of one hypercube for all samples, of a ``grid``
        the digits of i in mixed radix, of which the last factor's change fastest. Raises IndexError outside the
        campaign.
        """
        if any(not 0 <= i < self.samples for i in indices):
            raise IndexError(f"samples are numbered from 0 to {self.samples - 1}")
        distributions = [f.distribution for f in self.factors]
        if self.method == "grid":
            positions = np.unravel_index(np.asarray(indices), [len(d.levels) for d in distributions])
            return np.column_stack([np.asarray(d.levels, dtype=float)[k]
                                    for d, k in zip(distributions, positions, strict=True)])
        if self.method == "sobol":
            shares = _sobol(len(self.factors), self.seed, indices)
        elif self.method == "latin-hypercube":
            shares = hypercube(len(self.factors), self.seed, self.samples)[np.asarray(indices)]
        else:
            shares = np.array([np.random.default_rng([self.seed, i]).random(len(self.factors)) for i in indices])
        return np.column_stack([d.at(shares[:, k]) for k, d in enumerate(distributions)])

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


@lru_cache(maxsize=1)
def hypercube(factors: int, seed: int, samples: int) -> Array:
    """Return a Latin hypercube [samples, factors] of shares between 0 and 1."""
    cube: Array = qmc.LatinHypercube(factors, rng=np.random.default_rng([seed])).random(samples)
    return cube


def _sobol(factors: int, seed: int, indices: Sequence[int]) -> Array:
    """Return points in the order of `indices`; each is drawn once, in ascending order, as the engine requires."""
    engine = qmc.Sobol(factors, scramble=True, rng=np.random.default_rng([seed]))
    ordered, positions = np.unique(np.asarray(indices), return_inverse=True)
    points = np.empty((len(ordered), factors))
    for row, index in zip(points, ordered.tolist(), strict=True):
        if index > engine.num_generated:
            engine.fast_forward(index - engine.num_generated)
        row[:] = engine.random(1)[0]
    # A scrambled point may contain 0, where a normal distribution is infinite.
    return np.clip(points, 2.0**-53, 1.0 - 2.0**-53)[positions]


def load_study(path: Path, fmu: Path | None = None, fin: int | None = None, model: str | None = None,
               requirements: Path | str | None = None) -> Study:
    """Return the campaign of a TOML file (see models/campaign.toml). Raises CampaignError.

    `fmu`, its `fin` (from 1) and `model`, one of :mod:`emcas_fmu.actuators`, replace those in the file. Every sample
    is judged by `requirements`, a file or SHIPPED.
    """
    text, document = schema.document(path, CampaignError)
    file = schema.read(_File, document, path, CampaignError)
    base, guid, unit, digest, chosen = _base(path, file.base, fmu, fin, model)
    reader = Reader(base)
    written = {key: document[key] for key in Entries.model_fields if key in document}
    entries = schema.read(Entries, written, path, CampaignError, reader)
    if not reader.factors:
        raise CampaignError(f"{path}: nothing varies; give at least one [vary.\"NAME\"] with a distribution")
    if not entries.experiments:
        raise CampaignError(f"{path}: nothing is done; give at least one [experiments.NAME] with a kind")
    specification, subject = Specification(()), ParameterSubject(base)
    if requirements is not None:
        specification = load_requirements(None if str(requirements) == SHIPPED else Path(requirements), base)
    able = tuple(r for r in specification.requirements if not r.obstacle(subject))
    if specification.requirements and not able:
        raise CampaignError(f"{requirements}: none of its requirements can be measured of {base.model}; leave "
                            "--requirements out")
    study = Study(
        path, text, document, file.campaign.method, _samples(path, file.campaign, reader.factors), file.campaign.seed,
        guid, dict(base.values), reader.numbers, tuple(reader.factors), reader.followers,
        tuple(entries.experiments.values()), fmu=unit, fmu_sha256=digest, fin=chosen, model=base.model,
        model_sha256=source_sha256(base.model), specification=replace(specification, requirements=able),
        left_out=tuple(judged(r, (), subject) for r in specification.requirements if r not in able))
    # If the parameters contradict each other at the medians, few samples could be run.
    medians = [float(f.distribution.at(0.5)) for f in study.factors]
    if problems := check_parameters(study.varied(medians)[0], study.model):
        raise CampaignError(f"{path}: with everything at its median: {'; '.join(problems)}")
    return replace(study, warnings=tuple(_warnings(base, study, medians)))


def source_sha256(model: str) -> str:
    """Return the SHA-256 of the user's file that declares an actuator; empty for a shipped one."""
    source = get(model).source
    return "" if source is None else hashlib.sha256(source.read_bytes()).hexdigest()


def _warnings(base: ParameterSet, study: Study, medians: list[float]) -> Iterator[str]:
    """Yield the first warning of each rule: at the medians of the factors, or with one factor at an end."""
    varied = check_combinations(base.values, base.actuator, warnings=True)
    yield from (warning for warning in base.warnings if warning not in varied)
    points = [medians, *([*medians[:k], end, *medians[k + 1:]] for k, factor in enumerate(study.factors)
                         for end in factor.distribution.limits(MOST_OUTSIDE))]
    first: dict[Rule, str] = {}
    for values, _ in map(study.varied, points):
        if not check_parameters(values, study.model):  # other samples fail with an error
            first = {**broken_rules(values, study.actuator, warnings=True), **first}
    yield from (first[rule] for rule in study.actuator.all_rules if rule in first)


def _base(path: Path, entry: _Base, fmu: Path | None, fin: int | None,
          model: str | None) -> tuple[ParameterSet, str, str, str, int]:
    """Return the base set, the GUID, and path, SHA-256 and fin of the FMU, if there is one."""
    chosen = fin if fin is not None else entry.fin or 1
    kind = _model(path, entry, model)
    # Paths are relative to the campaign's file, so that it can be run from any folder.
    files = [parameter_file(name, path.parent) for name in entry.parameters]
    unit = fmu if fmu is not None else path.parent / entry.fmu if entry.fmu else None
    if unit is None:
        if fin is not None or entry.fin is not None:
            raise CampaignError(f"{path}: fin {chosen} is one of an FMU; name it with --fmu or base.fmu")
        base = load_parameters(files, model=kind or NONLINEAR)
        shown = FmuInterface(1, base.model)
        return base, interface_guid(start_values(shown, [base.values]), shown), "", "", 1
    if unit.suffix.lower() != ".fmu":
        raise CampaignError(f"{unit}: is no FMU by its name; give a file that ends in .fmu")
    with open_subject(unit, kind, chosen) as subject:
        identification, base = subject.identification, load_parameters(files, model=subject.model)
        base = base if files else base.with_values(dict(subject.values))
    return base, identification.guid, str(unit.resolve()), identification.sha256, chosen


def _model(path: Path, entry: _Base, chosen: str | None) -> str | None:
    """Return the full name of the chosen model, or of the one in the file, if any."""
    model = chosen or entry.model
    if model is None:
        return None
    if chosen is None and model.partition("+")[0].endswith(".py"):
        model = str(path.parent / model)
    try:
        get(model)
        return full_name(model)
    except EmcasError as error:
        where = f"{path}: base.model = " if chosen is None else "model "
        raise CampaignError(where + str(error).removeprefix("model ")) from error


def _samples(path: Path, campaign: _Campaign, factors: Sequence[Factor]) -> int:
    if campaign.method != "grid":
        return campaign.samples or 1000
    for factor in factors:
        if factor.distribution.kind != "choice" or np.ptp(np.diff(factor.distribution.cumulated, prepend=0.0)) > 1e-9:
            raise CampaignError(f"{path}: {factor.name}: a grid needs levels = [...], or low, high and count, without "
                                "weights")
    points = prod(len(f.distribution.levels) for f in factors)
    if points > MOST_SAMPLES:
        raise CampaignError(f"{path}: the grid has {points} points; at most {MOST_SAMPLES} can be run")
    if campaign.samples not in (None, points):
        raise CampaignError(f"{path}: campaign.samples = {campaign.samples}: the grid has {points} points; leave "
                            "samples out")
    return points
