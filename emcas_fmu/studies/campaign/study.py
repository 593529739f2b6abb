"""A campaign, read from TOML: factors, experiments, and the parameters or FMU to which they apply."""

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
    Scalar,
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
from .distributions import MOST_OUTSIDE, CampaignError, Factor
from .experiments import Experiment
from .schema import Entries, Reader

MOST_SAMPLES = 100_000_000
SHIPPED = "shipped"  # name of the shipped requirements for the campaign's model


class _Campaign(Table):
    samples: Annotated[int, Field(ge=1, le=MOST_SAMPLES)] | None = None
    seed: Annotated[int, Field(ge=0, le=2**63 - 1)] = 1
    method: Literal["monte-carlo", "latin-hypercube", "sobol", "grid"] = "monte-carlo"


def _names(written: object) -> tuple[str, ...]:
    names = tuple(written) if isinstance(written, list) else (written,)
    if not all(isinstance(name, str) for name in names):
        raise ValueError("must be the name of a file, or a list of such names")
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
class Campaign:
    """A campaign, read from the file `path`; workers receive a copy.

    `text` is the content of the file and `document` its TOML. `guid` is that of the FMU, or of the FMU that would be
    built from the parameters. `base` are the parameters (flat, SI) of the actuator `model` (full name). `numbers` are
    the fixed values of motions and profiles by name. `followers` maps parameters that keep their ratio to a factor to
    the name of this factor. `fmu` is the path of an FMU, or empty for the kernel; `fin` is the number of its fin, from
    1. `model_sha256` is the SHA-256 of the user's file that declares the model, or empty. Every sample is judged by the
    `specification`, the requirements that can be measured for the model. Factors that are not parameters do not affect
    the requirements, whose tests have their own inputs. `left_out` are the requirements that cannot be measured, with
    the reasons. `warnings` are those of the base set, and one for each rule that is broken with all factors at their
    medians, or with one factor at an end of its distribution.
    """

    path: Path
    text: str
    document: Mapping[str, Any]
    method: str
    samples: int
    seed: int
    guid: str
    base: Mapping[str, Scalar]
    numbers: Mapping[str, Scalar]
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
        """Return the values [indices, factors] of the factors in samples, in the factors' units.

        Apart from the distributions they depend only on the sample's index, the seed (not in a ``grid``) and the number
        of factors; in a ``latin-hypercube`` also on the number of samples. Sample i of a ``monte-carlo`` campaign has
        its own generator, seeded with (seed, i). In ``sobol`` it is point i of a scrambled sequence, in
        ``latin-hypercube`` row i of one hypercube for all samples. In a ``grid`` the level of the last factor changes
        fastest. Raises IndexError for an index outside the campaign.
        """
        if outside := [i for i in indices if not 0 <= i < self.samples]:
            raise IndexError(f"there is no sample {outside[0]}; the indices are 0 to {self.samples - 1}")
        distributions = [f.distribution for f in self.factors]
        if self.method == "grid":
            positions = np.unravel_index(np.asarray(indices), [len(d.levels) for d in distributions])
            return np.column_stack([np.asarray(d.levels, dtype=float)[k]
                                    for d, k in zip(distributions, positions, strict=True)])
        if self.method == "sobol":
            probabilities = _sobol(len(self.factors), self.seed, indices)
        elif self.method == "latin-hypercube":
            probabilities = hypercube(len(self.factors), self.seed, self.samples)[np.asarray(indices)]
        else:
            probabilities = np.array([np.random.default_rng([self.seed, i]).random(len(self.factors))
                                      for i in indices])
        return np.column_stack([d.at(probabilities[:, k]) for k, d in enumerate(distributions)])

    def factor_values(self, drawn: Iterable[Any]) -> dict[str, Any]:
        """Return the values of factors and followers by name; `drawn` are numbers or arrays [samples]."""
        values = {f.name: f.value(x) for f, x in zip(self.factors, drawn, strict=True)}
        return values | {name: self.base[name] * (values[leader] / self.base[leader])
                         for name, leader in self.followers.items()}

    def varied(self, drawn: Iterable[Any]) -> tuple[dict[str, Any], dict[str, Any]]:
        """Return the parameters, and the numbers of motions and profiles, for the values `drawn` of the factors.

        Both are flat and in SI. If `drawn` has arrays [samples], the factors and their followers are also arrays.
        """
        values, numbers = dict[str, Any](self.base), dict[str, Any](self.numbers)
        for name, value in self.factor_values(drawn).items():
            (values if name in values else numbers)[name] = value
        return values, numbers


@lru_cache(maxsize=1)
def hypercube(factors: int, seed: int, samples: int) -> Array:
    """Return a Latin hypercube [samples, factors] of probabilities between 0 and 1."""
    cube: Array = qmc.LatinHypercube(factors, rng=np.random.default_rng([seed])).random(samples)
    return cube


def _sobol(factors: int, seed: int, indices: Sequence[int]) -> Array:
    """Return points [indices, factors] of a Sobol sequence, which are generated in ascending order, each index once."""
    engine = qmc.Sobol(factors, scramble=True, rng=np.random.default_rng([seed]))
    ordered, positions = np.unique(np.asarray(indices), return_inverse=True)
    points = np.empty((len(ordered), factors))
    for row, index in zip(points, ordered.tolist(), strict=True):
        if index > engine.num_generated:
            engine.fast_forward(index - engine.num_generated)
        row[:] = engine.random(1)[0]
    # A scrambled point may contain 0, at which the quantile of a normal distribution is infinite.
    return np.clip(points, 2.0**-53, 1.0 - 2.0**-53)[positions]


def load_study(path: Path, fmu: Path | None = None, fin: int | None = None, model: str | None = None,
               requirements: Path | str | None = None) -> Campaign:
    """Return the campaign in a TOML file (see models/campaign.toml).

    `fmu`, its `fin` (from 1) and `model`, a name for :func:`emcas_fmu.actuators.get`, override the file's entries.
    Every sample is judged by `requirements`, a file or SHIPPED (default: none). Raises CampaignError; EmcasError if the
    FMU or the requirements cannot be used; ParameterError for problems in parameter files.
    """
    text, document = schema.document(path, CampaignError)
    file = schema.read(_File, document, path, CampaignError)
    base, guid, fmu_path, digest, fin_number = _base(path, file.base, fmu, fin, model)
    reader = Reader(base)
    written = {key: document[key] for key in Entries.model_fields if key in document}
    entries = schema.read(Entries, written, path, CampaignError, reader)
    if not reader.factors:
        raise CampaignError(f"{path}: there is no factor; add at least one [vary.\"NAME\"] with a distribution")
    if not entries.experiments:
        raise CampaignError(f"{path}: there is no experiment; add at least one [experiments.NAME] with a kind")
    specification, subject = Specification(()), ParameterSubject(base)
    if requirements is not None:
        specification = load_requirements(None if str(requirements) == SHIPPED else Path(requirements), base)
    measurable = tuple(r for r in specification.requirements if not r.obstacle(subject))
    if specification.requirements and not measurable:
        raise CampaignError(f"{requirements}: no requirement can be measured for {base.model}; omit --requirements")
    study = Campaign(
        path, text, document, file.campaign.method, _samples(path, file.campaign, reader.factors), file.campaign.seed,
        guid, dict(base.values), reader.numbers, tuple(reader.factors), reader.followers,
        tuple(entries.experiments.values()), fmu=fmu_path, fmu_sha256=digest, fin=fin_number, model=base.model,
        model_sha256=source_sha256(base.model), specification=replace(specification, requirements=measurable),
        left_out=tuple(judged(r, (), subject) for r in specification.requirements if r not in measurable))
    # With parameters that contradict each other at the medians, most samples would fail.
    medians = [float(f.distribution.at(0.5)) for f in study.factors]
    if problems := check_parameters(study.varied(medians)[0], study.model):
        raise CampaignError(f"{path}: with all factors at their medians: {'; '.join(problems)}")
    return replace(study, warnings=tuple(_warnings(base, study, medians)))


def source_sha256(model: str) -> str:
    """Return the SHA-256 of the user's file that declares an actuator; empty for a shipped actuator."""
    source = get(model).source
    return "" if source is None else hashlib.sha256(source.read_bytes()).hexdigest()


def _warnings(base: ParameterSet, study: Campaign, medians: list[float]) -> Iterator[str]:
    """Yield the warnings of a campaign: those of the base set that are not from rules, then those of the rules."""
    from_rules = check_combinations(base.values, base.actuator, warnings=True)
    yield from (warning for warning in base.warnings if warning not in from_rules)
    points = [medians, *([*medians[:k], end, *medians[k + 1:]] for k, factor in enumerate(study.factors)
                         for end in factor.distribution.limits(MOST_OUTSIDE))]
    first: dict[Rule, str] = {}
    for values, _ in map(study.varied, points):
        if not check_parameters(values, study.model):  # a sample with these values would fail, which its row reports
            first = {**broken_rules(values, study.actuator, warnings=True), **first}
    yield from (first[rule] for rule in study.actuator.all_rules if rule in first)


def _base(path: Path, entry: _Base, fmu: Path | None, fin: int | None,
          model: str | None) -> tuple[ParameterSet, str, str, str, int]:
    """Return the base set, the GUID, and the FMU's path, SHA-256 (both empty without an FMU) and fin."""
    chosen = fin if fin is not None else entry.fin or 1
    kind = _model(path, entry, model)
    # Paths are relative to the campaign's file: it can be run from any folder.
    files = [parameter_file(name, path.parent) for name in entry.parameters]
    fmu_path = fmu if fmu is not None else path.parent / entry.fmu if entry.fmu else None
    if fmu_path is None:
        if fin is not None or entry.fin is not None:
            raise CampaignError(f"{path}: fin {chosen} must be a fin of an FMU; name the FMU with --fmu or base.fmu")
        base = load_parameters(files, model=kind or NONLINEAR)
        interface = FmuInterface(1, base.model)
        return base, interface_guid(start_values(interface, [base.values]), interface), "", "", 1
    if fmu_path.suffix.lower() != ".fmu":
        raise CampaignError(f"{fmu_path}: is not an FMU by its name; name a file that ends in .fmu")
    with open_subject(fmu_path, kind, chosen) as subject:
        identification, base = subject.identification, load_parameters(files, model=subject.model)
        base = base if files else base.with_values(dict(subject.values))
    return base, identification.guid, str(fmu_path.resolve()), identification.sha256, chosen


def _model(path: Path, entry: _Base, chosen: str | None) -> str | None:
    """Return the full name of the chosen model or, if it is None, of the model in the file; None without both."""
    model = chosen or entry.model
    if model is None:
        return None
    if chosen is None and model.partition("+")[0].endswith(".py"):
        model = str(path.parent / model)
    try:
        get(model)
        return full_name(model)
    except EmcasError as error:
        location = f"{path}: base.model = " if chosen is None else "model "
        raise CampaignError(location + str(error).removeprefix("model ")) from error


def _samples(path: Path, campaign: _Campaign, factors: Sequence[Factor]) -> int:
    if campaign.method != "grid":
        return campaign.samples or 1000
    for factor in factors:
        if factor.distribution.kind != "choice" or np.ptp(np.diff(factor.distribution.cumulated, prepend=0.0)) > 1e-9:
            raise CampaignError(f"{path}: {factor.name}: a grid needs levels = [...], or low, high and count, without "
                                "weights")
    points = prod(len(f.distribution.levels) for f in factors)
    if points > MOST_SAMPLES:
        raise CampaignError(f"{path}: the grid has {points} points, above {MOST_SAMPLES}; reduce the levels")
    if campaign.samples not in (None, points):
        raise CampaignError(f"{path}: campaign.samples = {campaign.samples}: the grid has {points} points; omit "
                            "campaign.samples")
    return points
