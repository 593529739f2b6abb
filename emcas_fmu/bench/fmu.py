"""Opening an FMU: what it is of, whether it can run here, and the names of one of its fins."""

from __future__ import annotations

import hashlib
import os
import re
import tempfile
import zipfile
import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache, cached_property
from itertools import combinations
from pathlib import Path
from typing import Any

import fmpy
from fmpy.model_description import read_model_description
from fmpy.simulation import instantiate_fmu

from ..actuators import EXTENSIONS, NAMES, get
from ..errors import EmcasError
from ..unit import model_name

_NAME = re.compile(r"(EMCAS)\d*(|_\w+)")
_FIN = re.compile(r"fin\[\d+\]\.")


@dataclass(frozen=True)
class OpenedFmu:
    """An FMU unpacked and understood; `starts` are the start values of inputs and parameters.

    Of a unit of several fins it is one of them: all names are those of a single actuator, `names` gives the
    FMU's for them. The other fins stay at their start values.
    """

    path: Path
    folder: Path
    description: Any
    starts: Mapping[str, Any]
    sha256: str
    names: Mapping[str, str]

    def instance(self, log: Callable[..., None]) -> Any:
        """An instance of it, whose messages `log` gets. Raises EmcasError where it does not start."""
        try:
            # Without debug logging on, pythonfmu's wrapper passes no message on.
            return instantiate_fmu(str(self.folder), self.description, "CoSimulation", debug_logging=True, logger=log)
        # fmpy reports a failed load or instantiation as OSError or as a bare Exception.
        except Exception as error:
            raise EmcasError(f"{self.path}: its binary for {fmpy.platform} does not start ({error}); see the FMU's "
                             "documentation/externalDependencies.txt for what it needs") from error

    @cached_property
    def references(self) -> Mapping[str, int]:
        """Value references by the names of a single actuator."""
        by_name = {v.name: int(v.valueReference) for v in self.description.modelVariables}
        return {name: by_name[full] for name, full in self.names.items()}

    def require(self, names: Sequence[str], causality: str) -> None:
        """Raise EmcasError where the FMU lacks variables of that causality."""
        present = {v.name for v in self.description.modelVariables if v.causality == causality}
        if missing := [name for name in names if self.names.get(name, name) not in present]:
            raise EmcasError(f"{self.path}: has no {causality} named {', '.join(missing)}; "
                             "an EM-CAS FMU is needed, such as `emcas build` makes")


def model_of(name: str) -> str | None:
    """The model and options, as in ``elastic+faults``, of an FMU by its modelName; None for a name of no such FMU."""
    found = _NAME.fullmatch(name)
    kind = None if found is None else _models().get("".join(found.groups()))
    try:
        return None if kind is None else get(kind).name
    except EmcasError:  # options that do not go together
        return None


def chosen_model(file: str, name: str, asked: str | None, error: type[EmcasError] = EmcasError) -> str:
    """The model of the FMU `file` with that modelName, or where it tells none the one `asked` for.

    Raises `error` where neither is, or they are not the same.
    """
    told = model_of(name)
    if told is None and asked is None:
        raise error(f"{file}: is named {name}, which does not tell its model; name it with --model, such as "
                    "elastic+faults, or build the FMU anew with emcas build")
    if told is not None and asked not in (None, told):
        raise error(f"{file}: is of the model {told}, and {asked} is asked for; leave the model out, or build the FMU "
                    f"with emcas build --model {asked}")
    return str(told or asked)


@cache
def _models() -> Mapping[str, str]:
    """Models with any of the options by the modelName of one fin."""
    chosen = [subset for n in range(len(EXTENSIONS) + 1) for subset in combinations(EXTENSIONS, n)]
    kinds = ["+".join((model, *options)) for options in reversed(chosen) for model in reversed(NAMES)]
    return {model_name(kind): kind for kind in kinds}


@contextmanager
def opened(path: Path, fin: int | None = None) -> Iterator[OpenedFmu]:
    """The FMU at `path`, unpacked for as long as the context lasts; EmcasError where it cannot run here.

    `fin` counts from 1 and chooses one of a unit of several; the first unless given.
    """
    if path.is_dir():
        raise EmcasError(f"{path}: is a folder, not an FMU")
    if not path.is_file():
        raise EmcasError(f"{path}: there is no such file; build one with `emcas build --output {path}`")
    try:
        description = read_model_description(str(path))
    # fmpy reports an unsound model description as a bare Exception.
    except Exception as error:
        reason = "not a ZIP archive" if not zipfile.is_zipfile(path) else " ".join(str(error).split())
        raise EmcasError(f"{path}: is not an FMU that can be read ({reason})") from error
    if description.coSimulation is None or description.fmiVersion != "2.0":
        raise EmcasError(f"{path}: is not an FMI 2.0 co-simulation FMU (FMI {description.fmiVersion})")
    platforms = fmpy.supported_platforms(str(path))
    if fmpy.platform not in platforms:
        raise EmcasError(f"{path}: has no binary for this platform, {fmpy.platform} (it has: "
                         f"{', '.join(p for p in platforms if p != 'c-code') or 'none'}); build the FMU for it")
    names = _names(path, [v.name for v in description.modelVariables], fin)
    shown = {name: own for own, name in names.items()}
    starts = {shown[v.name]: _start(v) for v in description.modelVariables
              if v.causality in ("input", "parameter") and v.name in shown}
    digest = hashlib.sha256(path.read_bytes()).hexdigest()
    here = Path.cwd()
    with tempfile.TemporaryDirectory(prefix="emcas_fmu_", ignore_cleanup_errors=True) as folder:
        try:
            fmpy.extract(str(path), unzipdir=folder)
        except (zipfile.BadZipFile, zlib.error, OSError) as error:
            raise EmcasError(f"{path}: cannot be unpacked ({error}); copy or build it again") from error
        try:
            yield OpenedFmu(path, Path(folder), description, starts, digest, names)
        finally:
            os.chdir(here)  # fmpy stays in the FMU's folder where a library does not load


def _names(path: Path, present: Sequence[str], fin: int | None) -> dict[str, str]:
    """The FMU's names of one fin's variables, by those of a single actuator."""
    prefixes = {match[0] for name in present if (match := _FIN.match(name))}
    if not prefixes:
        if fin not in (None, 1):
            raise EmcasError(f"{path}: is a unit of one fin, there is no fin {fin}")
        return {name: name for name in present}
    prefix = f"fin[{fin or 1}]."
    if prefix not in prefixes:
        raise EmcasError(f"{path}: has {len(prefixes)} fins, there is no fin {fin}")
    shared = {name: name for name in present if not _FIN.match(name)}
    return shared | {name.removeprefix(prefix): name for name in present if name.startswith(prefix)}


def _start(variable: Any) -> Any:
    if variable.type == "Boolean":
        return variable.start in ("true", "1", True)
    if variable.type == "String":
        return variable.start
    return int(variable.start or 0) if variable.type == "Integer" else float(variable.start or 0.0)
