"""The article under test: an FMU or a parameter set, behind one way to run it."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter
from typing import Any, Protocol

import fmpy
import numpy as np

from ..actuators import NONLINEAR, get
from ..errors import EmcasError
from ..parameters import ParameterSet, load_parameters
from ..reference.files import parameters_hash
from ..simulation import simulate
from ..validation.runs import Columns, Run, Unit, opened

RECORDED = ("fin_angle", "fin_rate", "motor_current", "motor_voltage", "supply_power", "saturated", "at_stop")


@dataclass(frozen=True)
class Identification:
    """What was tested: nothing in it depends on where or when the test is run."""

    kind: str
    """`FMU` or `parameter set`."""
    file: str
    sha256: str
    """Of the file, or of several one after the other; empty for the shipped parameters."""
    name: str
    guid: str
    """Empty for a parameter set."""
    generation_tool: str
    parameters_sha256: str
    run_by: str
    differences: tuple[str, ...]
    """Parameters that differ from the shipped ones."""
    estimates: tuple[str, ...]
    """Parameters that rest on an engineering estimate."""


class Article(Protocol):
    """Something that can be excited: `values` are its parameters by name, SI."""

    @property
    def identification(self) -> Identification:
        """What it is."""

    @property
    def values(self) -> Mapping[str, Any]:
        """Its parameters by name, SI."""

    def run(self, inputs: Columns, step: float) -> Run:
        """Response to input columns whose rows are `step` [s] apart from 0, each held until the next."""


def row_times(inputs: Columns, step: float) -> Any:
    """Times [s] of the rows of `inputs`; the same floats as those a host counts up."""
    return np.arange(len(next(iter(inputs.values())))) * step


@dataclass(frozen=True)
class ParameterArticle:
    """A parameter set, run by the kernel in this process."""

    parameters: ParameterSet
    files: Sequence[Path] = ()

    @property
    def values(self) -> Mapping[str, Any]:
        """The parameters by name, SI."""
        return self.parameters.values

    @property
    def identification(self) -> Identification:
        """File, hashes, and what the numbers rest on."""
        return Identification(
            "parameter set", ", ".join(file.name for file in self.files) or "the shipped parameters",
            hashlib.sha256(b"".join(file.read_bytes() for file in self.files)).hexdigest() if self.files else "",
            "EMCAS", "", "",
            parameters_hash(self.values), "the kernel of emcas", _differences(self.values),
            tuple(e.variable.name for e in self.parameters.entries if e.source == "estimate"))

    def run(self, inputs: Columns, step: float) -> Run:
        """Response of the kernel."""
        begin = perf_counter()
        times = row_times(inputs, step)
        signals: dict[str, Any] = {name.replace(".", "__"): column for name, column in inputs.items()
                                   if name != "time"}
        try:
            found = simulate(self.values, float(times[-1]), step, **signals)
        except ArithmeticError as error:
            empty = {name: np.array([]) for name in ("time", *RECORDED)}
            return Run(empty, 0.0, (str(error),), perf_counter() - begin)
        return Run({name: found[name] for name in ("time", *RECORDED)}, None, (), perf_counter() - begin)


@dataclass(frozen=True)
class FmuArticle:
    """An FMU, run by fmpy."""

    unit: Unit

    @property
    def values(self) -> Mapping[str, Any]:
        """The start values of its parameters, by the names a parameter file gives them, SI."""
        starts = self.unit.starts
        return {**{v.name: starts[v.name] for v in get(NONLINEAR).parameters},
                **{v.key: starts[v.name] for v in get(NONLINEAR).inputs if v.key}}

    @property
    def identification(self) -> Identification:
        """File, GUID, hashes, and what the numbers rest on."""
        description, values = self.unit.description, self.values
        changed = _differences(values)
        estimates = (e.variable.name for e in load_parameters().entries if e.source == "estimate")
        return Identification(
            "FMU", self.unit.path.name, self.unit.sha256,
            f"{description.modelName} {description.version or ''}".strip(), description.guid,
            description.generationTool or "", parameters_hash(values), f"fmpy {fmpy.__version__}", changed,
            tuple(name for name in estimates if name not in changed))

    def run(self, inputs: Columns, step: float) -> Run:
        """Response of the FMU."""
        return self.unit.run({**inputs, "time": row_times(inputs, step)}, step, {}, RECORDED)


def _differences(values: Mapping[str, Any]) -> tuple[str, ...]:
    return tuple(e.variable.name for e in load_parameters().entries if values[e.variable.name] != e.value)


@contextmanager
def opened_article(path: Path | None, fin: int | None = None, purpose: str = "an acceptance test",
                   parameters: Sequence[Path] | None = None) -> Iterator[ParameterArticle | FmuArticle]:
    """The article at `path`: an FMU, a parameter file (.toml), or the shipped parameters where there is no path.

    The parameter files of `parameters` go over those of the article, which then cannot be an FMU.
    `fin` from 1 on chooses one of a unit of several, the first unless given; `purpose` is what for, in messages.

    Raises EmcasError or ParameterError where it cannot be used.
    """
    if path is None or path.suffix.lower() == ".toml":
        files = [*([path] if path else []), *(parameters or ())]
        yield ParameterArticle(load_parameters(files), files)
        return
    if path.suffix.lower() != ".fmu":
        raise EmcasError(f"{path}: is neither an FMU nor a parameter file by its name; give a file that ends in .fmu "
                         "or .toml")
    if parameters:
        raise EmcasError(f"--parameters {parameters[0]}: {path} has its parameters in it; build an FMU of these")
    with opened(path, fin) as unit:
        unit.require_nonlinear(purpose)
        unit.require([v.name for v in get(NONLINEAR).inputs], "input")
        unit.require(RECORDED, "output")
        unit.require([v.name for v in get(NONLINEAR).parameters], "parameter")
        yield FmuArticle(unit)
