"""Many whole runs of an actuator in machine code, in one call."""

from __future__ import annotations

import ctypes as ct
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from math import isfinite
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..actuators import NONLINEAR, get
from ..parameters import ParameterError, check_parameters
from . import core
from .library import loaded, milliseconds, vectors
from .schedule import Schedule

REASONS = (*core.REASONS, "the parameters are refused", "an input is not finite")
"""Messages of core_result (core_state.h), then of the additional results in tables.h; the last of these has none."""
_REFUSED, _INPUT_NOT_FINITE, _ALONE = range(len(REASONS) - 2, len(REASONS) + 1)
Array = NDArray[Any]


class _InputColumn(ct.Structure):
    """The struct input_column of tables.h."""

    _fields_ = (("first", ct.c_void_p), ("run", ct.c_ssize_t), ("row", ct.c_ssize_t))


class _OutputColumn(ct.Structure):
    """The struct output_column of tables.h."""

    _fields_ = (*_InputColumn._fields_, ("index", ct.c_size_t), ("every", ct.c_size_t))


class _RunTables(ct.Structure):
    """The struct run_tables of tables.h."""

    _fields_ = (*((name, ct.c_size_t) for name in ("points", "held", "angle", "columns")), ("step", ct.c_double),
                *((name, ct.c_void_p) for name in ("in", "out", "spring", "reached", "result")))


@dataclass(frozen=True)
class Tables:
    """Results of many runs: `columns` by output, in SI, with NaN at points that a run did not reach.

    A column is an array [runs, rows], or [runs, points of time] for an output in `fine` of :func:`run_tables`.
    `reached` is the number of points of time that each run reached, including the start. `failures` maps the index of
    an incomplete run to the error that the same run would raise on its own.
    """

    columns: dict[str, Array]
    reached: Array
    failures: dict[int, ValueError | ArithmeticError]

    def finished(self) -> dict[str, Array]:
        """Return the columns. Raises the error of the first incomplete run, a ValueError or ArithmeticError."""
        for failure in self.failures.values():
            raise failure
        return self.columns


@cache
def _names(model: str) -> tuple[dict[str, None], frozenset[str]]:
    """Return the names of a model's parameters, in their order, and all names that a parameter file may contain."""
    actuator = get(model)
    return dict.fromkeys(v.name for v in actuator.parameters), frozenset(v.name for v in actuator.file_entries)


def parameter_row(values: Mapping[str, Any], model: str = NONLINEAR) -> Array:
    """Return a model's parameters as an array [parameters] in their order, from values by name in SI.

    Raises ParameterError for wrong names, TypeError if `values` is not a mapping.
    """
    if not isinstance(values, Mapping):
        raise TypeError(f"parameters are a mapping of names to values in SI (.values of a set), not a "
                        f"{type(values).__name__}")
    needed, known = _names(model)
    if not needed.keys() <= values.keys() <= known:
        raise ParameterError(check_parameters(values, model))
    return np.array([float(values[name]) for name in needed])


def refusal(row: Array, model: str) -> list[str]:
    """Return the problems of a `row` of parameters that the library has refused."""
    values = dict(zip(_names(model)[0], row.tolist(), strict=True))
    return check_parameters(values, model) or [REASONS[_REFUSED]]


def run_tables(parameters: Array, inputs: Sequence[Array], step: float, outputs: Sequence[str],
               model: str = NONLINEAR, held: int = 1, fine: Collection[str] = (),
               spring: Array | float = 0.0) -> Tables:
    """Return the outputs of many actuators at the rows of their inputs; each row is held until the next.

    `parameters` is an array [runs, parameters] with rows of :func:`parameter_row`, or [1, parameters] for all runs.
    `inputs` contains for each input, in the interface's order, an array in SI that broadcasts to [runs, rows]; arrays
    of doubles are not copied. From one row to the next a run makes `held` steps of `step` [s]. `outputs` are returned
    at the rows, those in `fine` at every step. A run that fails does not affect the others. A `spring` [N.m/rad], a
    number or an array [runs], subtracts its stiffness times the fin angle at a row from the row's aero_torque. Raises
    ValueError for shapes that do not match, CompilerError if no kernel can be compiled.
    """
    actuator = get(model)
    sets: Array = np.ascontiguousarray(parameters, dtype=np.float64)
    columns = [doubles(column) for column in inputs]
    count, rows, points = table_shape(sets, columns, model, held)
    index = {v.name: i for i, v in enumerate(actuator.outputs)}
    out = {name: np.full((count, points if name in fine else rows), np.nan) for name in outputs}
    reached, results = np.zeros(count, dtype=np.int64), np.full(count, _ALONE, dtype=np.intc)
    springs = np.array(np.broadcast_to(spring, count), dtype=float) if np.any(spring) else None
    read = (_InputColumn * len(columns))(*(_InputColumn(*_layout(column)) for column in columns))
    written = (_OutputColumn * len(out))(*(_OutputColumn(*_layout(column), index[name], 1 if name in fine else held)
                                           for name, column in out.items()))
    tables = _RunTables(points, held, index["fin_angle"], len(out), step, ct.addressof(read), ct.addressof(written),
                        None if springs is None else address(springs), address(reached), address(results))
    one = loaded(model)
    prepared = prepare(one, sets)
    results[np.broadcast_to(prepared.refused, count)] = _REFUSED
    order = by_schedule(prepared.schedules) if len(sets) > 1 else np.arange(count, dtype=np.uintp)
    for library in (vectors(model, milliseconds(count * points, step)) if count > 1 else None, one):
        runs = order[results[order] == _ALONE]  # after the vectors: runs that did not stay with the others
        if library is not None and len(runs):
            library.batch_simulate(len(runs), address(runs), address(prepared.values),
                                   prepared.values.shape[1] if len(sets) > 1 else 0, ct.byref(tables))
    failures = {run: _failure(sets[run % len(sets)], columns, run, int(reached[run]), step, held, int(results[run]),
                              model) for run in np.flatnonzero(results).tolist()}
    return Tables(out, reached, failures)


def table_shape(parameters: Array, inputs: Sequence[Array], model: str, held: int) -> tuple[int, int, int]:
    """Return the numbers of runs, rows and points of time of :func:`run_tables`. Raises ValueError for wrong shapes."""
    actuator = get(model)
    if parameters.ndim != 2 or parameters.shape[1] != len(actuator.parameters):
        raise ValueError(f"parameters have shape {parameters.shape}, not (runs, {len(actuator.parameters)})")
    if len(inputs) != len(actuator.inputs):
        raise ValueError(f"there are {len(inputs)} inputs, not {len(actuator.inputs)}")
    count, rows = np.broadcast_shapes((len(parameters), 1), *map(np.shape, inputs))
    return count, rows, max((rows - 1) * held + 1, 0)


class Prepared(NamedTuple):
    """Many actuators in the form that the library needs.

    `values` [actuators, values] are their parameters and the constants computed from these, `schedules` [actuators,
    numbers of a :class:`emcas_fmu.runtime.schedule.Schedule`] their sample periods; `refused` [actuators] is true for
    actuators whose parameters break a limit or rule.
    """

    values: Array
    schedules: Array
    refused: Array


def prepare(library: ct.CDLL, parameters: Array) -> Prepared:
    """Return actuators with `parameters` [actuators, parameters] in the form that the library needs."""
    size = ct.c_size_t()
    values = np.empty((len(parameters), library.batch_values(ct.byref(size))))
    schedules = np.empty((len(parameters), size.value))
    library.batch_prepare(len(parameters), address(parameters), parameters.shape[1], address(values),
                          address(schedules))
    return Prepared(values, schedules, np.isnan(schedules[:, 0]))


def by_schedule(schedules: Array) -> Array:
    """Return the indices of actuators, ordered so that those with equal numbers of ticks and delays are neighbours."""
    plan = Schedule(*schedules.T)
    return np.lexsort((plan.late_commands, plan.delay_samples, plan.after, plan.before)).astype(np.uintp)


def longest_line(schedules: Array) -> int:
    """Return the number of values in the longest delay buffer, as core_line_length in core.h."""
    plan = Schedule(*schedules.T)
    return int(np.max(plan.delay_samples + plan.late_commands)) + 2


def _failure(parameters: Array, inputs: Sequence[Array], run: int, reached: int, step: float, held: int,
             result: int, model: str) -> ValueError | ArithmeticError:
    if result == _REFUSED:
        return ParameterError(refusal(parameters, model))
    if result == _INPUT_NOT_FINITE:
        columns = [column[min(run, len(column) - 1)] if column.ndim == 2 else column for column in inputs]
        row = [float(column[min(reached // held, len(column) - 1)] if column.ndim else column) for column in columns]
        name, value = next((v.name, x) for v, x in zip(get(model).inputs, row, strict=True) if not isfinite(x))
        return ValueError(f"input {name} is {value} at {reached * step:.6g} s")
    return ArithmeticError(f"at {reached * step:.6g} s: {REASONS[result]}")


def doubles(values: Any) -> Array:
    """Return values as an aligned array whose strides are multiples of a double's size; such an array is not copied."""
    array: Array = np.asarray(values, dtype=np.float64)
    flags = array.flags
    if not (flags.aligned and (flags.c_contiguous or not any(stride % array.itemsize for stride in array.strides))):
        array = array.copy()
    return array


def all_finite(array: Array) -> bool:
    """Return whether every value is finite; for some thousands of values twice as fast as ``isfinite(...).all()``."""
    return bool(np.count_nonzero(np.isfinite(array)) == array.size)


def address(array: Array) -> int:
    """Return the address of an array's first value."""
    return int(array.__array_interface__["data"][0])


def _layout(column: Array) -> tuple[int, int, int]:
    """Return the address of the first value and the strides [doubles] of runs and rows, 0 for a repeated value."""
    strides = [0 if n == 1 else stride // column.itemsize
               for n, stride in zip(column.shape, column.strides, strict=True)]
    run, row = [0, 0, *strides][-2:]
    return address(column), run, row
