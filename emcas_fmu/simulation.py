"""Simulation of actuators in this process, without an FMU."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from .actuators import NONLINEAR, get
from .errors import EmcasError
from .fmi.interface import MIXING, FmuInterface, start_values
from .parameters import ParameterError, check_parameters, require_sound
from .rules import check_ranges
from .runtime import codegen, compiled, diagnosis, library, trial
from .runtime.core import Functions
from .runtime.multi_fin import MultiFin
from .variables import Variable

T = TypeVar("T")

Array = NDArray[Any]
InputSignal = float | bool | Sequence[float] | Array | Callable[[float], float | bool]
KERNELS = ("auto", "compiled", "python")
LONGEST_DIAGNOSIS = 2.0  # s of a failed run, which are repeated in Python, in up to 20 s, to find the faulty line
_UNCHOSEN = ("; Python raises it also for the value that ops.where does not choose: choose the divisor, or the "
             "argument of the root, by ops.where, or use ops.branch")
MOST_POINTS = 10_000_000  # communication points; more outputs may not fit into memory


def simulate(values: Mapping[str, Any], stop: float, step: float = 1e-3, kernel: str = "auto",
             model: str = NONLINEAR, **inputs: InputSignal) -> dict[str, Array]:
    """Return ``time`` [s] and the outputs [SI] of an actuator by name: arrays [points], from 0 to `stop` every `step`.

    `values` are the parameters of the `model` (:mod:`emcas_fmu.actuators`) by name, SI; `stop` and `step` are in s.
    Keywords are names of inputs with ``__`` for the dot (``attitude__roll``); a value is a constant, a function of time
    [s], or an array [points], and is held over a step. `kernel` is ``compiled``, ``python`` or ``auto`` (compiled if
    this saves time, see :func:`emcas_fmu.runtime.library.worth`). Both kernels compute the same numbers.

    Raises TypeError for an unknown input, ValueError for times, inputs and parameters that cannot be used,
    ArithmeticError if a step cannot be computed, EmcasError for a kernel that does not exist or cannot be compiled.
    """
    actuator = get(model)
    table = _table(actuator.inputs, [v.initial(values) for v in actuator.inputs], stop, step, inputs)
    columns = respond_all(compiled.parameter_row(values, model)[np.newaxis], list(table.T), step,
                          [v.name for v in actuator.outputs], kernel, model).finished()
    return {"time": np.arange(len(table)) * step, **{name: column[0] for name, column in columns.items()}}


def simulate_fins(sets: Sequence[Mapping[str, Any]], stop: float, step: float = 1e-3, model: str = NONLINEAR,
                  line: Mapping[str, float] | None = None, **inputs: InputSignal) -> dict[str, Array]:
    """Return ``time`` [s] and the outputs [SI] of several fins on one supply line, by the names of a multi-fin FMU.

    The steps are computed in Python, slower than by `simulate`. `sets` are the parameters of each fin; `line` changes
    parameters of the line (``bus.source_resistance``, ``line.accumulator_volume``). An input of a single actuator, such
    as ``fin_command``, applies to every fin, ``**{"fin[2].fin_command": ...}`` to one. Raises the errors of `simulate`,
    and EmcasError for an unknown parameter of the line.
    """
    interface = FmuInterface(len(sets), model)
    if interface.fins == 1:
        raise ValueError("one fin shares no line; see simulate()")
    problems = [f"fin {k}: {problem}" for k, values in enumerate(sets, 1)
                for problem in check_parameters(values, model)]
    starts = dict(zip((v.name for v in interface.variables), start_values(interface, sets), strict=True))
    line_parameters = interface.line.parameters if interface.line else ()
    line_values = {v.name: starts[v.name] for v in line_parameters}
    if unknown := [name for name in line or {} if name not in line_values]:
        raise EmcasError(
            f"there is no {unknown[0]}; the {interface.line.name} has {', '.join(line_values)}" if interface.line else
            f"{unknown[0]}: {interface.actuator.name} has no supply line; leave line out")
    line_values |= line or {}
    problems += check_ranges(line_values, [(v.name, v.minimum, v.maximum) for v in line_parameters])
    if interface.line and not problems:
        problems += interface.line.broken_rules(line_values)
    if problems:
        raise ParameterError(problems)
    table = _table(interface.inputs, [starts[v.name] for v in interface.inputs], stop, step, spread(inputs, interface))
    _check_finite(table, interface.inputs, step)
    source, of_line = get(model).source, list(line_values.values())
    if source is not None:
        starts_of_one = [float(v.initial(sets[0])) for v in get(model).inputs]
        trial.try_out(model, compiled.parameter_row(sets[0], model), starts_of_one, 100, _by_python, _by_python)
    try:
        rows = _fins_by_python(interface, codegen.multi_fin(sets, of_line, model), table, step)
    except (ArithmeticError, ValueError):
        if source is not None:  # raises the error with the line of the file, if it is within this time
            cores = codegen.multi_fin(sets, of_line, model, diagnosis.functions)
            _fins_by_python(interface, cores, table[:round(LONGEST_DIAGNOSIS / step) + 1], step)
        raise
    outputs = {v.name: rows[:, i].copy() for i, v in enumerate(interface.outputs)}
    return {"time": np.arange(len(table)) * step, **outputs}


def _fins_by_python(interface: FmuInterface, cores: MultiFin, table: Array, step: float) -> Array:
    mixing = [interface.reference[v.name] for v in MIXING]
    rows, acting = np.empty((len(table), len(interface.outputs))), tuple[Any, ...]()
    for k, row in enumerate(table.tolist()):
        if k:
            rows[k] = cores.run(k * step, acting)
        fins = [[row[i] for i in indices] for indices in interface.fin_inputs]
        acting = cores.acting(fins, cores.motion_loads(*fins[0][codegen.MOTION_SLICE]), [row[i] for i in mixing])
        if not k:
            rows[k] = cores.outputs(acting)
    return rows


def spread(inputs: Mapping[str, T], interface: FmuInterface) -> dict[str, T]:
    """Return inputs by the names of a multi-fin FMU; an input of a single actuator becomes the input of every fin."""
    names, names_of_one = {v.name for v in interface.inputs}, {v.name for v in interface.actuator.inputs}
    by_name: dict[str, T] = {}
    for keyword, signal in inputs.items():
        name = keyword.replace("__", ".")
        every = name not in names and name in names_of_one
        by_name |= {interface.name(name, fin): signal for fin in range(interface.fins)} if every else {name: signal}
    return by_name


def _table(variables: Sequence[Variable], starts: Sequence[Any], stop: float, step: float,
           inputs: Mapping[str, InputSignal]) -> Array:
    """Return an array [points, variables] of values at the communication points; `starts` where `inputs` has none."""
    if not (0.0 < step < np.inf and step * 0.5 <= stop <= MOST_POINTS * step):
        raise ValueError(f"from 0 to {stop} s every {step} s: both must be above 0, with 1 to {MOST_POINTS:g} steps")
    times: Array = np.arange(round(stop / step) + 1) * step
    index = {v.name: i for i, v in enumerate(variables)}
    table = np.empty((len(times), len(variables)))
    table[:] = starts
    for keyword, signal in inputs.items():
        name = keyword.replace("__", ".")
        if name not in index:
            raise TypeError(f"there is no input {name!r}; inputs are {', '.join(index)}")
        column = table[:, index[name]]
        values = np.asarray([*map(signal, times[:-1]), 0.0] if callable(signal) else signal, dtype=float)
        if values.shape not in ((), times.shape):
            raise ValueError(f"input {name} has shape {values.shape}, not that of the {len(times)} communication "
                             "points")
        column[:] = values
        column[-1] = column[-2]  # a value at the last point has no effect
    return table


def respond_all(sets: Array, inputs: Sequence[Array], step: float, outputs: Sequence[str], kernel: str = "auto",
                model: str = NONLINEAR, held: int = 1, fine: Collection[str] = (),
                spring: Array | float = 0.0) -> compiled.Tables:
    """Return the outputs of many actuators; shapes and units as in :func:`emcas_fmu.runtime.compiled.run_tables`.

    With ``python``, or ``auto`` and no compiled kernel, they are computed in Python, with the same numbers. Of a user's
    actuator, the first run that fails before LONGEST_DIAGNOSIS has an error that names the line of the file. Raises
    EmcasError for an unknown `kernel`, and for ``compiled`` without a compiler.
    """
    if kernel not in KERNELS:
        raise EmcasError(f"kernel {kernel}: there is {', '.join(KERNELS)}")
    count, rows, points = compiled.table_shape(sets, inputs, model, held)
    steps = library.milliseconds(count * points, step)
    by_machine = kernel == "compiled" or (kernel == "auto" and library.worth(model, steps) and library.available(model))
    run_tables = compiled.run_tables if by_machine else _by_python
    if len(sets) and rows:
        trial.try_out(model, sets[0], inputs, 500 if by_machine else 100, run_tables, _by_python)
    tables = run_tables(sets, inputs, step, outputs, model, held, fine, spring)
    run = next((run for run, error in tables.failures.items() if isinstance(error, ArithmeticError)
                and tables.reached[run] * step < LONGEST_DIAGNOSIS), None)
    if run is not None and get(model).source is not None:
        chosen = [column[run % len(column)] if np.ndim(column) == 2 else column for column in inputs]
        springs = np.broadcast_to(spring, count)
        again = _by_python(sets[[run % len(sets)]], chosen, step, (), model, held, (), springs[run],
                           diagnosis.functions)
        error = tables.failures[run] if by_machine else ArithmeticError(f"{tables.failures[run]}{_UNCHOSEN}")
        tables.failures[run] = again.failures.get(0, error)
    return tables


def _check_finite(table: Array, inputs: Sequence[Variable], step: float) -> None:
    bad = np.argwhere(~np.isfinite(table))
    if len(bad):
        row, column = bad[0]
        raise ValueError(f"input {inputs[column].name} is {table[row, column]} at {row * step:.6g} s")


def _by_python(sets: Array, inputs: Sequence[Array], step: float, outputs: Sequence[str], model: str, held: int,
               fine: Collection[str], spring: Array | float,
               bind: Callable[..., Functions] = codegen.bound_functions) -> compiled.Tables:
    actuator = get(model)
    index = {v.name: i for i, v in enumerate(actuator.outputs)}
    count, rows, points = compiled.table_shape(sets, inputs, model, held)
    springs = np.broadcast_to(spring, count).tolist()
    out = np.full((len(actuator.outputs), count, points), np.nan)
    reached = np.zeros(count, dtype=np.int64)
    failures: dict[int, ValueError | ArithmeticError] = {}
    for run in range(count):
        values = dict(zip((v.name for v in actuator.parameters), sets[run % len(sets)].tolist(), strict=True))
        table = np.stack([np.broadcast_to(column, (count, rows))[run] for column in inputs], axis=1)
        try:
            _check_finite(table, actuator.inputs, held * step)
            require_sound(values, model)
        except ValueError as error:
            failures[run] = error
            continue
        try:
            core = codegen.core(values, model, bind)
            now: Any = ()
            acting: Any = ()
            for k in range(points):
                if k:
                    now = core.run(k * step, acting)
                if k % held == 0:
                    acting = codegen.core_inputs(core, table[k // held].tolist(), actuator)
                if k == 0:
                    now = core.outputs(acting)
                if springs[run] and k % held == 0:
                    command, load, *others = acting
                    acting = (command, load - springs[run] * now[index["fin_angle"]], *others)
                out[:, run, k] = now
                reached[run] = k + 1
        except (ArithmeticError, ValueError) as error:  # a ValueError is a root of a negative number
            failures[run] = ArithmeticError(f"at {reached[run] * step:.6g} s: {error}")
    return compiled.Tables({name: np.ascontiguousarray(out[index[name]][:, ::1 if name in fine else held])
                            for name in outputs}, reached, failures)
