"""The independent response to a case: the stored one, one kept since it was integrated, or one integrated now."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from contextlib import suppress
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
from .cases import Case
from .events import Value
from .simulate import Array

_KEPT = 256  # responses of some 35 kB
_EXACT = 17  # digits that tell any two floats apart: rounded here, they would lie on edges of the archive's rounding


def is_shipped(parameters: ParameterSet, case: Case) -> bool:
    """Return whether the response of an actuator is stored."""
    if parameters.model != NONLINEAR:
        return False
    made = files.read_provenance(models_directory() / "reference").get(case.name)
    wanted = files.response_hash({**parameters.values, **case.overrides})
    return made is not None and made["sha256_parameters"] == wanted


def shipped(parameters: ParameterSet, case: Case) -> dict[str, Array] | None:
    """Return the stored response of an actuator, as far as the case goes; None where none is stored."""
    if not is_shipped(parameters, case):
        return None
    (known,), rows = stored.load(models_directory() / "reference", [case.name]), len(case.inputs()["time"])
    return {name: column[:rows] for name, column in known.reference.items()}


def response(parameters: ParameterSet, case: Case) -> dict[str, Array]:
    """Return `time` and the outputs that the independent integration of an actuator gives.

    It takes a second or two, but where the response is stored, or kept in the user's cache. An actuator of the user's
    is integrated each time: nobody sees when its file changes.
    """
    if (known := shipped(parameters, case)) is not None:
        return known
    given, inputs = {**parameters.values, **case.overrides}, case.inputs()
    kept = _place(parameters.model, given, inputs)
    if kept is not None:
        with suppress(OSError, ValueError):  # not there, or damaged
            return files.read_csv(kept)
    simulate = files.simulator(parameters.model)
    result = dict(simulate(given, inputs))
    if kept is not None:
        _keep(kept, result)
    return result


def _place(model: str, values: Mapping[str, Value], inputs: Mapping[str, Array]) -> Path | None:
    """Return where a response is kept: named by all that it follows from. None where it is not."""
    reference = get(model).reference
    if not isinstance(reference, str) or not reference.startswith(__package__):
        return None
    folder = Path(str(import_module(reference).__file__)).parent
    follows = json.dumps([
        __version__, scipy.__version__, reference, files.response_hash(values), files.csv_text(inputs),
        *(path.read_text(encoding="utf-8") for path in sorted(folder.glob("*.py")))])
    try:
        return cache_directory() / "references" / f"{hashlib.sha256(follows.encode()).hexdigest()[:32]}.csv"
    except OSError:
        return None


def _keep(path: Path, columns: Mapping[str, Array]) -> None:
    """Write a response, and let the oldest go; a cache that cannot be written is none."""
    try:
        path.parent.mkdir(exist_ok=True)
        write(path, files.csv_text(columns, _EXACT))
        by_age = sorted(path.parent.glob("*.csv"), key=lambda each: each.stat().st_mtime)
        for old in by_age[:-_KEPT]:
            old.unlink(missing_ok=True)
    except (EmcasError, OSError):
        return
