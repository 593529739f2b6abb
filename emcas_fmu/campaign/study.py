"""A campaign: what varies, what is done in each sample, on which parameters. Read from TOML."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import prod
from pathlib import Path
from typing import Any

from ..actuators import NONLINEAR, get
from ..errors import EmcasError, hint, require_known
from ..fmi.package import interface_guid
from ..parameters import ParameterSet, check_parameters, load_parameters
from ..toml import tomllib
from ..unit import MOST_FINS, Unit, start_values
from ..variables import INPUTS
from .distributions import CampaignError
from .entries import Reader, table_of
from .plan import Factor, Plan, varied

METHODS = ("monte-carlo", "latin-hypercube", "sobol", "grid")
MOST_SAMPLES = 100_000_000


@dataclass(frozen=True)
class Study:
    """A campaign file understood. `guid` is the FMU's that runs, or that these parameters would be built into."""

    path: Path
    text: str
    document: Mapping[str, Any]
    method: str
    samples: int
    seed: int
    guid: str
    plan: Plan


def load_study(path: Path, fmu: Path | None = None, fin: int | None = None, model: str | None = None) -> Study:
    """The campaign of a TOML file (see models/campaign.toml). Raises CampaignError.

    `fmu`, and `fin` of a unit of several, counted from 1, replace the file's own, and so does `model`, one of
    :mod:`emcas_fmu.actuators`.
    """
    try:
        text = path.read_text(encoding="utf-8-sig")
        document = tomllib.loads(text)
    except (OSError, ValueError) as error:
        raise CampaignError(f"{path}: cannot be read: {error}") from error
    require_known(document, ("campaign", "base", "vary", "inputs", "experiments"), str(path), CampaignError)
    about = table_of(document, "campaign", f"{path}")
    require_known(about, ("samples", "seed", "method"), f"{path}: campaign", CampaignError)
    method = about.get("method", "monte-carlo")
    if method not in METHODS:
        raise CampaignError(f"{path}: campaign.method = {method!r}{hint(method, METHODS)}; there is "
                            f"{', '.join(METHODS)}")
    base, guid, unit, digest, chosen = _base(path, table_of(document, "base", f"{path}"), fmu, fin,
                                           model)
    reader = Reader(path, base)
    reader.read(document)
    if not reader.factors:
        raise CampaignError(f"{path}: nothing varies; give at least one [vary.\"NAME\"] with a distribution")
    plan = Plan(dict(base.values), reader.numbers, tuple(reader.factors), reader.followers,
                tuple(reader.experiments), _whole(path, about, "seed", 1, 0, 2**63 - 1), unit, digest, chosen,
                base.model)
    samples = _samples(path, about, method, plan.factors)
    _check_middle(path, plan)
    return Study(path, text, document, method, samples, plan.seed, guid, plan)


def _base(path: Path, entry: Mapping[str, Any], fmu: Path | None, fin: int | None,
          model: str | None) -> tuple[ParameterSet, str, str, str, int]:
    """Base set, GUID, and of the FMU if one is to run, path, SHA-256 and fin."""
    require_known(entry, ("model", "parameters", "fmu", "fin"), f"{path}: base", CampaignError)
    chosen = fin if fin is not None else _whole(path, entry, "fin", 1, 1, MOST_FINS, "base")
    for key, written in entry.items():
        if key != "fin" and not isinstance(written, str):
            raise CampaignError(f"{path}: base.{key}: expected the name of a {'model' if key == 'model' else 'file'}")
    kind = _model(path, entry, model)
    # Files are named as seen from the campaign's own, which can then be run from anywhere.
    file = path.parent / entry["parameters"] if "parameters" in entry else None
    unit = fmu if fmu is not None else path.parent / entry["fmu"] if "fmu" in entry else None
    if unit is None:
        if fin is not None or "fin" in entry:
            raise CampaignError(f"{path}: fin {chosen} is one of an FMU; name it with --fmu or base.fmu")
        base = load_parameters(file, model=kind or NONLINEAR)
        shown = Unit(1, base.model)
        return base, interface_guid(start_values(shown, [base.values]), shown), "", "", 1
    from ..bench.fmu import chosen_model, opened

    if unit.suffix.lower() != ".fmu":
        raise CampaignError(f"{unit}: is no FMU by its name; give a file that ends in .fmu")
    with opened(unit, chosen) as there:
        kind = chosen_model(str(unit), there.description.modelName, kind, CampaignError)
        actuator = get(kind)
        for variables, causality in ((actuator.inputs, "input"), (actuator.outputs, "output"),
                                     (actuator.parameters, "parameter")):
            there.require([v.name for v in variables], causality)
        guid, values = there.description.guid, {v.name: there.starts[v.name] for v in actuator.parameters}
        values |= {v.key: there.starts[v.name] for v in INPUTS if v.key}
    base = load_parameters(file, model=kind)
    return base if file else base.replace(values), guid, str(unit.resolve()), there.sha256, chosen


def _model(path: Path, entry: Mapping[str, Any], given: str | None) -> str | None:
    """The model asked for, its options in their order; nothing if none is."""
    asked = given or entry.get("model")
    if asked is None:
        return None
    try:
        return get(asked).name
    except EmcasError as error:
        where = f"{path}: base.model = " if given is None else "--model "
        raise CampaignError(where + str(error).removeprefix("--model ")) from error


def _whole(path: Path, about: Mapping[str, Any], key: str, default: int, low: int, high: int,
           table: str = "campaign") -> int:
    found = about.get(key, default)
    if isinstance(found, bool) or not isinstance(found, int) or not low <= found <= high:
        raise CampaignError(f"{path}: {table}.{key} = {found}: expected a whole number within {low} .. {high}")
    return found


def _samples(path: Path, about: Mapping[str, Any], method: str, factors: tuple[Factor, ...]) -> int:
    if method != "grid":
        return _whole(path, about, "samples", 1000, 1, MOST_SAMPLES)
    for factor in factors:
        if factor.distribution.kind != "choice" or len(set(_steps(factor.distribution.cumulated))) > 1:
            raise CampaignError(f"{path}: {factor.name}: a grid needs levels = [...], or low, high and count, without "
                                "weights")
    points = prod(len(f.distribution.levels) for f in factors)
    if points > MOST_SAMPLES:
        raise CampaignError(f"{path}: the grid has {points} points; at most {MOST_SAMPLES} can be run")
    if about.get("samples", points) != points:
        raise CampaignError(f"{path}: campaign.samples = {about['samples']}: the grid has {points} points; leave "
                            "samples out")
    return points


def _steps(cumulated: tuple[float, ...]) -> list[float]:
    return [round(b - a, 9) for a, b in zip((0.0, *cumulated), cumulated)]


def _check_middle(path: Path, plan: Plan) -> None:
    """With everything at its median the parameters must go together: what does not there seldom does anywhere."""
    drawn = {f.name: f.value(float(f.distribution.at(0.5))) for f in plan.factors}
    values, _ = varied(plan, drawn)
    if problems := check_parameters({v.name: values[v.name] for v in get(plan.model).parameters}, plan.model):
        raise CampaignError(f"{path}: with everything at its median: {'; '.join(problems)}")
