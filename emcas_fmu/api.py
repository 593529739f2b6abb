"""What ``import emcas_fmu`` offers: load, change, simulate, build, validate, analyse and tune fin actuators.

These names, their parameters and the attributes that their documentation names are the stable interface: a change that
breaks a program comes with a new minor version and a line in the changelog. Everything else of the package may change.
The commands simulate, build, validate, analyse and tune of `emcas` are made of these functions. Values are in SI units
(temperature in degC); text carries its unit, as in ``"10 deg"``.
"""

from __future__ import annotations

import os
import warnings
from collections.abc import Iterable, Mapping, Sequence
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from . import actuators
from .bench import excitation as excitations
from .bench.excitation import COMMAND, STEP, Excitation, check_span
from .bench.fmu_subject import open_subject
from .bench.requirements import load_requirements
from .bench.subject import ParameterSubject, Subject
from .errors import EmcasError, EmcasWarning, hint
from .fmi.interface import FmuInterface, fin_sets, require_shared
from .fmi.package import Built, build
from .parameters import ParameterError, ParameterSet, load_parameters
from .response import Response
from .runtime import batch, compiled
from .simulation import Array, Signal, simulate_fins, spread
from .simulation import simulate as simulate_one
from .studies.validate.validation import Result as Validation
from .studies.validate.validation import validate as _validate
from .support import extras
from .support.arguments import brief, checked
from .support.progress import Progress, silent
from .units import quantity
from .variables import Variable

if TYPE_CHECKING:
    from .studies.analysis.analyse import Analysis
    from .studies.tuning.optimise import Result as Tuning
    from .studies.tuning.study import Study

__all__ = ["Batch", "Built", "EmcasError", "Excitation", "ParameterError", "ParameterSet", "Response", "Validation",
           "actuators", "analyse", "build", "excitations", "fin_sets", "load_parameters", "simulate", "tune",
           "validate"]

_DURATION = 0.5  # s
_MOST = 100_000_000  # actuators, whose outputs alone are 20 GB; generations; processes


@checked
def simulate(parameters: ParameterSet | Sequence[ParameterSet] | None = None, excitation: Excitation | None = None, *,
             stop: float | str | None = None, step: float | str | None = None, kernel: str = "auto",
             line: Mapping[str, float] | None = None, **inputs: Signal | str) -> Response:
    """Simulate an actuator, or several on one supply, without an FMU.

    `parameters` are the default set unless given; several (see `fin_sets`) share the supply, whose `line` may have
    parameters such as ``bus.source_resistance``. What drives it is an `excitation`
    (``excitations.step_to(0.1, 0.4)``), or inputs alone, from 0 to `stop` (0.5 s) at communication steps of `step`
    (1 ms), held over each. Inputs are given by name with ``__`` for the dot (``attitude__roll``): as a constant, as
    text with a unit (``"10 deg"``), as a function of time [s], or as an array of a value for each communication point.
    Those that are not given stay at their start; beside an excitation they are added to its columns. `kernel` is
    ``compiled``, ``python``, or ``auto``: compiled if there is a C compiler, which it waits for the first time; the
    numbers are the same.

    Warns (EmcasWarning) of a command beyond its limit, which is clipped, and of one that looks like degrees. Raises
    EmcasError for what cannot be simulated; a ParameterSet is sound already.
    """
    sets = _sets("simulate", parameters)
    unit = FmuInterface(len(sets), sets[0].model)
    if line and unit.fins == 1:
        raise EmcasError("simulate: line is that of several fins on one supply; give their sets, as of fin_sets")
    if excitation is None:
        excitation = _at_rest(_in("s", stop, _DURATION), _in("s", step, STEP), inputs)
    elif stop is not None or step is not None:
        raise EmcasError(f"simulate: stop and step are those of the excitation, {excitation.title}")
    excitation = _with_inputs(excitation, inputs, unit)
    sets = tuple(each.with_values(each.having(excitation.start_values)) for each in sets)
    require_shared(sets, "simulate")
    try:
        columns = (simulate_fins([each.values for each in sets], excitation.stop, excitation.step, unit.kind, line,
                                 **excitation.columns) if unit.fins > 1 else
                   simulate_one(sets[0].values, excitation.stop, excitation.step, kernel, unit.kind,
                                **excitation.columns))
    except EmcasError:
        raise
    except (ArithmeticError, TypeError, ValueError) as error:
        raise EmcasError(f"the response cannot be computed: {error}") from error
    response = Response(unit, sets, excitation, columns)
    for message in response.warnings:
        warnings.warn(message, EmcasWarning, stacklevel=3)  # of the line that calls this, beyond `checked`
    return response


def _sets(what: str, given: Any) -> tuple[ParameterSet, ...]:
    """Return parameter sets of one actuator, the default one unless given. Raises EmcasError."""
    several = isinstance(given, Iterable)
    sets = tuple(load_parameters() if each is None else each for each in (given if several else (given,)))
    if not sets or len({each.model for each in sets}) > 1:
        raise EmcasError(f"{what}: give one parameter set, or several of one actuator")
    return sets


def _in(unit: str, given: float | str | None, otherwise: float) -> float:
    """Return a value in a unit, from a number in it or from text. Raises EmcasError."""
    if given is None:
        return otherwise
    try:
        return quantity(given, "", unit) if isinstance(given, str) else float(given)
    except ValueError as error:
        raise EmcasError(f"{given!r} {error}") from error


def _at_rest(stop: float, step: float, inputs: Mapping[str, Signal | str]) -> Excitation:
    """Return rows of a command of zero, named after what is given besides."""
    if not (0.0 < step < float("inf") and 0.0 < stop < float("inf")):
        raise EmcasError(f"simulate: stop = {stop:g} s and step = {step:g} s must be above 0")
    check_span("simulate", step, stop)
    title = ", ".join(f"{name} {signal}" if isinstance(signal, (str, float, int)) else name
                      for name, signal in inputs.items())
    return Excitation(title or "at rest", {COMMAND: np.zeros(round(stop / step) + 1)}, step=step)


def _with_inputs(excitation: Excitation, inputs: Mapping[str, Signal | str], unit: FmuInterface) -> Excitation:
    """Return an excitation with further inputs, by the names of a unit; what is of one fin goes over every fin's."""
    there_are = {v.name: v for v in (*unit.actuator.inputs, *unit.inputs)}
    columns = dict(excitation.columns)
    for given, signal in inputs.items():
        variable = _input(given, there_are)
        values = [signal(t) for t in excitation.time.tolist()] if callable(signal) else signal
        columns[variable.name] = _values(values, variable, len(excitation.time))
    columns = dict(sorted(columns.items(), key=lambda item: item[0].startswith("fin[")))
    return Excitation(excitation.title, spread(columns, unit), excitation.begin, excitation.step,
                      excitation.start_values, excitation.spring)


def _input(given: str, there_are: Mapping[str, Variable]) -> Variable:
    """Return the input of a name with ``__`` for the dot. Raises EmcasError."""
    name = given.replace("__", ".")
    if name not in there_are:
        raise EmcasError(f"there is no input {name}{hint(name, there_are)}; inputs are {', '.join(there_are)}")
    return there_are[name]


def _values(given: Any, variable: Variable, count: int) -> Array:
    """Return `count` finite values of an input, in its unit, from a number, text or array. Raises EmcasError."""
    what = f"input {variable.name}"
    expected = (f"expected a number, text with a unit, a function of time, or an array of {count} values, one for each "
                "point")
    numbers = _numbers(given, what, variable.unit, expected)
    try:
        column: Array = np.broadcast_to(numbers, count).copy()
    except ValueError as error:
        raise EmcasError(f"{what}: {expected}") from error
    return column


def _numbers(given: Any, what: str, unit: str, expected: str) -> Array:
    """Return finite numbers in a unit, from text or numbers; an array of floats is not copied. Raises EmcasError."""
    try:
        numbers: Array = np.asarray(quantity(given, "", unit) if isinstance(given, str) else given, dtype=float)
    except (TypeError, ValueError) as error:
        raise EmcasError(f"{what}: {f'{given!r} {error}' if isinstance(given, str) else expected}") from error
    if not compiled.all_finite(numbers):
        raise EmcasError(f"{what} is {numbers[~np.isfinite(numbers)][0]}; give finite values")
    return numbers


@checked
def validate(subject: Subject | ParameterSet | Path | str | None = None, cases: Sequence[str] | str | None = None,
             directory: Path | str | None = None, progress: Progress = silent, inside: bool = False,
             requirements: Path | str | None = None) -> Validation:
    """Judge a parameter set, or an FMU by its path, by the reference cases and by requirements.

    `cases` are all unless given by name, one or several, and then no requirement is judged; `directory` holds the
    references (``emcas reference`` makes them), `requirements` is a file of them, those shipped unless given.
    References that an FMU carries are used with `inside`, or where the shipped ones are of another actuator or other
    parameters. Of the result: `passed`, `verdict` (in words), `judged` and `failed` (each with what was measured and
    its limit). Raises EmcasError.
    """
    cases = [cases] if isinstance(cases, str) else cases
    folder = None if directory is None else Path(directory)
    if isinstance(subject, ParameterSet):
        subject = ParameterSubject(subject)
    held = nullcontext(subject) if isinstance(subject, Subject) else open_subject(
        None if subject is None else Path(subject))
    with held as opened:
        specification = load_requirements(None if requirements is None else Path(requirements), opened.parameters)
        return _validate(opened, cases, folder, progress, inside, specification)


@checked
def analyse(parameters: ParameterSet | None = None, fin_angle: float | str = 0.0, aero_torque: float | str = 0.0,
            locus: str | None = None, rod: Path | str | None = None, progress: Progress = silent) -> Analysis:
    """Linearise an actuator about rest at a fin angle [rad] under a hinge moment [N.m], and analyse its loops.

    Of the result: `linear.command` (the frequency response, with `bandwidth` [Hz]), `linear.margins` (of each loop),
    `actuator` (the linear model, python-control's StateSpace at `actuator.closed`), `sweeps` (bandwidth against
    amplitude), `locus` (the root locus of the parameter `locus`, the first gain unless named). `rod` is a TOML file of
    shaft and screw for the natural frequencies, over ``models/rod.toml``. Needs the extra ``analysis``. Raises
    EmcasError.
    """
    extras.require("analysis", "analyse needs", "control", "casadi")
    from .studies.analysis.analyse import analyse as run

    return run(parameters or load_parameters(), _in("rad", fin_angle, 0.0),
               _in("N.m", aero_torque, 0.0), None if rod is None else Path(rod), locus, progress)


@checked
def tune(parameters: ParameterSet | None = None, study: Study | Path | str | None = None, seed: int = 1,
         generations: int = 12, workers: int | None = None, journal: Path | str | None = None,
         progress: Progress = silent) -> Tuning:
    """Search controller gains that meet requirements in every case at once, limits, friction and delay included.

    `study` is a file of requirements, cases and what may be tuned; the actuator's shipped one unless given. Of the
    result: `met`, `tuned` (the parameter set with the gains), `best` (with `gains` and `judgements`), `binding` (the
    requirements that stand in the way of more). `generations` are those of the global search; the same `seed` gives the
    same gains. A file `journal` keeps every evaluation, and a search goes on from what is in it. As many processes
    work as there are processors unless `workers` is given; a script that calls this needs
    ``if __name__ == "__main__":``. Takes minutes. Raises EmcasError.
    """
    from .studies.tuning.evaluate import Journal
    from .studies.tuning.optimise import tune as run
    from .studies.tuning.study import Study, load_study, shipped_study

    if seed < 0:
        raise EmcasError(f"tune: seed = {brief(seed)}: expected a whole number from 0 on")
    _count("tune", 1, generations=generations, workers=workers)
    base = parameters or load_parameters()
    chosen = (shipped_study(base) if study is None else study if isinstance(study, Study) else
              load_study(Path(study), base))
    if chosen.specification.needs_analysis:
        extras.require("analysis", "margins (tests of kind linear) need", "control", "casadi")
    evaluations = Journal(None if journal is None else Path(journal), chosen)
    return run(chosen, seed, generations, workers or os.cpu_count() or 1, evaluations, progress)


def _count(what: str, least: int, **numbers: int | None) -> None:
    """Raise EmcasError for a number that is below the least or above what memory and time allow; None is none."""
    for name, number in numbers.items():
        if number is not None and not least <= number <= _MOST:
            raise EmcasError(f"{what}: {name} = {brief(number)}: expected a whole number from {least} to {_MOST}")


def _check_column(variable: Variable, values: Array) -> None:
    """Raise ParameterError naming the first actuator whose value of a parameter is out of its limits, or not whole."""
    wrong = (values < variable.minimum) | (values > variable.maximum)
    if variable.kind != "Real":
        wrong |= values != np.floor(values)
    if variable.kind == "Boolean":
        wrong |= (values != 0.0) & (values != 1.0)
    if wrong.any():
        place = int(np.argmax(wrong))
        limits = "" if variable.kind == "Boolean" else f" from {variable.minimum:g} to {variable.maximum:g}"
        raise ParameterError([f"actuator {place}: {variable.name} = {values[place]:g} is not a {variable.kind}"
                              f"{limits}"])


class Batch:
    """Many actuators of one model side by side, in machine code: for a 6-DOF's Monte Carlo, or a swarm.

    `sets` are a parameter set for each, or one for all `count` of them, in which `varied` has parameters by name, SI,
    an array [count] of a value for each. `threads` share the work of a step; a call gives up the interpreter's lock,
    too, so that batches may be stepped by several threads at once. As many actuators are moved at once as the
    processor's vectors hold; each moves as it does alone, to the bit. Raises ParameterError naming the actuator that
    cannot have its parameters, CompilerError where there is no C compiler, both EmcasErrors.
    """

    @checked
    def __init__(self, sets: Sequence[ParameterSet] | ParameterSet, count: int | None = None, *,
                 varied: Mapping[str, Array] | None = None, threads: int = 1, progress: Progress = silent) -> None:
        given = _sets("Batch", sets)
        if count is None:
            count = len(given)
        elif len(given) > 1:
            raise EmcasError(f"Batch: count = {count} goes with one parameter set")
        _count("Batch", 1, count=count, threads=threads)
        actuator = given[0].actuator
        of_each = {id(each): each for each in given}
        place = {key: k for k, key in enumerate(of_each)}
        which = np.array([place[id(each)] for each in given])
        rows = np.array([compiled.parameter_row(each.values, each.model) for each in of_each.values()])
        parameters = rows if len(rows) == 1 else rows[which]
        columns = {name: self._column("parameter", name, values, count) for name, values in (varied or {}).items()}
        if columns:
            parameters = np.broadcast_to(parameters, (count, parameters.shape[1])).copy()
        places = {v.name: k for k, v in enumerate(actuator.parameters)}
        known = {e.variable.name: e.variable for e in given[0].entries}
        for name, values in columns.items():
            if name not in known:
                raise EmcasError(f"Batch: {actuator.name} has no parameter {name}{hint(name, known)}")
            _check_column(known[name], np.broadcast_to(values, count))
            if name in places:  # others are an input's start
                parameters[:, places[name]] = values
        self._kernel = batch.Batch(parameters, count, given[0].model, threads, progress)
        self._variables = {v.name: v for v in actuator.inputs}
        self._places = {v.name: k for k, v in enumerate(actuator.inputs)}
        for k, variable in enumerate(actuator.inputs):
            starts = np.array([variable.initial(each.values) for each in of_each.values()], dtype=float)
            start = starts[0] if len(starts) == 1 else starts[which]
            self._kernel.hold(k, columns.get(variable.key or "", start))
        self._kernel.run(0.0)
        self.outputs: dict[str, Array] = dict(zip((v.name for v in actuator.outputs), self._kernel.outputs,
                                                  strict=True))
        """Outputs at `time` by name, SI, an array of a value for each actuator. The next step writes over it."""
        self.time = 0.0
        """Time that was reached [s]."""

    def __len__(self) -> int:
        return self._kernel.count

    @staticmethod
    def _column(what: str, name: str, values: Any, count: int, unit: str = "") -> Array:
        """Return a number, or an array [count] that is not copied. Raises EmcasError."""
        column = _numbers(values, f"{what} {name}", unit, "expected numbers")
        if column.shape not in ((), (count,)):
            raise EmcasError(f"{what} {name}: expected a number, or an array of {count} values, one for each actuator")
        return column

    def run(self, end: float, progress: Progress = silent, **inputs: float | str | Array) -> dict[str, Array]:
        """Move every actuator on to `end` [s] and return `outputs`.

        Inputs, SI, by name with ``__`` for the dot, are a number or text with a unit for all or an array of one for
        each, which is not copied; they hold until they are given anew. Raises EmcasError for an unknown input, an
        unsound value, an end that is no number or before `time`, and nothing has changed; ArithmeticError naming the
        actuators that cannot be followed: these stay where they were.
        """
        # By hand: a step of a few actuators takes 10 us, and `checked` would take 2 more.
        if not isinstance(end, (int, float, np.integer, np.floating)):
            raise EmcasError(f"Batch.run: end = {brief(end)}: expected a number, the time to move on to in s")
        if not self.time <= end < float("inf"):
            raise EmcasError(f"Batch.run: the end {brief(end)} s is before {self.time:g} s, which is reached, or not "
                             "finite")
        if not callable(progress):
            raise EmcasError(f"Batch.run: progress = {brief(progress)}: expected a function")
        columns = {}
        for given, value in inputs.items():
            variable = _input(given, self._variables)
            columns[self._places[variable.name]] = self._column("input", variable.name, value, len(self),
                                                                variable.unit)
        for place, column in columns.items():
            self._kernel.put(place, column)
        reached, self.time = self.time, end  # also where a progress raises: some have moved, and none goes back
        try:
            self._kernel.run(end, progress)
        except ArithmeticError:
            if not self._kernel.moved:
                self.time = reached
            raise
        return self.outputs
