"""The kernel and its stepping as machine code, compiled on first use and kept in the user's cache."""

from __future__ import annotations

import ctypes as ct
import hashlib
import os
import warnings
from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from platformdirs import user_cache_path

from ..compiler import FLAGS, CompilerError, any_local, local_platform
from ..variables import INPUTS, OUTPUTS, PARAMETERS
from . import core
from .c_sources import core_sources, written

_MAIN = "batch.c"
_DOUBLES = ct.POINTER(ct.c_double)
_REASONS = ("", "the state is no longer finite", f"more than {core.MOST_EVENTS} events in a tick",
            f"more than {core.MOST_TICKS} ticks in one step")
_FLAGS = {i for i, v in enumerate(OUTPUTS) if v.kind == "Boolean"}
Array = NDArray[Any]


@cache
def library() -> ct.CDLL | None:
    """The compiled library; None, with a warning, where it cannot be made."""
    target, compiler = local_platform(), any_local()
    if target is None or compiler is None:
        return None
    sources = {_MAIN: written(_MAIN), **core_sources()}
    described = "\0".join([compiler.version, target.name, *FLAGS, *(f"{n}\0{t}" for n, t in sorted(sources.items()))])
    # A rebuilt library at the same path would give the old one to a process that has it loaded.
    name = f"kernel_{hashlib.sha256(described.encode()).hexdigest()[:20]}{target.suffix}"
    path = user_cache_path("emcas") / name
    try:
        if not path.is_file():
            path.parent.mkdir(parents=True, exist_ok=True)
            partial = path.with_name(f".{name}.{os.getpid()}.part")
            partial.write_bytes(compiler.library(sources, _MAIN, target, "kernel"))
            partial.replace(path)  # whole or not at all, whoever else is compiling
        loaded = ct.CDLL(str(path))
    except (OSError, CompilerError) as error:
        warnings.warn(f"no compiled kernel, Python is used instead: {error}", RuntimeWarning, stacklevel=2)
        return None
    loaded.actuator_size.restype = loaded.actuator_state.restype = ct.c_size_t
    loaded.actuators_run.restype = loaded.actuator_simulate.restype = ct.c_size_t
    for function in ("bind", "start"):
        getattr(loaded, f"actuator_{function}").argtypes = [ct.c_void_p, _DOUBLES]
    for function in ("forces", "outputs"):
        getattr(loaded, f"actuator_{function}").argtypes = [ct.c_void_p, _DOUBLES, _DOUBLES]
    loaded.actuator_schedule.argtypes = [ct.c_void_p, _DOUBLES]
    loaded.actuator_run.argtypes = [ct.c_void_p, ct.c_double, _DOUBLES, _DOUBLES, _DOUBLES]
    loaded.actuators_run.argtypes = [ct.c_void_p, ct.c_size_t, ct.c_double, ct.c_void_p, ct.c_void_p, ct.c_void_p]
    loaded.actuator_simulate.argtypes = [ct.c_void_p, ct.c_size_t, ct.c_double, ct.c_void_p, ct.c_void_p, ct.c_void_p]
    return loaded


def available() -> bool:
    """Whether there is a compiled kernel on this machine; compiles it if need be."""
    return library() is not None


def _loaded() -> ct.CDLL:
    found = library()
    if found is None:
        raise CompilerError("no compiled kernel: install a C compiler, or ziglang with  "
                            "pip install 'emcas-fmu[native]'")
    return found


def _numbers(values: Mapping[str, Any]) -> ct.Array[ct.c_double]:
    return (ct.c_double * len(PARAMETERS))(*(float(values[v.name]) for v in PARAMETERS))


class CompiledCore:
    """:class:`emcas_fmu.kernels.core.Core` in machine code: the same methods and, on one C library, the same bits.

    `values` are the flat parameters in SI. `state` is a string of bytes.
    Raises CompilerError where there is no compiled kernel.
    """

    def __init__(self, values: Mapping[str, Any]) -> None:
        self._library = _loaded()
        self._memory = ct.create_string_buffer(self._library.actuator_size())
        self._at = ct.addressof(self._memory)
        size = ct.c_size_t()
        self._state = self._library.actuator_state(ct.byref(size))
        self._state_size = size.value
        self._in, self._out = (ct.c_double * 6)(), (ct.c_double * len(OUTPUTS))()
        self._library.actuator_start(self._at, _numbers(values))
        self.schedule = self._scheduled()

    def _scheduled(self) -> tuple[Any, ...]:
        plan = (ct.c_double * 8)()
        self._library.actuator_schedule(self._at, plan)
        period, before, after, *rest = plan
        return (period, int(before), int(before) + int(after), *rest)

    @property
    def state(self) -> bytes:
        """Everything that changes while running."""
        return self._memory.raw[self._state:self._state + self._state_size]

    @state.setter
    def state(self, state: bytes) -> None:
        if len(state) != self._state_size:
            raise ValueError(f"a state has {self._state_size} bytes, not {len(state)}")
        ct.memmove(self._at + self._state, state, self._state_size)

    @property
    def slack(self) -> float:
        """Tolerance of communication points [s]."""
        slack: float = self.schedule[-1]
        return slack

    def bind(self, values: Mapping[str, Any]) -> None:
        """Take parameter values, anew after a tunable one changed."""
        self._library.actuator_bind(self._at, _numbers(values))

    def forces(self, *arguments: float) -> tuple[float, float]:
        """Specific force in the fin's frame from acceleration (x, y, z), roll and pitch."""
        out = (ct.c_double * 2)()
        self._library.actuator_forces(self._at, (ct.c_double * 5)(*arguments), out)
        return out[0], out[1]

    def outputs(self, inputs: core.Inputs) -> tuple[Any, ...]:
        """Outputs in the order of the variable table."""
        self._in[:] = list(inputs)
        self._library.actuator_outputs(self._at, self._in, self._out)
        return self._results()

    def run(self, end: float, inputs: core.Inputs, ramp: core.Ramp | None = None) -> tuple[Any, ...]:
        """Move on to `end` [s] from the start; see :meth:`emcas_fmu.kernels.core.Core.run`."""
        self._in[:] = list(inputs)
        change = None if ramp is None else (ct.c_double * 6)(ramp[0], *ramp[1])
        result = self._library.actuator_run(self._at, end, self._in, change, self._out)
        if result:
            raise ArithmeticError(_REASONS[result])
        return self._results()

    def _results(self) -> tuple[Any, ...]:
        return tuple(x != 0.0 if i in _FLAGS else x for i, x in enumerate(self._out))


class Batch:
    """Many actuators side by side, each with its own parameters and inputs.

    `sets` are flat parameter mappings in SI, one for each actuator. Instances may be
    stepped from several threads at once: a call gives up the interpreter's lock.
    Raises CompilerError where there is no compiled kernel.
    """

    def __init__(self, sets: Sequence[Mapping[str, Any]]) -> None:
        if not sets:
            raise ValueError("a batch has at least one actuator")
        self._library = _loaded()
        self._size = self._library.actuator_size()
        self._memory = ct.create_string_buffer(self._size * len(sets))
        self._at = ct.addressof(self._memory)
        self.count = len(sets)
        self.outputs: Array = np.empty((self.count, len(OUTPUTS)))
        self._results = np.zeros(self.count, dtype=np.intc)
        self.restart(sets)

    def restart(self, sets: Sequence[Mapping[str, Any]]) -> None:
        """Put every actuator at rest at its start, with these parameters."""
        if len(sets) != self.count:
            raise ValueError(f"{len(sets)} parameter sets for {self.count} actuators")
        for i, values in enumerate(sets):
            self._library.actuator_start(self._at + i * self._size, _numbers(values))

    def run(self, end: float, inputs: Array) -> Array:
        """Move every actuator on to `end` [s] from the start with its inputs held.

        `inputs` has a row for each actuator and a column for each input of the variable
        table, in SI; the result likewise for the outputs, and is overwritten by the next call.
        Raises ArithmeticError naming the actuators that cannot be followed; these stay where they were.
        """
        rows = np.ascontiguousarray(inputs, dtype=np.float64)
        if rows.shape != (self.count, len(INPUTS)):
            raise ValueError(f"inputs have shape {rows.shape}, not {(self.count, len(INPUTS))}")
        if not np.isfinite(rows).all():
            actuator, column = np.argwhere(~np.isfinite(rows))[0]
            raise ValueError(f"actuator {actuator}: {INPUTS[column].name} = {rows[actuator, column]} is not finite")
        failed = self._library.actuators_run(self._at, self.count, end, rows.ctypes.data, self.outputs.ctypes.data,
                                             self._results.ctypes.data)
        if failed:
            which = np.flatnonzero(self._results)
            listed = ", ".join(map(str, which[:10])) + (", ..." if len(which) > 10 else "")
            raise ArithmeticError(f"actuators {listed}: {_REASONS[self._results[which[0]]]}")
        return self.outputs


def run_table(values: Mapping[str, Any], step: float, inputs: Array) -> Array:
    """Outputs at the times of the rows of `inputs`, `step` [s] apart from 0, each row held until the next.

    Columns as the inputs and outputs of the variable table, in SI. Raises ArithmeticError
    where the equations cannot be followed, CompilerError where there is no compiled kernel.
    """
    found = _loaded()
    memory = ct.create_string_buffer(found.actuator_size())
    found.actuator_start(ct.addressof(memory), _numbers(values))
    rows = np.ascontiguousarray(inputs, dtype=np.float64)
    outputs: Array = np.empty((len(rows), len(OUTPUTS)))
    result = ct.c_int(0)
    reached = found.actuator_simulate(ct.addressof(memory), len(rows), step, rows.ctypes.data, outputs.ctypes.data,
                                      ct.addressof(result))
    if reached < len(rows):
        raise ArithmeticError(f"at {reached * step:.6g} s: {_REASONS[result.value]}")
    return outputs


