"""An FMU as the subject of a study, and `open_subject` for FMUs and parameter sets."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import cached_property
from itertools import groupby
from pathlib import Path
from time import perf_counter
from typing import Any

import fmpy
import numpy as np
from fmpy.fmi1 import FMICallException

from ..actuators import NONLINEAR, full_name, get
from ..errors import EmcasError
from ..pages.credibility import CARD_FILE, MANAGEMENT, Card, Fact, card, read
from ..parameters import load_parameters, require_sound
from ..reference.files import parameters_hash
from ..reference.stored import Stored
from ..simulation import Array
from ..variables import Variable
from .excitation import LOAD, Excitation
from .fmu import OpenedFmu, chosen_model, opened
from .references import embedded
from .runs import Run
from .subject import Identity, ParameterSubject, Subject, differences

_LAST_MESSAGES = 20  # number of messages kept from a run's log
_STATUS = ("ok", "warning", "discard", "error", "fatal", "pending")


class _Recorder:
    """Recorded values of an FMU's variables, one row for each reading."""

    def __init__(self, instance: Any, variables: Sequence[Variable], references: Mapping[str, int]) -> None:
        self.rows: list[list[Any]] = []
        self._variables, self._getters = sorted(variables, key=lambda v: v.kind), []
        for kind, group in groupby(self._variables, key=lambda v: v.kind):
            get_values = getattr(instance, f"get{'Integer' if kind == 'Enumeration' else kind}")
            self._getters.append((get_values, [references[v.name] for v in group]))

    def sample(self) -> None:
        """Read the variables."""
        self.rows.append([value for get_values, references in self._getters for value in get_values(references)])

    def columns(self, count: int) -> dict[str, Array]:
        """Return the first `count` values of each variable."""
        table = np.array(self.rows, dtype=float).reshape(len(self.rows), len(self._variables))[:count]
        return {v.name: table[:, i] for i, v in enumerate(self._variables)}


class FmuSubject(Subject):
    """An FMU that fmpy runs in one instance, which is reset between runs and replaced after a failed run."""

    def __init__(self, fmu: OpenedFmu, model: str, fin: int = 1) -> None:
        self.fmu, self.model, self.fin = fmu, model, fin
        for variables, causality in ((self.inputs.values(), "input"), (self.outputs.values(), "output")):
            fmu.require([v.name for v in variables], causality)
        self._messages: deque[str] = deque(maxlen=_LAST_MESSAGES)
        self._instance: Any = None

    @cached_property
    def values(self) -> Mapping[str, Any]:
        self.fmu.require([v.name for v in get(self.model).parameters], "parameter")
        starts = self.fmu.starts
        return {**{v.name: starts[v.name] for v in get(self.model).parameters},
                **{v.key: starts[v.name] for v in self.inputs.values() if v.key}}

    @cached_property
    def identification(self) -> Identity:
        description, changed = self.fmu.description, differences(self.values, self.model)
        estimates = load_parameters(model=self.model).estimates
        return Identity(
            "FMU", self.fmu.path.name, self.fmu.sha256,
            f"{description.modelName} {description.version or ''}".strip(), description.guid,
            description.generationTool or "", parameters_hash(self.values), f"fmpy {fmpy.__version__}", changed,
            tuple(name for name in estimates if name not in changed), self.actuator.name, self.fin)

    @cached_property
    def card(self) -> Card:
        """The FMU's card, or a new one if the FMU, being older or changed, contains none for its values."""
        path, origin = self.fmu.folder / CARD_FILE, "this card is the one in the FMU, with figures of these tests"
        try:
            inside = read(path.read_bytes()) if path.is_file() else None
        except ValueError as error:
            raise EmcasError(f"{self.fmu.path}: {CARD_FILE} {error}; build the FMU again") from error
        if inside is None or inside.values_sha256[self.fin - 1:self.fin] != (parameters_hash(self.values),):
            inside, origin = card([self.parameters], self.fmu.path.name), "the FMU has no card for its values"
        file = Fact("file", self.fmu.path.name, note=f"SHA-256 {self.fmu.sha256}; {origin}")
        return inside.having(MANAGEMENT, file)

    @cached_property
    def references(self) -> Sequence[Stored]:
        return embedded(self.fmu.folder, self.fmu.path, self.fmu.names_in_files, self.actuator.name)

    def run(self, excitation: Excitation, start_values: Mapping[str, Any] | None = None,
            outputs: Iterable[str] | None = None, substeps: int = 1, fine: Sequence[str] = ()) -> Run:
        begin, changes = perf_counter(), self.changed(excitation, start_values or {})
        names = list(self.outputs if outputs is None else outputs)
        if changes:  # the FMU refuses unsound values with a less useful message, or by not stepping
            require_sound({v.name: {**self.values, **changes}[v.name] for v in self.actuator.parameters}, self.model)
        self._messages.clear()
        if self._instance is None:
            self._instance = self.fmu.instance(self._log)
        else:
            self._instance.reset()
        at_rows, at_steps = (_Recorder(self._instance, [self.outputs[name] for name in group], self.fmu.references)
                             for group in (names, fine))
        complete = True
        try:
            self._follow(self._instance, excitation, changes, substeps, at_rows, at_steps)
        except FMICallException as error:
            if not self._messages:  # the messages of the FMU are more informative
                self._messages.append(str(error))
            self.close()
            complete = False
        count = len(at_rows.rows)
        recorded = at_rows.columns(count) | at_steps.columns((count - 1) * substeps + 1)
        columns = {"time": np.arange(count) * substeps * (excitation.step / substeps),
                   **{name: recorded[name] for name in names}}
        stopped = None if complete else float(np.max(columns["time"], initial=0.0))
        return Run(excitation, columns, stopped, tuple(self._messages), perf_counter() - begin)

    def _follow(self, instance: Any, excitation: Excitation, changes: Mapping[str, Any], substeps: int,
                at_rows: _Recorder, at_steps: _Recorder) -> None:
        """Step through an excitation, and record at its rows and at each of their `substeps`.

        Raises FMICallException if a call of the FMU fails.
        """
        references, step = self.fmu.references, excitation.step / substeps
        started = {v.name: changes[v.key] for v in self.inputs.values() if v.key and v.key in changes}
        self.fmu.set_starts(instance, {
            name: value for name, value in {**changes, **started}.items()
            if name in references})  # in a parameter file the start value of an input has another name
        setters = {"Real": (instance.setReal, float), "Boolean": (instance.setBoolean, bool),
                   "Integer": (instance.setInteger, int)}
        columns = [(setters[self.inputs[name].kind][0], references[name],
                    column.astype(setters[self.inputs[name].kind][1]).tolist())
                   for name, column in excitation.columns.items()]
        moment = excitation.columns.get(LOAD, np.zeros(len(excitation.time)))
        instance.setupExperiment()

        def apply(k: int) -> None:
            for set_values, reference, column in columns:
                if k == 0 or column[k] != column[k - 1]:
                    set_values([reference], [column[k]])

        apply(0)
        instance.enterInitializationMode()
        instance.exitInitializationMode()
        at_rows.sample()
        at_steps.sample()
        for k in range(len(excitation.time) - 1):
            if k:
                apply(k)
            if excitation.spring:
                (angle,) = instance.getReal([references["fin_angle"]])
                instance.setReal([references[LOAD]], [float(moment[k]) - excitation.spring * angle])
            for now in range(k * substeps, (k + 1) * substeps):
                instance.doStep(now * step, (now + 1) * step - now * step)
                at_steps.sample()
            at_rows.sample()
        instance.terminate()

    def _log(self, _component: Any, _instance: bytes, status: int, _category: bytes, message: bytes) -> None:
        label = _STATUS[status] if 0 <= status < len(_STATUS) else str(status)
        if label != "ok":
            self._messages.append(f"{label}: {message.decode(errors='replace').strip()}")

    def close(self) -> None:
        """Free the instance."""
        instance, self._instance = self._instance, None
        if instance is not None:
            instance.freeInstance()


@contextmanager
def open_subject(path: Path | None, model: str | None = None, fin: int | None = None,
                 parameters: Sequence[Path] | None = None) -> Iterator[Subject]:
    """Open the subject at `path`, an FMU or a parameter file (.toml); without a path, open the shipped parameters.

    `model` names the actuator and its extensions; the modelName of most FMUs contains it. `fin`, from 1, selects one
    fin of an FMU with several, by default the first. The parameter files `parameters` override values of a parameter
    set; an FMU does not accept them. Raises EmcasError or ParameterError if the subject cannot be used.
    """
    if path is None or path.suffix.lower() == ".toml":
        if fin is not None:
            raise EmcasError(f"--fin {fin}: {path or 'a parameter set'} has one fin; leave --fin out")
        files = [*([path] if path else []), *(parameters or ())]
        yield ParameterSubject(load_parameters(files, model=model or NONLINEAR), files)
        return
    if path.suffix.lower() != ".fmu":
        raise EmcasError(f"{path}: is neither an FMU nor a parameter file by its name; choose a file that ends in "
                         ".fmu or .toml")
    if parameters:
        raise EmcasError(f"--parameters {parameters[0]}: {path} contains its parameters; build an FMU with these")
    model = model and full_name(model)
    with opened(path, fin, model) as fmu:
        subject = FmuSubject(fmu, chosen_model(str(path), fmu.description.modelName, model), fin or 1)
        try:
            yield subject
        finally:
            subject.close()
