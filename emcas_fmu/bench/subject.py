"""The subject under test: an actuator as a parameter set or as an FMU, behind one way to run it.

A study looks up by name what it needs (``"motor_current" in subject.outputs``) and leaves out, with
the reason, what the subject has not.
"""

from __future__ import annotations

import hashlib
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import groupby
from math import radians
from pathlib import Path
from time import perf_counter
from typing import Any

import fmpy
import numpy as np
from fmpy.fmi1 import FMICallException

from ..actuators import NONLINEAR, full_name, get
from ..actuators.declaration import Actuator
from ..errors import EmcasError
from ..namespace import with_values
from ..ops.arrays import ARRAYS
from ..ops.floats import FLOATS
from ..parameters import ParameterSet, check_combinations, load_parameters, require_sound
from ..reference.files import parameters_hash
from ..reference.stored import Stored
from ..runtime.compiled import parameter_row
from ..simulation import Array, SteppedUnit, respond_all
from ..variables import Variable
from .excitation import LOAD, Excitation
from .fmu import OpenedFmu, chosen_model, opened
from .metrics import Figure
from .provenance import shipped
from .references import carried

Columns = Mapping[str, Array]

COMMAND_RANGE = radians(20.0)  # Table 2's; of an actuator that does not say its own
_LAST_MESSAGES = 20  # kept of a run's log
_STATUS = ("ok", "warning", "discard", "error", "fatal", "pending")


class StoppedError(EmcasError):
    """A run that is needed did not reach its end."""


@dataclass(frozen=True)
class Identification:
    """What was tested: nothing in it depends on where or when the test is run.

    `kind` is `FMU` or `parameter set`; `sha256` is of the file, empty for the defaults; a parameter set has
    no `guid`. `differences` are parameters that differ from the shipped ones, `estimates` those that rest on an
    engineering estimate. `fin`, from 1 on, is of an FMU.
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


@dataclass(frozen=True)
class Run:
    """The response to an excitation: `columns` by name, `time` [s] first, and those that were asked for between rows.

    Of many runs that ended well the columns are arrays [runs, rows], but for ``time``.
    ``stopped`` is the time [s] the subject went no further than, None where it ran to the end;
    ``messages`` what it logged; ``wall_time`` [s].
    """

    excitation: Excitation = field(repr=False)
    columns: Columns = field(repr=False)
    stopped: float | None
    messages: tuple[str, ...]
    wall_time: float

    @property
    def reason(self) -> str:
        """Why the run ended early; empty where it did not."""
        if self.stopped is None:
            return ""
        return f"went no further than {self.stopped:.6g} s: {self.messages[-1] if self.messages else 'no reason given'}"

    def of(self, run: int) -> Run:
        """Return one run of many."""
        return replace(self, excitation=self.excitation.of(run), columns=_of(self.columns, run))

    def finished(self) -> Columns:
        """Return the columns. Raises StoppedError, saying why, where the run ended early."""
        if self.stopped is not None:
            raise StoppedError(f"the subject {self.reason}")
        return self.columns


@dataclass(frozen=True)
class Runs:
    """The responses of many runs to excitations with the same rows.

    `columns` by name are arrays [runs, rows], but ``time`` [rows]; those that are fine have `substeps` to each row. In
    rows that a run did not get to they are NaN. By a run's place: `refused` is what a single run would raise, `stopped`
    the rows it has and what it logged. A run of it is what it is alone, its columns are views.
    """

    excitation: Excitation = field(repr=False)
    columns: Columns = field(repr=False)
    number: int
    substeps: int
    refused: Mapping[int, Exception]
    stopped: Mapping[int, tuple[int, tuple[str, ...]]]
    wall_time: float

    def __len__(self) -> int:
        return self.number

    def __getitem__(self, place: int) -> Run:
        """Return a run. Raises what it was refused with."""
        place = range(self.number)[place]
        if place in self.refused:
            raise self.refused[place]
        time, taken = self.columns["time"], self.wall_time / self.number
        columns = _of(self.columns, place)
        if place not in self.stopped:
            return Run(self.excitation.of(place), columns, None, (), taken)
        rows, messages = self.stopped[place]
        steps = max((rows - 1) * self.substeps + 1, 0)
        columns = {name: column[:rows if len(column) == len(time) else steps] for name, column in columns.items()}
        return Run(self.excitation.of(place), columns, float(np.max(columns["time"], initial=0.0)), messages, taken)

    def finished(self) -> tuple[Any, Run]:
        """Return the places of the runs that ended well, and these as one."""
        if not self.refused and not self.stopped:
            return np.arange(self.number), Run(self.excitation, self.columns, None, (), self.wall_time)
        places = np.setdiff1d(np.arange(self.number), [*self.refused, *self.stopped])
        return places, Run(self.excitation.of(places), _of(self.columns, places), None, (), self.wall_time)


def _of(columns: Columns, runs: Any) -> dict[str, Array]:
    """Return the columns of one run, or of some."""
    return {name: column if name == "time" else column[runs] for name, column in columns.items()}


class Subject(ABC):
    """An actuator that can be excited; `model` is the actuator's name with its extensions, as in ``elastic+heat``."""

    model: str = NONLINEAR

    @property
    @abstractmethod
    def identification(self) -> Identification:
        """What it is."""

    @property
    @abstractmethod
    def values(self) -> Mapping[str, Any]:
        """Its parameters by the names a parameter file gives them, in their variables' units."""

    @abstractmethod
    def run(self, excitation: Excitation, start_values: Mapping[str, Any] | None = None,
            outputs: Iterable[str] | None = None, substeps: int = 1, fine: Sequence[str] = ()) -> Run:
        """Return the response at the times of the rows, and of those outputs that are `fine` between rows as well:
        at `substeps` equal steps of each.

        `start_values` are parameters that differ, over those of the excitation; `outputs` what to record, everything
        unless given. Raises EmcasError for what the subject has not and ParameterError for values it refuses; what
        goes wrong on the way is in the run.
        """

    def run_all(self, excitation: Excitation, changes: Mapping[str, Array], outputs: Iterable[str] | None = None,
                substeps: int = 1, fine: Sequence[str] = ()) -> Runs:
        """Return the responses of many runs, each as `run` gives it: one after the other, where no faster way is known.

        `changes` are parameters that differ, by name an array with a value for each run; columns of the excitation may
        differ, too. A run that is refused or stops leaves the others alone. Raises EmcasError for what the subject has
        not.
        """
        begin = perf_counter()
        count, changes = _spread(excitation, changes)
        names = tuple(self.outputs if outputs is None else outputs)
        rows, steps = len(excitation.time), (len(excitation.time) - 1) * substeps + 1
        columns = {name: np.full((count, steps if name in fine else rows), np.nan) for name in names}
        refused, stopped = dict[int, Exception](), dict[int, tuple[int, tuple[str, ...]]]()
        for place in range(count):
            try:
                run = self.run(excitation.of(place), {name: values[place].item() for name, values in changes.items()},
                               names, substeps, fine)
            except Exception as error:  # whatever it is: the others run  # noqa: BLE001
                refused[place] = error
                continue
            if run.stopped is not None:
                stopped[place] = len(run.columns["time"]), run.messages
            for name in names:
                columns[name][place, :len(run.columns[name])] = run.columns[name]
        time = np.arange(rows) * substeps * (excitation.step / substeps)
        return Runs(excitation, {"time": time, **columns}, count, substeps, refused, stopped, perf_counter() - begin)

    @property
    def actuator(self) -> Actuator:
        """What is modelled."""
        return get(self.model)

    @property
    def warnings(self) -> tuple[str, ...]:
        """What its parameters are allowed to be and is worth a look, one line each."""
        return tuple(check_combinations(self.values, self.actuator, warnings=True))

    @cached_property
    def inputs(self) -> Mapping[str, Variable]:
        """Its inputs by name."""
        return {v.name: v for v in self.actuator.inputs}

    @cached_property
    def outputs(self) -> Mapping[str, Variable]:
        """Its outputs by name."""
        return {v.name: v for v in self.actuator.outputs}

    @property
    def supply(self) -> str | None:
        """The input of its supply, a voltage or a pressure; None where it has none."""
        return None if self.actuator.supply is None else self.actuator.supply.input.name

    @cached_property
    def parameters(self) -> ParameterSet:
        """Its parameters as a set."""
        return load_parameters(model=self.model).with_values(self.values)

    @property
    def references(self) -> Sequence[Stored]:
        """Responses of it that it carries."""
        return ()

    @property
    def command_limit(self) -> float:
        """The largest command it follows [rad]."""
        return float(self.values.get("command.limit", COMMAND_RANGE))

    def lacking(self, outputs: Iterable[str]) -> str:
        """Return which of these outputs it has not, in words; empty where it has them all."""
        return lacking(outputs, self.outputs)

    @cached_property
    def _namespace(self) -> Any:
        return get(self.model).namespace(self.values)

    def transport_delay(self, start_values: Mapping[str, Any]) -> Any:
        """Return the time [s] from a sample of the controllers to the drive, with parameters that differ.

        An array where these are and it depends on them.
        """
        delay, ops = self.actuator.transport_delay, ARRAYS if any(map(np.ndim, start_values.values())) else FLOATS
        return 0.0 if delay is None else delay(ops, with_values(self._namespace, start_values))

    def obstacle(self, excitation: Excitation) -> str:
        """Return why it cannot be excited so, in words; empty where it can."""
        return _without([*(name for name in excitation.columns if name not in self.inputs),
                         *(name for name in excitation.start_values if name not in self.values)])

    def _changes(self, excitation: Excitation, changes: Mapping[str, Any]) -> Mapping[str, Any]:
        """Return the parameters that differ. Raises EmcasError where the subject cannot be excited so."""
        excitation = excitation.with_start_values(changes)
        if obstacle := self.obstacle(excitation):
            raise EmcasError(f"{excitation.title}: {obstacle} ({self.model})")
        return excitation.start_values


def _spread(excitation: Excitation, changes: Mapping[str, Any]) -> tuple[int, dict[str, Array]]:
    """Return how many runs there are, and for each parameter that differs an array with its value in each."""
    of_runs = [len(column) for column in excitation.columns.values() if column.ndim == 2]
    (count,) = np.broadcast_shapes((1,), *of_runs, *map(np.shape, changes.values()))
    return count, {name: np.broadcast_to(values, count) for name, values in changes.items()}


def lacking(outputs: Iterable[str], present: Collection[str]) -> str:
    """Return which of these outputs are not present, in words; empty where all are."""
    return _without([name for name in outputs if name not in present])


def _without(names: Sequence[str]) -> str:
    return f"this actuator has no {', '.join(names)}" if names else ""


def left_out(figures: Mapping[str, Figure], present: Collection[str]) -> dict[str, list[str]]:
    """Return the figures that need an output which is not present, by the reason."""
    names: dict[str, list[str]] = {}
    for name, figure in figures.items():
        if why := lacking(figure.needs, present):
            names.setdefault(why, []).append(name)
    return names


class ParameterSubject(Subject):
    """A parameter set, run by the kernel in this process; `files` are those it is of."""

    def __init__(self, parameters: ParameterSet, files: Sequence[Path] = ()) -> None:
        self.files, self.model = files, parameters.model
        self.__dict__["parameters"] = parameters  # in place of those the base class makes of the values

    @cached_property
    def values(self) -> Mapping[str, Any]:
        return self.parameters.values

    @property
    def warnings(self) -> tuple[str, ...]:
        return self.parameters.warnings

    @cached_property
    def identification(self) -> Identification:
        source = self.actuator.source
        return Identification(
            "parameter set", ", ".join(file.name for file in self.files) or shipped(self.model),
            hashlib.sha256(b"".join(file.read_bytes() for file in self.files)).hexdigest() if self.files else "",
            self.actuator.name if source else "EMCAS", "", "",
            parameters_hash(self.values), "the kernel of emcas", _differences(self.values, self.model),
            self.parameters.estimates, self.actuator.name)

    def run(self, excitation: Excitation, start_values: Mapping[str, Any] | None = None,
            outputs: Iterable[str] | None = None, substeps: int = 1, fine: Sequence[str] = ()) -> Run:
        if excitation.spring:
            return self._sprung(excitation, start_values or {}, outputs, substeps, fine)
        return self.run_all(excitation, start_values or {}, outputs, substeps, fine)[0]

    def run_all(self, excitation: Excitation, changes: Mapping[str, Array], outputs: Iterable[str] | None = None,
                substeps: int = 1, fine: Sequence[str] = ()) -> Runs:
        begin, changed = perf_counter(), self._changes(excitation, changes)
        if np.any(excitation.spring):
            return super().run_all(excitation, changes, outputs, substeps, fine)
        count, changed = _spread(excitation, changed)
        names = tuple(self.outputs if outputs is None else outputs)
        inputs = [excitation.columns[v.name] if v.name in excitation.columns
                  else np.asarray(v.initial({**self.values, **changed}), dtype=float)[..., np.newaxis]
                  for v in self.inputs.values()]
        sets = np.repeat(self._numbers[np.newaxis], count, axis=0)
        for name in changed.keys() & self._places.keys():
            sets[:, self._places[name]] = changed[name]
        step = excitation.step / substeps
        tables = respond_all(sets, inputs, step, names, model=self.model, held=substeps, fine=fine)
        # A run has the rows that it began, each of `substeps` points.
        stopped = {run: (-(-int(tables.reached[run]) // substeps), (str(error),))
                   for run, error in tables.failures.items() if isinstance(error, ArithmeticError)}
        refused = {run: error for run, error in tables.failures.items() if run not in stopped}
        time = np.arange(len(excitation.time)) * substeps * step
        return Runs(excitation, {"time": time, **tables.columns}, count, substeps, refused, stopped,
                    perf_counter() - begin)

    def _sprung(self, excitation: Excitation, changes: Mapping[str, Any], outputs: Iterable[str] | None,
                substeps: int, fine: Sequence[str]) -> Run:
        """Return a response under a spring, whose moment is that of the fin angle at the last row."""
        begin, values = perf_counter(), {**self.values, **self._changes(excitation, changes)}
        table = [np.broadcast_to(excitation.columns.get(v.name, v.initial(values)), excitation.time.shape).tolist()
                 for v in self.inputs.values()]
        rows = [dict(zip(self.inputs, row, strict=True)) for row in zip(*table, strict=True)]
        unit, messages = None, tuple[str, ...]()
        try:
            unit = SteppedUnit(values, excitation.step / substeps, self.model, rows[0])
            angle = unit.place("fin_angle")
            for row in rows[:-1]:
                unit.run(**{**row, LOAD: row[LOAD] - excitation.spring * unit.now[angle]})
                for _ in range(substeps - 1):
                    unit.run()
        except ArithmeticError as error:
            messages = (str(error),)
        given = unit.columns() if unit else dict.fromkeys(("time", *self.outputs), np.empty(0))
        count = -(-len(given["time"]) // substeps)
        columns = {name: given[name][:max((count - 1) * substeps + 1, 0):1 if name in fine else substeps]
                   for name in ("time", *(self.outputs if outputs is None else outputs))}
        stopped = float(np.max(columns["time"], initial=0.0)) if messages else None
        return Run(excitation, columns, stopped, messages, perf_counter() - begin)

    @cached_property
    def _places(self) -> Mapping[str, int]:
        return {v.name: i for i, v in enumerate(self.actuator.parameters)}

    @cached_property
    def _numbers(self) -> Array:
        return parameter_row(self.values, self.model)


class _Recorder:
    """Values of variables of an FMU, a row for each time they are read."""

    def __init__(self, fmu: Any, variables: Sequence[Variable], references: Mapping[str, int]) -> None:
        self.rows: list[list[Any]] = []
        self._variables, self._getters = sorted(variables, key=lambda v: v.kind), []
        for kind, group in groupby(self._variables, key=lambda v: v.kind):
            get_values = getattr(fmu, f"get{'Integer' if kind == 'Enumeration' else kind}")
            self._getters.append((get_values, [references[v.name] for v in group]))

    def sample(self) -> None:
        """Read the variables."""
        self.rows.append([value for get_values, references in self._getters for value in get_values(references)])

    def columns(self, count: int) -> dict[str, Array]:
        """Return the first `count` values of each variable."""
        table = np.array(self.rows, dtype=float).reshape(len(self.rows), len(self._variables))[:count]
        return {v.name: table[:, i] for i, v in enumerate(self._variables)}


class FmuSubject(Subject):
    """An FMU, run by fmpy: one instance, reset between runs and made anew after one that failed."""

    def __init__(self, unit: OpenedFmu, model: str, fin: int = 1) -> None:
        self.unit, self.model, self.fin = unit, model, fin
        for variables, causality in ((self.inputs.values(), "input"), (self.outputs.values(), "output")):
            unit.require([v.name for v in variables], causality)
        self._messages: deque[str] = deque(maxlen=_LAST_MESSAGES)
        self._instance: Any = None

    @cached_property
    def values(self) -> Mapping[str, Any]:
        self.unit.require([v.name for v in get(self.model).parameters], "parameter")
        starts = self.unit.starts
        return {**{v.name: starts[v.name] for v in get(self.model).parameters},
                **{v.key: starts[v.name] for v in self.inputs.values() if v.key}}

    @cached_property
    def identification(self) -> Identification:
        description, changed = self.unit.description, _differences(self.values, self.model)
        estimates = load_parameters(model=self.model).estimates
        return Identification(
            "FMU", self.unit.path.name, self.unit.sha256,
            f"{description.modelName} {description.version or ''}".strip(), description.guid,
            description.generationTool or "", parameters_hash(self.values), f"fmpy {fmpy.__version__}", changed,
            tuple(name for name in estimates if name not in changed), self.actuator.name, self.fin)

    @cached_property
    def references(self) -> Sequence[Stored]:
        return carried(self.unit.folder, self.unit.path, self.unit.names_in_files, self.actuator.name)

    def run(self, excitation: Excitation, start_values: Mapping[str, Any] | None = None,
            outputs: Iterable[str] | None = None, substeps: int = 1, fine: Sequence[str] = ()) -> Run:
        begin, changes = perf_counter(), self._changes(excitation, start_values or {})
        names = list(self.outputs if outputs is None else outputs)
        if changes:  # an FMU refuses, too, in words of its own or by not stepping
            _check({**self.values, **changes}, self.model)
        self._messages.clear()
        if self._instance is None:
            self._instance = self.unit.instance(self._log)
        else:
            self._instance.reset()
        at_rows, at_steps = (_Recorder(self._instance, [self.outputs[name] for name in group], self.unit.references)
                             for group in (names, fine))
        complete = True
        try:
            self._follow(self._instance, excitation, changes, substeps, at_rows, at_steps)
        except FMICallException as error:
            if not self._messages:  # what the FMU says tells more
                self._messages.append(str(error))
            self.close()
            complete = False
        count = len(at_rows.rows)
        recorded = at_rows.columns(count) | at_steps.columns((count - 1) * substeps + 1)
        columns = {"time": np.arange(count) * substeps * (excitation.step / substeps),
                   **{name: recorded[name] for name in names}}
        stopped = None if complete else float(np.max(columns["time"], initial=0.0))
        return Run(excitation, columns, stopped, tuple(self._messages), perf_counter() - begin)

    def _follow(self, fmu: Any, excitation: Excitation, changes: Mapping[str, Any], substeps: int, at_rows: _Recorder,
                at_steps: _Recorder) -> None:
        """Step through an excitation, recording at its rows and at every one of their `substeps`.

        Raises FMICallException where the FMU goes no further.
        """
        references, step = self.unit.references, excitation.step / substeps
        started = {v.name: changes[v.key] for v in self.inputs.values() if v.key and v.key in changes}
        self.unit.set_starts(fmu, {
            name: value for name, value in {**changes, **started}.items()
            if name in references})  # the start of an input goes by another name in a parameter file
        setters = {"Real": (fmu.setReal, float), "Boolean": (fmu.setBoolean, bool), "Integer": (fmu.setInteger, int)}
        columns = [(setters[self.inputs[name].kind][0], references[name],
                    column.astype(setters[self.inputs[name].kind][1]).tolist())
                   for name, column in excitation.columns.items()]
        moment = excitation.columns.get(LOAD, np.zeros(len(excitation.time)))
        fmu.setupExperiment(startTime=0.0)

        def apply(k: int) -> None:
            for set_values, reference, column in columns:
                if k == 0 or column[k] != column[k - 1]:
                    set_values([reference], [column[k]])

        apply(0)
        fmu.enterInitializationMode()
        fmu.exitInitializationMode()
        at_rows.sample()
        at_steps.sample()
        for k in range(len(excitation.time) - 1):
            if k:
                apply(k)
            if excitation.spring:
                (angle,) = fmu.getReal([references["fin_angle"]])
                fmu.setReal([references[LOAD]], [float(moment[k]) - excitation.spring * angle])
            for now in range(k * substeps, (k + 1) * substeps):
                fmu.doStep(now * step, (now + 1) * step - now * step)
                at_steps.sample()
            at_rows.sample()
        fmu.terminate()

    def _log(self, _component: Any, _instance: bytes, status: int, _category: bytes, message: bytes) -> None:
        label = _STATUS[status] if 0 <= status < len(_STATUS) else str(status)
        if label != "ok":
            self._messages.append(f"{label}: {message.decode(errors='replace').strip()}")

    def close(self) -> None:
        """Let go of the instance."""
        instance, self._instance = self._instance, None
        if instance is not None:
            instance.freeInstance()


def _check(values: Mapping[str, Any], model: str) -> None:
    require_sound({v.name: values[v.name] for v in get(model).parameters}, model)


def _differences(values: Mapping[str, Any], model: str) -> tuple[str, ...]:
    return tuple(e.variable.name for e in load_parameters(model=model).entries if values[e.variable.name] != e.value)


@contextmanager
def open_subject(path: Path | None, model: str | None = None, fin: int | None = None,
                 parameters: Sequence[Path] | None = None) -> Iterator[Subject]:
    """Open the subject at `path`: an FMU, a parameter file (.toml), or the shipped parameters where there is no path.

    `model` names the actuator and its extensions; an FMU tells its own. `fin` from 1 on chooses one of a unit of
    several, the first unless given. The files of `parameters` go over those of the subject, which then cannot be an
    FMU. Raises EmcasError or ParameterError where it cannot be used.
    """
    if path is None or path.suffix.lower() == ".toml":
        if fin is not None:
            raise EmcasError(f"--fin {fin}: {path or 'a parameter set'} is one fin; leave --fin out")
        files = [*([path] if path else []), *(parameters or ())]
        yield ParameterSubject(load_parameters(files, model=model or NONLINEAR), files)
        return
    if path.suffix.lower() != ".fmu":
        raise EmcasError(f"{path}: is neither an FMU nor a parameter file by its name; give a file that ends in .fmu "
                         "or .toml")
    if parameters:
        raise EmcasError(f"--parameters {parameters[0]}: {path} has its parameters in it; build an FMU of these")
    model = model and full_name(model)
    with opened(path, fin, model) as unit:
        subject = FmuSubject(unit, chosen_model(str(path), unit.description.modelName, model), fin or 1)
        try:
            yield subject
        finally:
            subject.close()
