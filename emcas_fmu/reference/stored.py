"""The stored reference cases, checked against the hashes of their provenance."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..actuators import NONLINEAR
from ..errors import EmcasError
from ..simulation import Array
from . import files

Columns = Mapping[str, Array]


@dataclass(frozen=True)
class Stored:
    """A reference case as its folder, or an FMU, holds it; `model` is the actuator it is of.

    One that is not `independent` is the response of the package's own stepping.
    """

    name: str
    title: str
    kind: str
    step: float
    stop_time: float
    start_values: Mapping[str, Any]
    inputs: Columns
    reference: Columns
    parameters_hash: str
    model: str
    independent: bool = True


def load(folder: Path, names: Sequence[str] | None) -> list[Stored]:
    """Return the named cases of a folder (default all). Raises EmcasError where it is not as its provenance says."""
    remedy = f"make the reference files with `emcas reference --directory {folder}`"
    if not folder.is_dir():
        raise EmcasError(f"{folder}: there is no such folder of reference files; {remedy}")
    try:
        provenance = files.read_provenance(folder)
    except ValueError as error:
        raise EmcasError(f"{folder / files.PROVENANCE}: cannot be read ({error}); {remedy}") from error
    if not provenance:
        raise EmcasError(f"{folder / files.PROVENANCE}: is missing or empty; {remedy}")
    if unknown := sorted(set(names or ()) - set(provenance)):
        raise EmcasError(f"{folder}: has no case {', '.join(unknown)}; it has {', '.join(provenance)}")
    return [_case(folder, name, entry, remedy) for name, entry in provenance.items() if not names or name in names]


def _case(folder: Path, name: str, entry: Mapping[str, Any], remedy: str) -> Stored:
    tables = []
    for kind in ("in", "ref"):
        path, key = files.path_of(folder, name, f"{kind}.csv"), f"sha256_{kind}"
        if not path.is_file():
            raise EmcasError(f"{path}: is missing; {remedy}")
        if hashlib.sha256(path.read_bytes()).hexdigest() != entry.get(key):
            raise EmcasError(f"{path}: is not the file {files.PROVENANCE} was written for (its {key} differs); "
                             f"restore it, or {remedy}")
        tables.append(files.read_csv(path))
    try:
        return Stored(name, entry["title"], entry["kind"], entry["step"], entry["stop_time"], entry["start_values"],
                      tables[0], tables[1], entry["sha256_parameters"], entry.get("model", NONLINEAR))
    except KeyError as error:
        raise EmcasError(f"{folder / files.PROVENANCE}: {name} has no entry {error}; {remedy}") from error
