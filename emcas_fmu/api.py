"""The Python interface: load, change, simulate, build, validate, analyse, calibrate and tune fin actuators.

The names in ``__all__``, their parameters, and the attributes that their docstrings name are stable: a change that
breaks a program comes with a new minor version and a line in the changelog. Everything else in the package may change.
The commands of `emcas` with the names of these functions call them.

Numbers are in SI units (temperatures in degC). Text contains its unit, as in ``"10 deg"``. `progress` is a function
that is called during long work with the work's name, the number of finished parts and the number of all parts.
"""

from __future__ import annotations

import os
import warnings
from collections.abc import Iterable, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from . import actuators
from .bench import excitation as excitations
from .bench.excitation import COMMAND, Excitation, check_span
from .bench.fmu_subject import open_subject
from .bench.requirements import load_requirements
from .bench.subject import ParameterSubject, Subject
from .errors import EmcasError, EmcasWarning, hint
from .fmi.interface import FmuInterface, fin_sets, require_shared
from .fmi.package import Built, build
from .motions import STEP
from .parameters import ParameterError, ParameterSet, load_parameters
from .response import Response
from .runtime import batch, compiled
from .simulation import Array, InputSignal, simulate_fins, spread
from .simulation import simulate as simulate_one
from .studies.validate.validation import Validation
from .studies.validate.validation import validate as _validate
from .support import extras
from .support.arguments import brief, checked
from .support.progress import Progress, silent
from .units import UnitError, quantity
from .variables import Variable

if TYPE_CHECKING:
    from .studies.analysis.analyse import Analysis
    from .studies.identification.calibration import Calibration
    from .studies.tuning.optimise import Tuning
    from .studies.tuning.study import Study

__all__ = ["Batch", "Built", "EmcasError", "Excitation", "ParameterError", "ParameterSet", "Response", "Validation",
           "actuators", "analyse", "build", "calibrate", "excitations", "fin_sets", "load_parameters", "simulate",
           "tune", "validate"]

_DURATION = 0.5  # s
# What the value of an input may be, in messages; {} is the number of values in an array.
_OF_A_RUN = "a number, text with a unit, a function of time, or an array of {} values, one for each point"
_OF_A_BATCH = "a number, or an array of {} values, one for each actuator"
_MOST = 100_000_000  # largest number of actuators (their outputs alone would need 20 GB), generations or processes


@checked
def simulate(parameters: ParameterSet | Sequence[ParameterSet] | None = None, excitation: Excitation | None = None, *,
             stop: float | str | None = None, step: float | str | None = None, kernel: str = "auto",
             line: Mapping[str, float] | None = None, **inputs: InputSignal | str) -> Response:
    """Simulate an actuator, or several fins on one supply, without an FMU, and return the `Response`.

    `parameters` is a parameter set, by default that of the default actuator. Several sets (see `fin_sets`) are those of
    fins that share a supply; `line` then maps names of the supply line's parameters, such as
    ``bus.source_resistance``, to values in SI.

    An `excitation`, such as ``excitations.step_to(0.1, 0.4)``, sets inputs, communication step and end. Without one the
    simulation ends at `stop` [s] (default 0.5 s) and has communication steps of `step` [s] (default 1 ms). Keywords set
    other inputs, or replace those of the excitation: their names are those of inputs with ``__`` for the dot
    (``attitude__roll``), their values numbers, text with a unit (``"10 deg"``), functions of time [s], or arrays with a
    value for each communication point. A value is held over a communication step. Other inputs keep their start values.

    `kernel` is ``python``, ``compiled`` or ``auto`` (compiled if this saves time); both kernels compute the same
    numbers. The first compilation of an actuator takes up to a minute. Several fins are computed in Python.

    Warns (EmcasWarning) about a command that is clipped at its limit, which is perhaps in degrees, and about parameters
    of the line that are allowed but unusual. Raises EmcasError for arguments with which no response can be computed.
    """
    sets = _sets("simulate", parameters)
    interface = FmuInterface(len(sets), sets[0].model)
    if line and interface.fins == 1:
        raise EmcasError("simulate: line applies to several fins on one supply; pass their sets, as from fin_sets")
    if interface.fins > 1 and kernel not in ("auto", "python"):
        raise EmcasError(f"kernel {kernel}: several fins are computed in Python; leave it out, or build a native FMU")
    if excitation is None:
        excitation = _at_rest(_in("s", stop, _DURATION), _in("s", step, STEP), inputs)
    elif stop is not None or step is not None:
        raise EmcasError(f"simulate: stop and step are set by the excitation, {excitation.title}; leave them out")
    excitation = _with_inputs(excitation, inputs, interface)
    sets = tuple(each.with_values(each.having(excitation.start_values)) for each in sets)
    require_shared(sets, "simulate")
    try:
        columns = (simulate_fins([each.values for each in sets], excitation.stop, excitation.step, interface.kind, line,
                                 **excitation.columns) if interface.fins > 1 else
                   simulate_one(sets[0].values, excitation.stop, excitation.step, kernel, interface.kind,
                                **excitation.columns))
    except EmcasError:
        raise
    except (ArithmeticError, TypeError, ValueError) as error:
        raise EmcasError(f"the response cannot be computed: {error}") from error
    response = Response(interface, sets, excitation, columns)
    of_line = interface.line.broken_rules(line, warnings=True) if interface.line and line else []
    for message in (*response.warnings, *of_line):
        warnings.warn(message, EmcasWarning, stacklevel=3)  # at the caller's line, outside `checked`
    return response


def _sets(function: str, parameters: Any) -> tuple[ParameterSet, ...]:
    """Return the parameter set or sets as a tuple; None is the default. Raises EmcasError if actuators differ."""
    several = isinstance(parameters, Iterable)
    sets = tuple(load_parameters() if each is None else each for each in (parameters if several else (parameters,)))
    if not sets or len({each.model for each in sets}) > 1:
        raise EmcasError(f"{function}: pass one parameter set, or several of one actuator")
    return sets


def _in(unit: str, value: float | str | None, default: float) -> float:
    """Return a value in `unit`, from a number in this unit, or from text; the default for None. Raises EmcasError."""
    if value is None:
        return default
    try:
        return quantity(value, "", unit) if isinstance(value, str) else float(value)
    except ValueError as error:
        raise EmcasError(f"{value!r} {error}") from error


def _at_rest(stop: float, step: float, inputs: Mapping[str, InputSignal | str]) -> Excitation:
    """Return an excitation with a command of 0 whose title lists `inputs`, which it does not contain yet."""
    if not (0.0 < step < float("inf") and 0.0 < stop < float("inf")):
        raise EmcasError(f"simulate: stop = {stop:g} s and step = {step:g} s must be above 0")
    check_span("simulate", step, stop)
    title = ", ".join(f"{name} {signal}" if isinstance(signal, (str, float, int)) else name
                      for name, signal in inputs.items())
    return Excitation(title or "at rest", {COMMAND: np.zeros(round(stop / step) + 1)}, step=step)


def _with_inputs(base: Excitation, inputs: Mapping[str, InputSignal | str], interface: FmuInterface) -> Excitation:
    """Return `base` with additional inputs; an input of one fin replaces the same input of all fins."""
    known = {v.name: v for v in (*interface.actuator.inputs, *interface.inputs)}
    columns = dict(base.columns)
    for keyword, signal in inputs.items():
        variable = _input(keyword, known)
        values = [signal(t) for t in base.time.tolist()] if callable(signal) else signal
        count = len(base.time)
        columns[variable.name] = np.broadcast_to(_column(
            f"input {variable.name}", values, variable.unit, count, _OF_A_RUN), count).copy()
    columns = dict(sorted(columns.items(), key=lambda item: item[0].startswith("fin[")))
    return replace(base, columns=spread(columns, interface))


def _input(keyword: str, known: Mapping[str, Variable]) -> Variable:
    """Return the input that a keyword names, with ``__`` for the dot. Raises EmcasError."""
    name = keyword.replace("__", ".")
    if name not in known:
        raise EmcasError(f"there is no input {name}{hint(name, known)}; inputs are {', '.join(known)}")
    return known[name]


def _column(label: str, values: Any, unit: str, count: int, accepted: str) -> Array:
    """Return a number or an array [count] in `unit`, from numbers or text; an array of floats is not copied.

    Raises EmcasError for values that are not finite or of another kind; its message begins with the `label` and has the
    values that are `accepted`, a format with {} for `count`.
    """
    try:
        numbers: Array = np.asarray(quantity(values, "", unit) if isinstance(values, str) else values, dtype=float)
        if numbers.shape not in ((), (count,)):
            raise TypeError("another shape")
    except UnitError as error:
        raise EmcasError(f"{label}: {values!r} {error}") from error
    except (TypeError, ValueError) as error:
        raise EmcasError(f"{label}: expected {accepted.format(count)}") from error
    if not compiled.all_finite(numbers):
        raise EmcasError(f"{label} is {numbers[~np.isfinite(numbers)][0]}; use finite values")
    return numbers


@checked
def validate(subject: Subject | ParameterSet | Path | str | None = None, cases: Sequence[str] | str | None = None,
             directory: Path | str | None = None, progress: Progress = silent, inside: bool = False,
             requirements: Path | str | None = None) -> Validation:
    """Validate a parameter set, or an FMU by its path, against reference cases and requirements.

    `subject` is a parameter set, or the path of an FMU or a parameter file; by default the default parameter set. By
    default all reference cases are run, and the requirements are judged; with names of `cases` only these cases are
    run, and no requirement is judged. `directory` contains the references, as computed by ``emcas reference``, by
    default the shipped ones. The references embedded in an FMU are used instead with `inside`, or if there is no
    `directory` and the shipped ones are for another actuator or other parameters. `requirements` is a TOML file, by
    default the shipped one for the actuator.

    The result has `passed`, `verdict` (in words), `judged` and `failed`: lists of criteria, each with `measured`,
    `limit` and `unit`. Raises EmcasError if the validation cannot be carried out.
    """
    cases = [cases] if isinstance(cases, str) else cases
    folder = None if directory is None else Path(directory)
    if isinstance(subject, ParameterSet):
        subject = ParameterSubject(subject)
    context = nullcontext(subject) if isinstance(subject, Subject) else open_subject(
        None if subject is None else Path(subject))
    with context as opened:
        specification = load_requirements(None if requirements is None else Path(requirements), opened.parameters)
        return _validate(opened, cases, folder, progress, inside, specification)


@checked
def analyse(parameters: ParameterSet | None = None, fin_angle: float | str = 0.0, aero_torque: float | str = 0.0,
            locus: str | None = None, rod: Path | str | None = None, progress: Progress = silent) -> Analysis:
    """Linearise an actuator at rest at a fin angle [rad] under an aerodynamic torque [N.m], and analyse its loops.

    `locus` names the parameter of the root locus, by default the first gain. The TOML file `rod` overrides values of
    ``models/rod.toml``: shaft and screw, for the natural frequencies. Needs the extra ``analysis``.

    The result has `linear.command` (the frequency response, with its `bandwidth` [Hz]), `linear.margins` (by the name
    of the loop), `actuator` (the linear model, whose closed loop `actuator.closed` is python-control's StateSpace),
    `sweeps` (a frequency response for each amplitude) and `locus` (the root locus). Raises EmcasError if the actuator
    cannot be analysed there.
    """
    extras.require("analysis", "analyse needs", "control", "casadi")
    from .studies.analysis.analyse import analyse as run

    return run(parameters or load_parameters(), _in("rad", fin_angle, 0.0),
               _in("N.m", aero_torque, 0.0), None if rod is None else Path(rod), locus, progress)


@checked
def calibrate(records: Sequence[Path | str] | Path | str, parameters: ParameterSet | None = None,
              free: Sequence[str] | str = (), hold_out: Sequence[Path | str] = (), compare: Sequence[str] = (),
              priors: Sequence[str] = (), delays: bool = False, robust: bool = False, seed: int = 1,
              progress: Progress = silent) -> Calibration:
    """Fit parameters of an actuator to records of its inputs and outputs, and compute their uncertainties.

    `records` are CSV files with columns such as ``time [s]``, ``fin_command [deg]`` and ``fin_angle [deg]``. The files
    in `hold_out` are compared with the result but not fitted, even if they are also in `records`. `free` names the
    parameters to fit, as ``"inertia.motor"`` or, with bounds, ``"motor.resistance=0.1..0.4 Ohm"``. `priors` are values
    of free parameters that are known before, with their standard deviations, as ``"motor.resistance=0.25+-0.02 Ohm"``.
    `compare` names the outputs to compare, by default all that the records share. With `delays` the delay of each
    measured output is also fitted. With `robust` a large error counts in proportion to its size, not to its square.
    `seed`, from 0, determines the starting points.

    The result has `calibrated` (the parameter set), `estimates` (each with `value`, `sigma`, `unit`), `comparisons`
    (each with `figures`), `problems` (messages) and `write_report(path)`. Raises EmcasError for unusable arguments.
    """
    from .studies.identification.calibration import calibrate as run

    _check_seed("calibrate", seed)
    names = [records] if isinstance(records, (str, Path)) else records
    return run([Path(name) for name in names], parameters or load_parameters(),
               [free] if isinstance(free, str) else free, [Path(name) for name in hold_out], compare, priors, delays,
               robust, seed, progress)


@checked
def tune(parameters: ParameterSet | None = None, study: Study | Path | str | None = None, seed: int = 1,
         generations: int = 12, workers: int | None = None, journal: Path | str | None = None,
         progress: Progress = silent) -> Tuning:
    """Search for gains that meet requirements in all cases, by simulation with limits, friction and delay.

    The search takes minutes. `study` is a file with requirements, cases and the parameters to tune, by default the
    shipped one. `generations` is the number of generations of the global search; the same `seed`, from 0, gives the
    same gains. An interrupted search continues from the evaluations in the file `journal`. `workers` is the number of
    processes, by default one per processor; scripts that call `tune` need ``if __name__ == "__main__":``.

    The result has `met` (whether all requirements are met), `tuned` (the parameter set with the gains), `best` (with
    `gains` and `judgements`) and `binding` (the names of the requirements that limit the result). Raises EmcasError for
    arguments that cannot be used.
    """
    from .studies.tuning.evaluate import Journal
    from .studies.tuning.optimise import tune as run
    from .studies.tuning.study import Study, load_study, shipped_study

    _check_seed("tune", seed)
    _check_counts("tune", generations=generations, workers=workers)
    base = parameters or load_parameters()
    chosen = (shipped_study(base) if study is None else study if isinstance(study, Study) else
              load_study(Path(study), base))
    if any(r.test and r.test.kind == "linear" for r in chosen.requirements):
        extras.require("analysis", "margins (tests of kind linear) need", "control", "casadi")
    evaluations = Journal(None if journal is None else Path(journal), chosen)
    return run(chosen, seed, generations, workers or os.cpu_count() or 1, evaluations, progress)


def _check_seed(function: str, seed: int) -> None:
    if seed < 0:
        raise EmcasError(f"{function}: seed = {brief(seed)}: expected a whole number from 0 on")


def _check_counts(function: str, **numbers: int | None) -> None:
    """Raise EmcasError for a number below 1 or above `_MOST`; None is not checked."""
    for name, number in numbers.items():
        if number is not None and not 1 <= number <= _MOST:
            raise EmcasError(f"{function}: {name} = {brief(number)}: expected a whole number from 1 to {_MOST}")


def _check_column(variable: Variable, values: Array) -> None:
    """Raise ParameterError for the first actuator whose value is beyond limits or not of the parameter's kind."""
    wrong = (values < variable.minimum) | (values > variable.maximum)
    if variable.kind != "Real":
        wrong |= values != np.floor(values)
    if variable.kind == "Boolean":
        wrong |= (values != 0.0) & (values != 1.0)
    if wrong.any():
        index = int(np.argmax(wrong))
        limits = "" if variable.kind == "Boolean" else f" from {variable.minimum:g} to {variable.maximum:g}"
        raise ParameterError([f"actuator {index}: {variable.name} = {values[index]:g} is not a {variable.kind}"
                              f"{limits}"])


class Batch:
    """Many actuators of one model side by side, in machine code: for Monte Carlo runs of a 6-DOF, or a swarm.

    `sets` contains a parameter set for each actuator, or is one set for all `count` actuators. `varied` maps names of
    parameters to their values [SI], an array [count] or a number for all. `threads` is the number of threads that share
    a step. A program may also step several batches at once, each in its own thread: a step does not hold the
    interpreter's lock. The numbers are those of a single actuator, to the bit.

    Raises ParameterError, which names an actuator with unsound parameters; CompilerError, an EmcasError, without a C
    compiler; and EmcasError for other arguments that cannot be used.
    """

    @checked
    def __init__(self, sets: Sequence[ParameterSet] | ParameterSet, count: int | None = None, *,
                 varied: Mapping[str, Array] | None = None, threads: int = 1, progress: Progress = silent) -> None:
        chosen = _sets("Batch", sets)
        if count is None:
            count = len(chosen)
        elif len(chosen) > 1:
            raise EmcasError(f"Batch: count = {count} needs exactly one parameter set")
        _check_counts("Batch", count=count, threads=threads)
        actuator = chosen[0].actuator
        different = {id(each): each for each in chosen}  # many actuators often share one set
        index = {key: k for k, key in enumerate(different)}
        indices = np.array([index[id(each)] for each in chosen])
        rows = np.array([compiled.parameter_row(each.values, each.model) for each in different.values()])
        parameters = rows if len(rows) == 1 else rows[indices]
        columns = {name: _column(f"parameter {name}", values, "", count, _OF_A_BATCH)
                   for name, values in (varied or {}).items()}
        if columns:
            parameters = np.broadcast_to(parameters, (count, parameters.shape[1])).copy()
        positions = {v.name: k for k, v in enumerate(actuator.parameters)}
        known = {e.variable.name: e.variable for e in chosen[0].entries}
        for name, values in columns.items():
            if name not in known:
                raise EmcasError(f"Batch: {actuator.name} has no parameter {name}{hint(name, known)}")
            _check_column(known[name], np.broadcast_to(values, count))
            if name in positions:  # others are start values of inputs
                parameters[:, positions[name]] = values
        self._kernel = batch.Batch(parameters, count, chosen[0].model, threads, progress)
        self._variables = {v.name: v for v in actuator.inputs}
        self._indices = {v.name: k for k, v in enumerate(actuator.inputs)}
        for k, variable in enumerate(actuator.inputs):
            starts = np.array([variable.initial(each.values) for each in different.values()], dtype=float)
            start = starts[0] if len(starts) == 1 else starts[indices]
            self._kernel.hold(k, columns.get(variable.key or "", start))
        self._kernel.run(0.0)
        self.outputs: dict[str, Array] = dict(zip((v.name for v in actuator.outputs), self._kernel.outputs,
                                                  strict=True))
        """Outputs [SI] at `time` by name: arrays [count], which the next call of `run` overwrites."""
        self.time = 0.0
        """Time [s] that the batch has reached."""

    def __len__(self) -> int:
        return self._kernel.count

    def run(self, end: float, progress: Progress = silent, **inputs: float | str | Array) -> dict[str, Array]:
        """Advance every actuator to `end` [s] and return `outputs`.

        Keywords are names of inputs with ``__`` for the dot. A value is a number [SI] or text with a unit for all
        actuators, or an array [count], which is not copied. It is held until it is set again. Raises EmcasError, and
        changes nothing, for an unknown input, a value or `progress` that cannot be used, and an end before `time`.
        Raises ArithmeticError, which names the actuators whose step cannot be computed; these keep their states.
        """
        # Without `checked`, which would add 2 us: a step of a few actuators takes 10 us.
        if not isinstance(end, (int, float, np.integer, np.floating)):
            raise EmcasError(f"Batch.run: end = {brief(end)}: expected a number, the time to advance to in s")
        if not self.time <= end < float("inf"):
            raise EmcasError(f"Batch.run: the end {brief(end)} s is before the time reached, {self.time:g} s, or not "
                             "finite")
        if not callable(progress):
            raise EmcasError(f"Batch.run: progress = {brief(progress)}: expected a function")
        columns = {}
        for keyword, value in inputs.items():
            variable = _input(keyword, self._variables)
            columns[self._indices[variable.name]] = _column(
                f"input {variable.name}", value, variable.unit, len(self), _OF_A_BATCH)
        for index, column in columns.items():
            self._kernel.hold(index, column)
        reached, self.time = self.time, end  # also if `progress` raises: some actuators have moved by then
        try:
            self._kernel.run(end, progress)
        except ArithmeticError:
            if not self._kernel.moved:
                self.time = reached
            raise
        return self.outputs
