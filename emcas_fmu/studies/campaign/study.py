"""A campaign, read from TOML: factors, experiments and the parameters or FMU that they apply to."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from math import prod
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, PlainValidator

from ...actuators import NONLINEAR, full_name, get
from ...bench.fmu_subject import open_subject
from ...bench.requirements import load_requirements
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
from .distributions import MOST_OUTSIDE, CampaignError
from .plan import UNJUDGED, Factor, Plan, source_sha256
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
    """A campaign.

    `guid` is that of its FMU, or of the FMU that would be built from its parameters. `warnings` are those of the
    parameters with all factors at their medians and with each at either end, one for each rule. `left_out` are the
    requirements that cannot be measured of the actuator, with the reasons.
    """

    path: Path
    text: str
    document: Mapping[str, Any]
    method: str
    samples: int
    guid: str
    plan: Plan
    warnings: tuple[str, ...] = ()
    left_out: tuple[Judged, ...] = ()


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
    schema.read(Entries, {key: document[key] for key in Entries.model_fields if key in document}, path, CampaignError,
                reader)
    if not reader.factors:
        raise CampaignError(f"{path}: nothing varies; give at least one [vary.\"NAME\"] with a distribution")
    if not reader.experiments:
        raise CampaignError(f"{path}: nothing is done; give at least one [experiments.NAME] with a kind")
    specification = UNJUDGED
    if requirements is not None:
        specification = load_requirements(None if str(requirements) == SHIPPED else Path(requirements), base)
    subject = ParameterSubject(base)
    able = tuple(r for r in specification.requirements if not r.obstacle(subject))
    if specification.requirements and not able:
        raise CampaignError(f"{requirements}: none of its requirements can be measured of {base.model}; leave "
                            "--requirements out")
    plan = Plan(dict(base.values), reader.numbers, tuple(reader.factors), reader.followers, tuple(reader.experiments),
                file.campaign.seed, unit, digest, chosen, base.model, source_sha256(base.model),
                replace(specification, requirements=able))
    samples = _samples(path, file.campaign, plan.factors)
    # If the parameters contradict each other at the medians, few samples could be run.
    values, _ = plan.varied(float(f.distribution.at(0.5)) for f in plan.factors)
    if problems := check_parameters({v.name: values[v.name] for v in plan.actuator.parameters}, plan.model):
        raise CampaignError(f"{path}: with everything at its median: {'; '.join(problems)}")
    warnings = tuple(_warnings(base, plan))
    left_out = tuple(judged(r, (), subject) for r in specification.requirements if r not in able)
    return Study(path, text, document, file.campaign.method, samples, guid, plan, warnings, left_out)


def _warnings(base: ParameterSet, plan: Plan) -> Iterator[str]:
    """Yield the first warning of each rule: at the medians, or with one factor at an end."""
    varied = check_combinations(base.values, base.actuator, warnings=True)
    yield from (warning for warning in base.warnings if warning not in varied)
    median = [float(f.distribution.at(0.5)) for f in plan.factors]
    points = [median, *([*median[:k], end, *median[k + 1:]] for k, factor in enumerate(plan.factors)
                        for end in factor.distribution.limits(MOST_OUTSIDE))]
    sets = [values for values, _ in map(plan.varied, points) if not check_parameters(
        {v.name: values[v.name] for v in plan.actuator.parameters}, plan.model)]  # other samples fail with an error
    first: dict[Rule, str] = {}
    for values in sets:
        first = {**broken_rules(values, plan.actuator, warnings=True), **first}
    yield from (first[rule] for rule in plan.actuator.all_rules if rule in first)


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
        where = f"{path}: base.model = " if chosen is None else "--model "
        raise CampaignError(where + str(error).removeprefix("--model ")) from error


def _samples(path: Path, campaign: _Campaign, factors: tuple[Factor, ...]) -> int:
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
