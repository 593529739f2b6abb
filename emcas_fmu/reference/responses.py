"""The independent response of an actuator to a case: stored, cached or integrated."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from contextlib import suppress
from functools import cache
from importlib import import_module
from pathlib import Path

import scipy

from .. import __version__
from ..actuators import NONLINEAR, get
from ..errors import EmcasError
from ..parameters import ParameterSet
from ..support.files import cache_directory, models_directory
from ..support.writing import write
from . import files, stored
from .cases import ReferenceCase
from .events import Array, Scalar

_KEPT = 256  # largest number of cached responses, each about 0.1 MB per second of its case
_EXACT = 17  # significant digits, which preserve every float: references in an FMU are rounded only once


def shipped(parameters: ParameterSet, case: ReferenceCase) -> dict[str, Array] | None:
    """Return the shipped response [SI] to a case, up to the case's end; None if there is none for these parameters."""
    if parameters.model != NONLINEAR:
        return None
    known = _stored(models_directory() / "reference", case.name)
    if known is None or known.parameters_hash != files.response_hash({**parameters.values, **case.overrides}):
        return None
    rows = len(case.inputs()["time"])
    return {name: column[:rows] for name, column in known.reference.items()}


@cache
def _stored(folder: Path, name: str) -> stored.Stored | None:
    """Return a stored case, None if its name is unknown; cached, since the build of an FMU needs it several times."""
    return stored.load(folder, [name])[0] if name in files.read_provenance(folder) else None


def response(parameters: ParameterSet, case: ReferenceCase) -> dict[str, Array]:
    """Return `time` [s] and the outputs [SI] of the independent integration of an actuator.

    The response is the shipped one, or is read from the user's cache, or integrated, which takes about two seconds per
    second of the case. A user's own actuator is integrated at each call, since the cache would not notice a change of
    its file. Raises EmcasError for an actuator without an integration.
    """
    if (known := shipped(parameters, case)) is not None:
        return known
    values, inputs = {**parameters.values, **case.overrides}, case.inputs()
    cached = _cache_path(parameters.model, values, inputs)
    if cached is not None:
        with suppress(OSError, ValueError):  # missing or damaged
            return files.read_csv(cached)
    result = dict(files.simulator(parameters.model)(values, inputs))
    if cached is not None:
        _write_cached(cached, result)
    return result


def _cache_path(model: str, values: Mapping[str, Scalar], inputs: Mapping[str, Array]) -> Path | None:
    """Return the path of a cached response, named by a hash of everything that determines it; None without a cache."""
    reference = get(model).reference
    if not isinstance(reference, str) or not reference.startswith(__package__):
        return None
    folder = Path(str(import_module(reference).__file__)).parent
    inputs_of_hash = json.dumps([
        __version__, scipy.__version__, reference, files.response_hash(values), files.csv_text(inputs),
        *(path.read_text(encoding="utf-8") for path in sorted(folder.glob("*.py")))])
    try:
        return cache_directory() / "references" / f"{hashlib.sha256(inputs_of_hash.encode()).hexdigest()[:32]}.csv"
    except OSError:
        return None


def _write_cached(path: Path, columns: Mapping[str, Array]) -> None:
    """Write a response to the cache and delete its oldest responses; ignore a cache that cannot be written."""
    try:
        path.parent.mkdir(exist_ok=True)
        write(path, files.csv_text(columns, _EXACT))
        by_age = sorted(path.parent.glob("*.csv"), key=lambda each: each.stat().st_mtime)
        for old in by_age[:-_KEPT]:
            old.unlink(missing_ok=True)
    except (EmcasError, OSError):
        return
