"""Running the actuator in this process, without an FMU."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .actuators import NONLINEAR, get
from .errors import EmcasError
from .kernels import compiled, program
from .parameters import ParameterError, check_parameters

Array = NDArray[Any]
Signal = float | bool | Sequence[float] | Array | Callable[[float], float | bool]
KERNELS = ("auto", "compiled", "python")
MOST_POINTS = 10_000_000  # the outputs of more would not fit in memory


def simulate(values: Mapping[str, Any], stop: float, step: float = 1e-3, kernel: str = "auto",
             model: str = NONLINEAR, **inputs: Signal) -> dict[str, Array]:
    """Outputs of the actuator at its communication points, from 0 to `stop` [s] every `step` [s].

    `values` are the flat parameters in SI. Inputs are given by name with ``__`` for the
    dot (``attitude__roll``), as a constant, a function of time [s] or an array of values at
    the communication points, held over a step. `kernel` is ``compiled``, ``python``, or
    ``auto``: compiled if there is a C compiler; both give the same numbers. `model` is one of
    :mod:`emcas_fmu.actuators`, whose parameters `values` must have.
    Gives an array per output and ``time``. Raises TypeError for an unknown input, ValueError for one
    that is not finite and for parameters out of their limits, ArithmeticError where the equations
    cannot be followed.
    """
    if not (0.0 < step < np.inf and step * 0.5 <= stop <= MOST_POINTS * step):
        raise ValueError(f"from 0 to {stop} s every {step} s: both must be above 0, with 1 to {MOST_POINTS:g} steps")
    times: Array = np.arange(round(stop / step) + 1) * step
    there_are = get(model).inputs
    index = {v.name: i for i, v in enumerate(there_are)}
    table = np.empty((len(times), len(there_are)))
    for v, column in zip(there_are, table.T, strict=True):
        column[:] = values[v.key] if v.key else v.start or 0.0
    for name, signal in inputs.items():
        known = name.replace("__", ".")
        if known not in index:
            raise TypeError(f"there is no input {known!r}; inputs are {', '.join(index)}")
        # What is given at the last point acts nowhere.
        column = table[:, index[known]]
        column[:-1] = [signal(t) for t in times[:-1]] if callable(signal) else _held(signal, known, times)
        column[-1] = column[-2]
    return respond(values, table, step, kernel, model)


def _held(signal: float | Sequence[float] | Array, name: str, times: Array) -> Any:
    given = np.asarray(signal, dtype=float)
    if given.shape not in ((), times.shape):
        raise ValueError(f"input {name} has shape {given.shape}, not that of the {len(times)} communication points")
    return given[:-1] if given.shape else given


def respond(values: Mapping[str, Any], table: Array, step: float, kernel: str = "auto",
            model: str = NONLINEAR, outputs: Collection[str] | None = None) -> dict[str, Array]:
    """Outputs at the times of the rows of `table`, `step` [s] apart from 0, each row held until the next.

    The table's columns are the inputs of the variable table, in SI. All outputs unless they are named; see
    :func:`simulate` for the rest.
    """
    if kernel not in KERNELS:
        raise EmcasError(f"kernel {kernel}: there is {', '.join(KERNELS)}")
    bad = np.argwhere(~np.isfinite(table))
    if len(bad):
        row, column = bad[0]
        raise ValueError(f"input {get(model).inputs[column].name} is {table[row, column]} at {row * step:.6g} s")
    fast = kernel == "compiled" or (kernel == "auto" and compiled.available(model))
    rows = compiled.run_table(values, step, table, model) if fast else _by_python(values, table, step, model)
    times = np.arange(len(table)) * step
    return {"time": times, **{v.name: rows[:, i].copy() for i, v in enumerate(get(model).outputs)
                              if outputs is None or v.name in outputs}}


def _by_python(values: Mapping[str, Any], table: Array, step: float, model: str) -> Array:
    if problems := check_parameters(values, model):
        raise ParameterError(problems)
    core, places = program.core(values, model), program.places(model)
    rows: list[tuple[Any, ...]] = []
    acting: tuple[Any, ...] = ()
    for k, row in enumerate(table.tolist()):
        if k:
            rows.append(core.run(k * step, acting))
        acting = places.arrange(row, core.forces)
        if not k:
            rows.append(core.outputs(acting))
    return np.array(rows, dtype=float)
