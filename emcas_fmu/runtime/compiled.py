"""The kernel and its stepping as machine code, compiled on first use and kept in the user's cache."""

from __future__ import annotations

import ctypes as ct
import hashlib
import threading
import warnings
from collections.abc import Mapping, Sequence
from functools import cache
from math import isfinite
from pathlib import Path
from tempfile import NamedTemporaryFile
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..actuators import NONLINEAR, get
from ..compiler import FLAGS, Compiler, CompilerError, Platform, local_compilers, local_platform
from ..files import cache_directory
from ..parameters import ParameterError, check_parameters
from . import core
from .c_sources import core_sources, written

_MAIN = "batch.c"
_DOUBLES = ct.POINTER(ct.c_double)
_REASONS = ("", "the state is no longer finite", f"more than {core.MOST_EVENTS} events in a tick",
            f"more than {core.MOST_TICKS} ticks in one step")
Array = NDArray[Any]


_making = threading.Lock()
_reason = ""


def library(model: str = NONLINEAR) -> ct.CDLL | None:
    """The compiled library of a model; None where it cannot be made, with a warning if a compiler was tried."""
    with _making:  # the first use may come from several threads
        return _library(model)


@cache
def _library(model: str) -> ct.CDLL | None:
    global _reason
    target = local_platform()
    if target is None:
        _reason = "this platform is not known"
        return None
    sources = {_MAIN: written(_MAIN), **core_sources(model=model)}
    text = "\0".join([target.name, *FLAGS, *(f"{n}\0{t}" for n, t in sorted(sources.items()))])
    problems: list[str] = []
    for compiler in local_compilers():
        described = hashlib.sha256(f"{compiler.version}\0{text}".encode()).hexdigest()[:20]
        try:
            return _declared(ct.CDLL(str(_kept(described, target.suffix) or _compiled(
                compiler, sources, target, described))))
        except (OSError, CompilerError) as error:
            problems.append(str(error))
    _reason = problems[-1] if problems else ""
    if problems:
        warnings.warn(f"no compiled kernel, Python is used instead: {problems[-1]}", RuntimeWarning, stacklevel=5)
    return None


def _kept(described: str, suffix: str) -> Path | None:
    """A library compiled before, if it is still what it was: its content's hash is in its name."""
    for path in cache_directory().glob(f"kernel_{described}_*{suffix}"):
        if path.stem.endswith(hashlib.sha256(path.read_bytes()).hexdigest()[:16]):
            return path
        path.unlink(missing_ok=True)
    return None


def _compiled(compiler: Compiler, sources: Mapping[str, str], target: Platform, described: str) -> Path:
    # A rebuilt library at the same path would give the old one to a process that has it loaded.
    content = compiler.library(sources, _MAIN, target, "kernel")
    path = cache_directory() / f"kernel_{described}_{hashlib.sha256(content).hexdigest()[:16]}{target.suffix}"
    with NamedTemporaryFile(dir=path.parent, delete=False) as partial:
        partial.write(content)
    Path(partial.name).replace(path)  # whole or not at all, whoever else is compiling
    return path


def _declared(loaded: ct.CDLL) -> ct.CDLL:
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


def available(model: str = NONLINEAR) -> bool:
    """Whether there is a compiled kernel of a model on this machine; compiles it if need be."""
    return library(model) is not None


def _loaded(model: str) -> ct.CDLL:
    found = library(model)
    if found is None:
        raise CompilerError(f"no compiled kernel: {_reason}" if _reason else
                            "no compiled kernel: install a C compiler, or ziglang with  "
                            "pip install 'emcas-fmu[native]'")
    return found


def _numbers(values: Mapping[str, Any], model: str) -> ct.Array[ct.c_double]:
    if not isinstance(values, Mapping):
        raise TypeError(f"parameters are a mapping of names to values in SI (.values of a set), not a "
                        f"{type(values).__name__}")
    table = get(model).parameters
    if not _names(model) <= values.keys() <= _known(model):
        raise ParameterError(check_parameters(values, model))
    return (ct.c_double * len(table))(*(float(values[v.name]) for v in table))


@cache
def _names(model: str) -> frozenset[str]:
    return frozenset(v.name for v in get(model).parameters)


@cache
def _known(model: str) -> frozenset[str]:
    return frozenset(v.name for v in get(model).file_entries)


def _taken(answer: int, values: Mapping[str, Any], model: str) -> None:
    """The C side judges parameters by the same limits and rules; the words for it are found here."""
    if not answer:
        raise ParameterError(check_parameters(values, model) or ["the parameters are refused"])


def _table(rows: Array, shape: tuple[int, ...], what: str, model: str) -> Array:
    found: Array = np.ascontiguousarray(rows, dtype=np.float64)
    if found.shape != shape:
        raise ValueError(f"inputs have shape {found.shape}, not {shape}")
    if not np.isfinite(found).all():
        row, column = np.argwhere(~np.isfinite(found))[0]
        raise ValueError(f"{what} {row}: {get(model).inputs[column].name} = {found[row, column]} is not finite")
    return found


class CompiledCore:
    """:class:`emcas_fmu.runtime.core.Core` in machine code: the same methods and, on one C library, the same bits.

    `values` are the flat parameters in SI. `state` is a string of bytes.
    Raises CompilerError where there is no compiled kernel.
    """

    def __init__(self, values: Mapping[str, Any], model: str = NONLINEAR) -> None:
        self._library = _loaded(model)
        self._model = model
        self._memory = ct.create_string_buffer(self._library.actuator_size())
        self._at = ct.addressof(self._memory)
        size = ct.c_size_t()
        self._state = self._library.actuator_state(ct.byref(size))
        self._state_size = size.value
        chosen = get(model)
        self._in = (ct.c_double * (6 + len(chosen.further_inputs)))()
        self._out = (ct.c_double * len(chosen.outputs))()
        self._flags = {i for i, v in enumerate(chosen.outputs) if v.kind == "Boolean"}
        _taken(self._library.actuator_start(self._at, _numbers(values, model)), values, model)
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
        _taken(self._library.actuator_bind(self._at, _numbers(values, self._model)), values, self._model)

    def forces(self, a_x: float, a_y: float, a_z: float, roll: float, pitch: float) -> tuple[float, float]:
        """Specific force in the fin's frame from acceleration (x, y, z), roll and pitch."""
        out = (ct.c_double * 2)()
        self._library.actuator_forces(self._at, (ct.c_double * 5)(a_x, a_y, a_z, roll, pitch), out)
        return out[0], out[1]

    def outputs(self, inputs: core.Inputs) -> tuple[Any, ...]:
        """Outputs in the order of the variable table."""
        self._in[:] = list(inputs)
        self._library.actuator_outputs(self._at, self._in, self._out)
        return self._results()

    def run(self, end: float, inputs: core.Inputs, ramp: core.Ramp | None = None) -> tuple[Any, ...]:
        """Move on to `end` [s] from the start; see :meth:`emcas_fmu.runtime.core.Core.run`."""
        self._in[:] = list(inputs)
        change = None if ramp is None else (ct.c_double * (1 + len(ramp[1])))(ramp[0], *ramp[1])
        result = self._library.actuator_run(self._at, end, self._in, change, self._out)
        if result:
            raise ArithmeticError(_REASONS[result])
        return self._results()

    def _results(self) -> tuple[Any, ...]:
        return tuple(x != 0.0 if i in self._flags else x for i, x in enumerate(self._out))


class Batch:
    """Many actuators side by side, each with its own parameters and inputs.

    `sets` are flat parameter mappings in SI, one for each actuator. Instances may be
    stepped from several threads at once: a call gives up the interpreter's lock.
    Raises CompilerError where there is no compiled kernel.
    """

    def __init__(self, sets: Sequence[Mapping[str, Any]], model: str = NONLINEAR) -> None:
        if not sets:
            raise ValueError("a batch has at least one actuator")
        self._library = _loaded(model)
        self._model = model
        self._size = self._library.actuator_size()
        self._memory = ct.create_string_buffer(self._size * len(sets))
        self._at = ct.addressof(self._memory)
        self.count = len(sets)
        self.outputs: Array = np.empty((self.count, len(get(model).outputs)))
        self._results = np.zeros(self.count, dtype=np.intc)
        self.restart(sets)

    def restart(self, sets: Sequence[Mapping[str, Any]]) -> None:
        """Put every actuator at rest at its start, with these parameters."""
        if len(sets) != self.count:
            raise ValueError(f"{len(sets)} parameter sets for {self.count} actuators")
        for i, values in enumerate(sets):
            answer = self._library.actuator_start(self._at + i * self._size, _numbers(values, self._model))
            _taken(answer, values, self._model)

    def run(self, end: float, inputs: Array) -> Array:
        """Move every actuator on to `end` [s] from the start with its inputs held.

        `inputs` has a row for each actuator and a column for each input of the variable
        table, in SI; the result likewise for the outputs, and is overwritten by the next call.
        Raises ArithmeticError naming the actuators that cannot be followed; these stay where they were.
        """
        rows = _table(inputs, (self.count, len(get(self._model).inputs)), "actuator", self._model)
        if not isfinite(end):
            raise ValueError(f"the time to move on to is {end} s")
        failed = self._library.actuators_run(self._at, self.count, end, rows.ctypes.data, self.outputs.ctypes.data,
                                             self._results.ctypes.data)
        if failed:
            which = np.flatnonzero(self._results)
            listed = ", ".join(map(str, which[:10])) + (", ..." if len(which) > 10 else "")
            raise ArithmeticError(f"actuators {listed}: {_REASONS[self._results[which[0]]]}")
        return self.outputs


def run_table(values: Mapping[str, Any], step: float, inputs: Array, model: str = NONLINEAR) -> Array:
    """Outputs at the times of the rows of `inputs`, `step` [s] apart from 0, each row held until the next.

    Columns as the inputs and outputs of the variable table, in SI. Raises ArithmeticError
    where the equations cannot be followed, CompilerError where there is no compiled kernel.
    """
    found = _loaded(model)
    rows = _table(inputs, (len(inputs), len(get(model).inputs)), "row", model)
    memory = ct.create_string_buffer(found.actuator_size())
    _taken(found.actuator_start(ct.addressof(memory), _numbers(values, model)), values, model)
    outputs: Array = np.empty((len(rows), len(get(model).outputs)))
    result = ct.c_int(0)
    reached = found.actuator_simulate(ct.addressof(memory), len(rows), step, rows.ctypes.data, outputs.ctypes.data,
                                      ct.addressof(result))
    if reached < len(rows):
        raise ArithmeticError(f"at {reached * step:.6g} s: {_REASONS[result.value]}")
    return outputs


