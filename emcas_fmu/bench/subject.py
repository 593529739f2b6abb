"""The subject of a study: an actuator as a parameter set or as an FMU, with the same interface.

A study looks up the outputs that it needs by name (``"motor_current" in subject.outputs``). It leaves out the figures
whose outputs the subject lacks, with the reason.
"""

from __future__ import annotations

import hashlib
from abc import ABC, abstractmethod
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import radians
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

from ..actuators import NONLINEAR, get
from ..actuators.declaration import Actuator
from ..errors import EmcasError
from ..namespace import with_values
from ..ops.arrays import ARRAYS
from ..ops.floats import FLOATS
from ..pages.credibility import Card, card
from ..pages.provenance import Source, shipped
from ..parameters import ParameterSet, check_combinations, load_parameters
from ..reference.files import parameters_hash
from ..reference.stored import Stored
from ..runtime.compiled import parameter_row
from ..simulation import Array, respond_all
from ..variables import Variable
from .excitation import Excitation
from .metrics import Figure
from .runs import Run, Runs, spread

COMMAND_RANGE = radians(20.0)  # rad, largest command in Table 2; for an actuator without command.limit
ANGLE_KNOWN = {"homing.required": False}
"""Parameters with which an actuator with homing follows commands from the start, without the input `home`."""


@dataclass(frozen=True)
class Identity:
    """The identity of a subject.

    `kind` is `FMU` or `parameter set`. `sha256` is the hash of the file or files, empty for the defaults,
    `parameters_sha256` that of the values; a parameter set has no `guid`. `run_by` is the simulator. `differences` are
    the names of the parameters that differ from the shipped ones, `estimates` the names of those that are engineering
    estimates. `fin`, from 1, is set for an FMU.
    """

    kind: str
    file: str
    sha256: str
    name: str
    guid: str
    generation_tool: str
    parameters_sha256: str
    run_by: str
    differences: tuple[str, ...]
    estimates: tuple[str, ...]
    model: str = NONLINEAR
    fin: int | None = None

    @property
    def source(self) -> Source:
        """The source of a page about the subject."""
        return Source("FMU" if self.kind == "FMU" else "parameters", self.file, self.sha256, self.parameters_sha256,
                      self.model + (f", fin {self.fin}" if self.fin else ""))


class Subject(ABC):
    """An actuator that can be simulated; `model` is its name with its extensions, such as ``elastic+heat``."""

    model: str = NONLINEAR

    @property
    @abstractmethod
    def identification(self) -> Identity:
        """The name, file and hashes of the subject."""

    @property
    @abstractmethod
    def values(self) -> Mapping[str, Any]:
        """The values of the parameters by their names in a parameter file, in their variables' units."""

    @abstractmethod
    def run(self, excitation: Excitation, start_values: Mapping[str, Any] | None = None,
            outputs: Iterable[str] | None = None, substeps: int = 1, fine: Sequence[str] = ()) -> Run:
        """Return the response at the times of the rows; that of `fine` outputs at `substeps` equal steps per row.

        `start_values` are changed parameters, in addition to those of the excitation. `outputs` are the names of the
        recorded outputs, `fine` included, by default all. Raises EmcasError for inputs and parameters that the subject
        lacks, and ParameterError for values that it refuses. A failure during the simulation is in the Run.
        """

    def run_all(self, excitation: Excitation, changes: Mapping[str, Array], outputs: Iterable[str] | None = None,
                substeps: int = 1, fine: Sequence[str] = ()) -> Runs:
        """Return the responses of many runs, each as by `run`; this base class simulates them one after another.

        `changes` maps the name of a changed parameter to an array with a value for each run; columns of the excitation
        may also differ between runs. A run that is refused or stops does not affect the others. Raises EmcasError for
        inputs and parameters that the subject lacks.
        """
        begin = perf_counter()
        count, changes = spread(excitation, changes)
        names = tuple(self.outputs if outputs is None else outputs)
        rows, steps = len(excitation.time), (len(excitation.time) - 1) * substeps + 1
        columns = {name: np.full((count, steps if name in fine else rows), np.nan) for name in names}
        refused, stopped = dict[int, Exception](), dict[int, tuple[int, tuple[str, ...]]]()
        for index in range(count):
            try:
                run = self.run(excitation.of(index), {name: values[index].item() for name, values in changes.items()},
                               names, substeps, fine)
            except Exception as error:  # the other runs continue after any error  # noqa: BLE001
                refused[index] = error
                continue
            if run.stopped is not None:
                stopped[index] = len(run.columns["time"]), run.messages
            for name in names:
                columns[name][index, :len(run.columns[name])] = run.columns[name]
        time = np.arange(rows) * substeps * (excitation.step / substeps)
        return Runs(excitation, {"time": time, **columns}, count, substeps, refused, stopped, perf_counter() - begin)

    @property
    def actuator(self) -> Actuator:
        """The declared model."""
        return get(self.model)

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings about parameters that are allowed but doubtful, one line each."""
        return tuple(check_combinations(self.values, self.actuator, warnings=True))

    @cached_property
    def inputs(self) -> Mapping[str, Variable]:
        """The inputs by name."""
        return {v.name: v for v in self.actuator.inputs}

    @cached_property
    def outputs(self) -> Mapping[str, Variable]:
        """The outputs by name."""
        return {v.name: v for v in self.actuator.outputs}

    @property
    def supply(self) -> str | None:
        """The name of the supply input, a voltage or a pressure; None without one."""
        return None if self.actuator.supply is None else self.actuator.supply.input.name

    @cached_property
    def parameters(self) -> ParameterSet:
        """The parameters as a set; those with default values have their sources."""
        changed = differences(self.values, self.model)
        return load_parameters(model=self.model).with_values({name: self.values[name] for name in changed})

    @cached_property
    def card(self) -> Card:
        """The credibility card."""
        return card([self.parameters])

    @property
    def references(self) -> Sequence[Stored]:
        """The reference responses embedded in the subject."""
        return ()

    @property
    def command_limit(self) -> float:
        """The largest command that the fin follows [rad]."""
        return float(self.values.get("command.limit", COMMAND_RANGE))

    @property
    def at_start(self) -> Mapping[str, Any]:
        """The entries of `ANGLE_KNOWN` that are parameters of the actuator."""
        names = {v.name for v in self.actuator.parameters}
        return {name: value for name, value in ANGLE_KNOWN.items() if name in names}

    def lacking(self, outputs: Iterable[str]) -> str:
        """Return a statement that names the outputs that the subject lacks; empty if it has all."""
        return _without([name for name in outputs if name not in self.outputs])

    def transport_delay(self, start_values: Mapping[str, Any]) -> Any:
        """Return the delay [s] from a sample of the controllers to the drive.

        `start_values` are changed parameters; the delay is an array if it depends on arrays among them.
        """
        delay, ops = self.actuator.transport_delay, ARRAYS if any(map(np.ndim, start_values.values())) else FLOATS
        return 0.0 if delay is None else delay(ops, with_values(self.actuator.namespace(self.values), start_values))

    def obstacle(self, excitation: Excitation) -> str:
        """Return the reason why the subject cannot be excited in this way; empty if it can."""
        return _without([*(name for name in excitation.columns if name not in self.inputs),
                         *(name for name in excitation.start_values if name not in self.values)])

    def changed(self, excitation: Excitation, changes: Mapping[str, Any]) -> Mapping[str, Any]:
        """Return all changed parameters of a run: those of `at_start`, the excitation and `changes`, in this order.

        The last value of a parameter is used. `at_start` is left out if the excitation has the input `home`. Raises
        EmcasError if the subject cannot be excited in this way.
        """
        known = {} if "home" in excitation.columns else self.at_start
        excitation = excitation.with_start_values({**known, **excitation.start_values, **changes})
        if obstacle := self.obstacle(excitation):
            raise EmcasError(f"{excitation.title}: {obstacle} ({self.model})")
        return excitation.start_values


def _without(names: Sequence[str]) -> str:
    return f"this actuator has no {', '.join(names)}" if names else ""


def left_out(figures: Mapping[str, Figure], present: Collection[str]) -> dict[str, list[str]]:
    """Return the names of the figures that need a missing output, by the reason; `present` are the outputs."""
    names: dict[str, list[str]] = {}
    for name, figure in figures.items():
        if missing := [output for output in figure.needs if output not in present]:
            names.setdefault(_without(missing), []).append(name)
    return names


class ParameterSubject(Subject):
    """A parameter set that the kernel simulates in this process; `files` are its parameter files."""

    def __init__(self, parameters: ParameterSet, files: Sequence[Path] = ()) -> None:
        self.files, self.model = files, parameters.model
        self.__dict__["parameters"] = parameters  # instead of the cached property of the base class

    @cached_property
    def values(self) -> Mapping[str, Any]:
        return self.parameters.values

    @property
    def warnings(self) -> tuple[str, ...]:
        return self.parameters.warnings

    @cached_property
    def identification(self) -> Identity:
        source = self.actuator.source
        return Identity(
            "parameter set", ", ".join(file.name for file in self.files) or shipped(self.model),
            hashlib.sha256(b"".join(file.read_bytes() for file in self.files)).hexdigest() if self.files else "",
            self.actuator.name if source else "EMCAS", "", "",
            parameters_hash(self.values), "the kernel of emcas", differences(self.values, self.model),
            self.parameters.estimates, self.actuator.name)

    def run(self, excitation: Excitation, start_values: Mapping[str, Any] | None = None,
            outputs: Iterable[str] | None = None, substeps: int = 1, fine: Sequence[str] = ()) -> Run:
        return self.run_all(excitation, start_values or {}, outputs, substeps, fine)[0]

    def run_all(self, excitation: Excitation, changes: Mapping[str, Array], outputs: Iterable[str] | None = None,
                substeps: int = 1, fine: Sequence[str] = ()) -> Runs:
        begin, changed = perf_counter(), self.changed(excitation, changes)
        count, changed = spread(excitation, changed)
        names = tuple(self.outputs if outputs is None else outputs)
        inputs = [excitation.columns[v.name] if v.name in excitation.columns
                  else np.asarray(v.initial({**self.values, **changed}), dtype=float)[..., np.newaxis]
                  for v in self.inputs.values()]
        sets = np.repeat(self._numbers[np.newaxis], count, axis=0)
        for name in changed.keys() & self._indices.keys():
            sets[:, self._indices[name]] = changed[name]
        step = excitation.step / substeps
        tables = respond_all(sets, inputs, step, names, model=self.model, held=substeps, fine=fine,
                             spring=excitation.spring)
        # A stopped run has the rows that it began, each of `substeps` points.
        stopped = {run: (-(-int(tables.reached[run]) // substeps), (str(error),))
                   for run, error in tables.failures.items() if isinstance(error, ArithmeticError)}
        refused = {run: error for run, error in tables.failures.items() if run not in stopped}
        time = np.arange(len(excitation.time)) * substeps * step
        return Runs(excitation, {"time": time, **tables.columns}, count, substeps, refused, stopped,
                    perf_counter() - begin)

    @cached_property
    def _indices(self) -> Mapping[str, int]:
        return {v.name: i for i, v in enumerate(self.actuator.parameters)}

    @cached_property
    def _numbers(self) -> Array:
        return parameter_row(self.values, self.model)


def differences(values: Mapping[str, Any], model: str) -> tuple[str, ...]:
    """Return the names of the parameters that differ from the shipped ones."""
    return tuple(e.variable.name for e in load_parameters(model=model).entries if values[e.variable.name] != e.value)
