"""An opened FMU: its model, whether it can run here, and the variable names of one of its fins."""

from __future__ import annotations

import hashlib
import os
import re
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import fmpy
from fmpy.model_description import read_model_description
from fmpy.simulation import instantiate_fmu

from ..actuators import EXTENSIONS, FMU_ONLY, NAMES, get
from ..errors import EmcasError
from ..fmi.fmi3.arrays import arrays
from ..fmi.interface import FmuInterface, flat, model_name
from ..support.archives import reading
from .fmi3 import Element, Fmi3Slave, elements

_NAME = re.compile(r"(EMCAS)(\d*)(|_\w+)")
_IDENTIFIER = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")
_FIN = re.compile(r"fin\[\d+\]\.")


@dataclass(frozen=True)
class OpenedFmu:
    """One fin of the FMU `path`, unpacked in `folder`; `description` is fmpy's. Other fins keep their start values.

    `starts` are the start values of inputs and parameters by the names of a single actuator; `names` maps these to the
    names in `variables`: the FMU's variables, elements instead of arrays, with the structured names of FMI 2.0.
    """

    path: Path
    folder: Path
    description: Any
    variables: Sequence[Element]
    starts: Mapping[str, Any]
    sha256: str
    names: Mapping[str, str]

    def instance(self, log: Callable[..., None]) -> Any:
        """Return a new instance, which passes its messages to `log`. Raises EmcasError if it does not start."""
        def log_3(environment: Any, *message: Any) -> None:  # FMI 3.0 passes no instance name
            log(environment, b"", *message)

        try:
            # Without debug logging, pythonfmu's wrapper forwards no messages.
            slave = instantiate_fmu(str(self.folder), self.description, "CoSimulation", debug_logging=True,
                                    logger=log_3 if self._fmi3 else log)
        # fmpy reports a failed load or instantiation as OSError or as a bare Exception.
        except Exception as error:
            raise EmcasError(f"{self.path}: its binary for {fmpy.platform} does not start ({error}); see the FMU's "
                             "documentation/externalDependencies.txt for its requirements") from error
        return Fmi3Slave(slave, self.variables) if self._fmi3 else slave

    @property
    def _fmi3(self) -> bool:
        return bool(self.description.fmiVersion == "3.0")

    @cached_property
    def references(self) -> Mapping[str, int]:
        """The value references (for FMI 3.0, indices in `variables`) by the names of a single actuator."""
        by_name = {v.name: i if self._fmi3 else v.reference for i, v in enumerate(self.variables)}
        return {name: by_name[full] for name, full in self.names.items()}

    @property
    def names_in_files(self) -> Mapping[str, str]:
        """The names in the archive's tables and parameter sets by the names of a single actuator."""
        in_files = {v.name: v.in_files for v in self.variables}
        return {name: in_files[full] for name, full in self.names.items()}

    def set_starts(self, instance: Any, values: Mapping[str, Any]) -> None:
        """Set start values by the names of a single actuator before the instance is initialized."""
        kinds = {v.name: v.kind for v in self.variables}
        for name, value in values.items():
            kind = kinds[self.names[name]]
            convert = {"Real": float, "Boolean": bool}.get(kind, int)
            getattr(instance, f"set{kind}")([self.references[name]], [convert(value)])

    def require(self, names: Sequence[str], causality: str) -> None:
        """Raise EmcasError if the FMU lacks one of `names` with a causality; a parameter also counts as an input."""
        present = {v.name for v in self.variables if v.causality == causality
                   or (causality == "input" and v.causality == "parameter")}
        if missing := [name for name in names if self.names.get(name, name) not in present]:
            raise EmcasError(f"{self.path}: has no {causality} named {', '.join(missing)}; "
                             "use an EM-CAS FMU, such as one that `emcas build` makes")


def model_of(name: str) -> str | None:
    """Return the model, such as ``elastic+faults``, that an FMU's modelName contains; None for any other name."""
    match = _NAME.fullmatch(name)
    model = _model(match[3]) if match else None
    try:
        return get(model).name if model else None
    except EmcasError:  # extensions that cannot be combined
        return None


def _model(suffix: str) -> str | None:
    """Return the model whose modelName for one fin is EMCAS with this suffix; None if there is none."""
    for actuator in NAMES:
        known = model_name(actuator).removeprefix("EMCAS")
        added = suffix.removeprefix(known).split("_")[1:]
        ordered = [each for each in (*EXTENSIONS, *FMU_ONLY) if each in added]
        if suffix == "_".join((known, *ordered)):
            return "+".join((actuator, *ordered))
    return None


def chosen_model(file: str, name: str, model: str | None, error: type[EmcasError] = EmcasError) -> str:
    """Return the model of the FMU `file` from its modelName `name`, or `model` if the name contains none.

    Raises `error` if neither is known, or if they differ.
    """
    named = model_of(name)
    if named is None and model is None:
        raise error(f"{file}: its modelName {name} does not contain its model; pass the model with which the FMU was "
                    "built: FILE.py, or a name such as elastic+faults")
    if named is not None and model not in (None, named):
        raise error(f"{file}: its model is {named}, but {model} is requested; leave the model out, or build the FMU "
                    f"with emcas build --model {model}")
    return str(named or model)


@contextmanager
def opened(path: Path, fin: int | None = None, model: str | None = None) -> Iterator[OpenedFmu]:
    """Unpack the FMU at `path` for the duration of the context.

    `fin`, from 1, selects one of several fins, by default the first. `model` is that of an FMU with flat names whose
    modelName does not contain it. Raises EmcasError for a fin that is missing and a file that cannot run here.
    """
    if path.is_dir():
        raise EmcasError(f"{path}: is a folder, not an FMU")
    if not path.is_file():
        raise EmcasError(f"{path}: there is no such file; build one with `emcas build --output {path}`")
    with reading(path, str(path), "an FMU"):
        try:
            description = read_model_description(str(path))
        # fmpy reports an unsound model description as a bare Exception.
        except Exception as error:
            raise EmcasError(f"{path}: is not an FMU that can be read ({' '.join(str(error).split())})") from error
    if not _IDENTIFIER.fullmatch(identifier := str(getattr(description.coSimulation, "modelIdentifier", "_"))):
        raise EmcasError(f"{path}: its modelIdentifier {identifier!r}, the name of its library, is not a C identifier; "
                         "have the FMU built again")
    if description.coSimulation is None or description.fmiVersion not in ("2.0", "3.0"):
        raise EmcasError(f"{path}: is not a co-simulation FMU of FMI 2.0 or 3.0 (FMI {description.fmiVersion})")
    platforms = fmpy.supported_platforms(str(path))
    if fmpy.platform not in platforms:
        raise EmcasError(f"{path}: has no binary for this platform, {fmpy.platform} (it has: "
                         f"{', '.join(p for p in platforms if p != 'c-code') or 'none'}); build the FMU for it")
    listed = elements(description, _structured(description, model))
    names = _names(path, [v.name for v in listed], fin)
    variables = {v.name: v for v in listed if v.causality in ("input", "parameter")}
    starts = {name: _start(variables[full]) for name, full in names.items() if full in variables}
    digest = hashlib.sha256(path.read_bytes()).hexdigest()
    working_directory = Path.cwd()
    with tempfile.TemporaryDirectory(prefix="emcas_fmu_", ignore_cleanup_errors=True) as folder:
        with reading(path, str(path), "an FMU") as archive:
            archive.extractall(folder)
        try:
            yield OpenedFmu(path, Path(folder), description, listed, starts, digest, names)
        finally:
            os.chdir(working_directory)  # if a library does not load, fmpy stays in the FMU's folder


def _structured(description: Any, model: str | None) -> dict[str, str]:
    """Return a map from flat to structured names for an FMU of a known model with flat names; otherwise empty."""
    name = _NAME.fullmatch(description.modelName)
    kind = model_of(description.modelName) or model
    if description.variableNamingConvention != "flat" or name is None or kind is None:
        return {}
    interface = FmuInterface(int(name[2] or 1), kind)
    return {flat(known): known for known in (*interface.reference, *(v.variable.name for v in arrays(interface)))}


def _names(path: Path, present: Sequence[str], fin: int | None) -> dict[str, str]:
    """Return the names of one fin's variables in the FMU, by the names of a single actuator."""
    prefixes = {match[0] for name in present if (match := _FIN.match(name))}
    if not prefixes:
        if fin not in (None, 1):
            raise EmcasError(f"{path}: has one fin; there is no fin {fin}")
        return {name: name for name in present}
    prefix = f"fin[{1 if fin is None else fin}]."
    if prefix not in prefixes:
        raise EmcasError(f"{path}: has {len(prefixes)} fins, there is no fin {fin}")
    shared = {name: name for name in present if not _FIN.match(name)}
    return shared | {name.removeprefix(prefix): name for name in present if name.startswith(prefix)}


def _start(variable: Element) -> Any:
    start, kind = variable.start, variable.kind
    if kind == "Boolean":
        return start in ("true", "1", True)
    return start if kind == "String" else int(start or 0) if kind == "Integer" else float(start or 0)
