"""Running the actuator in this process, without an FMU."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from functools import partial
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from .actuators import NONLINEAR, get
from .errors import EmcasError
from .fmi.interface import MIXING, FmuInterface, start_values
from .parameters import ParameterError, check_parameters, require_sound
from .rules import check_ranges
from .runtime import codegen, compiled, library
from .variables import Variable

T = TypeVar("T")

Array = NDArray[Any]
Signal = float | bool | Sequence[float] | Array | Callable[[float], float | bool]
KERNELS = ("auto", "compiled", "python")
MOST_POINTS = 10_000_000  # the outputs of more would not fit in memory


def simulate(values: Mapping[str, Any], stop: float, step: float = 1e-3, kernel: str = "auto",
             model: str = NONLINEAR, **inputs: Signal) -> dict[str, Array]:
    """Return outputs of the actuator at its communication points, from 0 to `stop` [s] every `step` [s].

    `values` are the flat parameters in SI. Inputs are given by name with ``__`` for the
    dot (``attitude__roll``), as a constant, a function of time [s] or an array of values at
    the communication points, held over a step. `kernel` is ``compiled``, ``python``, or ``auto``: compiled if there
    is a C compiler and 10 s of responses are asked for, or 1 s where it has been compiled before; both give the same
    numbers. `model` is one of :mod:`emcas_fmu.actuators`, whose parameters `values` must have.
    Gives an array per output and ``time``. Raises TypeError for an unknown input, ValueError for one
    that is not finite and for parameters out of their limits, ArithmeticError where the equations
    cannot be followed.
    """
    there_are = get(model).inputs
    starts = [v.initial(values) for v in there_are]
    return respond(values, _table(there_are, starts, stop, step, inputs), step, kernel, model)


def simulate_fins(sets: Sequence[Mapping[str, Any]], stop: float, step: float = 1e-3, model: str = NONLINEAR,
                  line: Mapping[str, float] | None = None, **inputs: Signal) -> dict[str, Array]:
    """Return the outputs of several actuators, of parameters `sets`, on one line, by the names of a unit of them.

    As `simulate`, but in Python, which is slower. `line` are parameters of the line that feeds them
    (``bus.source_resistance``, ``line.accumulator_volume``). An input of a single actuator, such as ``fin_command``, is
    that of every fin; of one it is given as ``**{"fin[2].fin_command": ...}``. Raises as `simulate` does.
    """
    unit = FmuInterface(len(sets), model)
    if unit.fins == 1:
        raise ValueError("one fin shares no line; see simulate()")
    problems = [f"fin {k}: {problem}" for k, values in enumerate(sets, 1)
                for problem in check_parameters(values, model)]
    starts = dict(zip((v.name for v in unit.variables), start_values(unit, sets), strict=True))
    there_are = unit.line.parameters if unit.line else ()
    values_of_line = {v.name: starts[v.name] for v in there_are}
    if unknown := [name for name in line or {} if name not in values_of_line]:
        raise EmcasError(f"there is no {unknown[0]}; the {unit.line.name} has {', '.join(values_of_line)}" if unit.line
                         else f"{unknown[0]}: {unit.actuator.name} has no supply, so that its fins share no line")
    values_of_line |= line or {}
    problems += check_ranges(values_of_line, [(v.name, v.minimum, v.maximum) for v in there_are])
    if problems:
        raise ParameterError(problems)
    table = _table(unit.inputs, [starts[v.name] for v in unit.inputs], stop, step, spread(inputs, unit))
    _check_finite(table, unit.inputs, step)
    cores = codegen.multi_fin(sets, list(values_of_line.values()), model)
    mixing = [unit.reference[v.name] for v in MIXING]

    def arranged(row: Sequence[float]) -> Sequence[tuple[Any, ...]]:
        fins = [[row[i] for i in places] for places in unit.places]
        return cores.acting(fins, cores.motion_loads(*fins[0][codegen.MOTION]), [row[i] for i in mixing])

    rows = np.array(list(_rows(cores, table, step, arranged)), dtype=float)
    return {"time": np.arange(len(table)) * step, **{v.name: rows[:, i].copy() for i, v in enumerate(unit.outputs)}}


def spread(inputs: Mapping[str, T], unit: FmuInterface) -> dict[str, T]:
    """Return inputs by the names of a unit: what is a single actuator's there is every fin's."""
    there_are, of_one = {v.name for v in unit.inputs}, {v.name for v in unit.actuator.inputs}
    by_name: dict[str, T] = {}
    for name, signal in inputs.items():
        known = name.replace("__", ".")
        several = known not in there_are and known in of_one
        by_name |= {unit.name(known, fin): signal for fin in range(unit.fins)} if several else {known: signal}
    return by_name


def _table(there_are: Sequence[Variable], starts: Sequence[Any], stop: float, step: float,
           inputs: Mapping[str, Signal]) -> Array:
    """Return the inputs at the communication points, a column each; those not given at their start value."""
    if not (0.0 < step < np.inf and step * 0.5 <= stop <= MOST_POINTS * step):
        raise ValueError(f"from 0 to {stop} s every {step} s: both must be above 0, with 1 to {MOST_POINTS:g} steps")
    times: Array = np.arange(round(stop / step) + 1) * step
    index = {v.name: i for i, v in enumerate(there_are)}
    table = np.empty((len(times), len(there_are)))
    table[:] = starts
    for name, signal in inputs.items():
        known = name.replace("__", ".")
        if known not in index:
            raise TypeError(f"there is no input {known!r}; inputs are {', '.join(index)}")
        # What is given at the last point acts nowhere.
        column = table[:, index[known]]
        column[:-1] = [signal(t) for t in times[:-1]] if callable(signal) else _held(signal, known, times)
        column[-1] = column[-2]
    return table


def _held(signal: float | Sequence[float] | Array, name: str, times: Array) -> Any:
    given = np.asarray(signal, dtype=float)
    if given.shape not in ((), times.shape):
        raise ValueError(f"input {name} has shape {given.shape}, not that of the {len(times)} communication points")
    return given[:-1] if given.shape else given


def respond(values: Mapping[str, Any], table: Array, step: float, kernel: str = "auto",
            model: str = NONLINEAR, outputs: Collection[str] | None = None) -> dict[str, Array]:
    """Return outputs at the times of the rows of `table`, `step` [s] apart from 0, each row held until the next.

    The table's columns are the inputs of the variable table, in SI. All outputs unless they are named; see
    :func:`simulate` for the rest.
    """
    names = [v.name for v in get(model).outputs if outputs is None or v.name in outputs]
    sets = compiled.parameter_row(values, model)[np.newaxis]
    columns = respond_all(sets, list(table.T), step, names, kernel, model).finished()
    return {"time": np.arange(len(table)) * step, **{name: column[0] for name, column in columns.items()}}


def respond_all(sets: Array, inputs: Sequence[Array], step: float, outputs: Sequence[str], kernel: str = "auto",
                model: str = NONLINEAR, held: int = 1, fine: Collection[str] = ()) -> compiled.Tables:
    """Return the outputs of many actuators; see :func:`emcas_fmu.runtime.compiled.run_tables`.

    Without a compiled kernel they run in Python, and give the same numbers.
    """
    if kernel not in KERNELS:
        raise EmcasError(f"kernel {kernel}: there is {', '.join(KERNELS)}")
    count, _, points = compiled.table_shape(sets, inputs, model, held)
    steps = library.milliseconds(count * points, step)
    if kernel == "compiled" or (kernel == "auto" and library.worth(model, steps) and library.available(model)):
        return compiled.run_tables(sets, inputs, step, outputs, model, held, fine)
    return _by_python(sets, inputs, step, outputs, model, held, fine)


def _check_finite(table: Array, inputs: Sequence[Variable], step: float) -> None:
    bad = np.argwhere(~np.isfinite(table))
    if len(bad):
        row, column = bad[0]
        raise ValueError(f"input {inputs[column].name} is {table[row, column]} at {row * step:.6g} s")


class SteppedUnit:
    """An actuator moved on by steps of `step` [s] under inputs that may depend on its outputs; compiled if it can be.

    `inputs` are those at its start by name, the others at their start values. Raises ParameterError.
    """

    def __init__(self, values: Mapping[str, Any], step: float, model: str = NONLINEAR,
                 inputs: Mapping[str, float] | None = None) -> None:
        actuator = get(model)
        self._core: Any
        if library.available(model):
            self._core = compiled.CompiledCore(values, model)  # checks for itself
        else:
            self._core = _python_core(values, model)
        self._model, self._step = model, step
        self._row = [v.initial(values) for v in actuator.inputs]
        self._inputs = {v.name: i for i, v in enumerate(actuator.inputs)}
        self._names = tuple(v.name for v in actuator.outputs)
        self._set(inputs or {})
        self._rows: list[tuple[Any, ...]] = [self._core.outputs(self._acting)]

    def _set(self, inputs: Mapping[str, float]) -> None:
        for name, value in inputs.items():
            self._row[self._inputs[name]] = value
        self._acting = codegen.core_inputs(self._core, self._row, self._model)

    def place(self, output: str) -> int:
        """Return where an output stands in what `now` and `run` give."""
        return self._names.index(output)

    @property
    def now(self) -> tuple[Any, ...]:
        """The outputs at the present time."""
        return self._rows[-1]

    def run(self, **inputs: float) -> tuple[Any, ...]:
        """Return the outputs a step later; inputs that are not given stay as they were. Raises ArithmeticError."""
        if inputs:
            self._set(inputs)
        time = len(self._rows) * self._step
        try:
            self._rows.append(self._core.run(time, self._acting))
        except ArithmeticError as error:
            raise ArithmeticError(f"at {time:.6g} s: {error}") from error
        return self.now

    def columns(self) -> dict[str, Array]:
        """Return all outputs so far by name, with ``time`` [s]."""
        table = np.array(self._rows, dtype=float)
        return {"time": np.arange(len(table)) * self._step,
                **{name: table[:, i] for i, name in enumerate(self._names)}}


def _python_core(values: Mapping[str, Any], model: str) -> Any:
    # NumPy's numbers are slower, and what comes of comparing them is no Python bool.
    plain = {name: value.item() if isinstance(value, np.generic) else value for name, value in values.items()}
    require_sound(plain, model)
    return codegen.core(plain, model)


def _by_python(sets: Array, inputs: Sequence[Array], step: float, outputs: Sequence[str], model: str, held: int,
               fine: Collection[str]) -> compiled.Tables:
    actuator = get(model)
    count, rows, points = compiled.table_shape(sets, inputs, model, held)
    out = np.full((len(actuator.outputs), count, points), np.nan)
    reached = np.zeros(count, dtype=np.int64)
    failures: dict[int, ValueError | ArithmeticError] = {}
    for run in range(count):
        values = dict(zip((v.name for v in actuator.parameters), sets[run % len(sets)].tolist(), strict=True))
        table = np.stack([np.broadcast_to(column, (count, rows))[run] for column in inputs], axis=1)
        table = np.repeat(table, held, axis=0)[:points]
        try:
            _check_finite(table, actuator.inputs, step)
            core = _python_core(values, model)
            for row in _rows(core, table, step, partial(codegen.core_inputs, core, model=model)):
                out[:, run, reached[run]] = row
                reached[run] += 1
        except ArithmeticError as error:
            failures[run] = ArithmeticError(f"at {reached[run] * step:.6g} s: {error}")
        except ValueError as error:
            failures[run] = error
    places = {v.name: i for i, v in enumerate(actuator.outputs)}
    return compiled.Tables({name: np.ascontiguousarray(out[places[name]][:, ::1 if name in fine else held])
                            for name in outputs}, reached, failures)


def _rows(core: Any, table: Array, step: float,
          arranged: Callable[[Sequence[float]], Any]) -> Iterator[tuple[Any, ...]]:
    """Give outputs of a core, or of those of several fins, at each row; `arranged` gives what it takes of one."""
    acting: Any = ()
    for k, row in enumerate(table.tolist()):
        if k:
            yield core.run(k * step, acting)
        acting = arranged(row)
        if not k:
            yield core.outputs(acting)
