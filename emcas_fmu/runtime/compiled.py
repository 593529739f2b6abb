"""The kernel and its stepping as machine code, compiled on first use and kept in the user's cache."""

from __future__ import annotations

import ctypes as ct
import hashlib
import threading
import warnings
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from math import isfinite
from pathlib import Path
from tempfile import NamedTemporaryFile
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..actuators import NONLINEAR, get
from ..actuators.fin_port import MOTION
from ..compiler import FLAGS, Compiler, CompilerError, Platform, local_compilers, local_platform
from ..files import cache_directory
from ..parameters import ParameterError, check_parameters
from ..physics.loads import LOADS, Carried
from ..progress import LOG
from . import core
from .c_sources import core_sources, handwritten

_MAIN = "batch.c"
_DOUBLES = ct.POINTER(ct.c_double)
REASONS = ("", "the state is no longer finite", f"more than {core.MOST_EVENTS} events in a tick",
            f"more than {core.MOST_TICKS} ticks in one step")
Array = NDArray[Any]


_making = threading.Lock()


@cache
def _sources(model: str) -> Mapping[str, str]:
    return {_MAIN: handwritten(_MAIN), **core_sources(model=model)}


def _described(compiler: Compiler, target: Platform, model: str) -> str:
    """Return a hash of all that a library depends on."""
    text = "\0".join([target.name, *FLAGS, *(f"{n}\0{t}" for n, t in sorted(_sources(model).items()))])
    return hashlib.sha256(f"{compiler.version}\0{text}".encode()).hexdigest()[:20]


@cache
def _library(model: str) -> ct.CDLL | str:
    """Return the compiled library of a model, or why there is none, with a warning if a compiler was tried."""
    target = local_platform()
    if target is None:
        return "this platform is not known"
    problem = ""
    for compiler in local_compilers():
        described = _described(compiler, target, model)
        try:
            path = _cached(described, target.suffix) or _compile(compiler, _sources(model), target, described, model)
            return _declare(ct.CDLL(str(path)))
        except (OSError, CompilerError) as error:
            problem = str(error)
    if problem:
        warnings.warn(f"no compiled kernel, Python is used instead: {problem}", RuntimeWarning, stacklevel=5)
    return problem or "install a C compiler, or ziglang with  pip install 'emcas-fmu[native]'"


def _loaded(model: str) -> ct.CDLL:
    with _making:  # the first use may come from several threads
        library = _library(model)
    if isinstance(library, str):
        raise CompilerError(f"no compiled kernel: {library}")
    return library


def available(model: str = NONLINEAR) -> bool:
    """Return whether there is a compiled kernel of a model on this machine; compile it if need be."""
    try:
        _loaded(model)
    except CompilerError:
        return False
    return True


def kept(model: str = NONLINEAR) -> bool:
    """Return whether a model's kernel has been compiled on this machine before."""
    target, compiler = local_platform(), next(local_compilers(), None)
    if target is None or compiler is None:
        return False
    return _cached(_described(compiler, target, model), target.suffix) is not None


def _cached(described: str, suffix: str) -> Path | None:
    """Return a library compiled before, if it is still what it was: its content's hash is in its name."""
    for path in cache_directory().glob(f"kernel_{described}_*{suffix}"):
        if path.stem.endswith(hashlib.sha256(path.read_bytes()).hexdigest()[:16]):
            return path
        path.unlink(missing_ok=True)
    return None


def _compile(compiler: Compiler, sources: Mapping[str, str], target: Platform, described: str,
             model: str) -> Path:
    LOG.info(f"compiling the actuator {model} (once, up to a minute) ...")
    # A rebuilt library at the same path would give the old one to a process that has it loaded.
    content = compiler.library(sources, _MAIN, target, "kernel")
    path = cache_directory() / f"kernel_{described}_{hashlib.sha256(content).hexdigest()[:16]}{target.suffix}"
    with NamedTemporaryFile(dir=path.parent, delete=False) as partial:
        partial.write(content)
    Path(partial.name).replace(path)  # whole or not at all, whoever else is compiling
    return path


def _declare(loaded: ct.CDLL) -> ct.CDLL:
    loaded.actuator_size.restype = loaded.actuator_state.restype = ct.c_size_t
    loaded.actuators_run.restype = loaded.actuator_simulate.restype = ct.c_size_t
    for function in ("bind", "start"):
        getattr(loaded, f"actuator_{function}").argtypes = [ct.c_void_p, _DOUBLES]
    for function in ("carried", "outputs"):
        getattr(loaded, f"actuator_{function}").argtypes = [ct.c_void_p, _DOUBLES, _DOUBLES]
    loaded.actuator_run.argtypes = [ct.c_void_p, ct.c_double, _DOUBLES, _DOUBLES, _DOUBLES]
    loaded.actuators_run.argtypes = [ct.c_void_p, ct.c_size_t, ct.c_double, ct.c_void_p, ct.c_void_p, ct.c_void_p]
    loaded.actuator_simulate.argtypes = [ct.c_void_p, ct.c_size_t, ct.c_double, ct.c_void_p, ct.c_void_p, ct.c_void_p]
    return loaded


def _numbers(values: Mapping[str, Any], model: str) -> ct.Array[ct.c_double]:
    if not isinstance(values, Mapping):
        raise TypeError(f"parameters are a mapping of names to values in SI (.values of a set), not a "
                        f"{type(values).__name__}")
    needed, known = _names(model)
    if not needed.keys() <= values.keys() <= known:
        raise ParameterError(check_parameters(values, model))
    return (ct.c_double * len(needed))(*(float(values[name]) for name in needed))


@cache
def _names(model: str) -> tuple[dict[str, None], frozenset[str]]:
    """Return the names of a model's parameters, in their order, and of all that a parameter file may give."""
    actuator = get(model)
    return dict.fromkeys(v.name for v in actuator.parameters), frozenset(v.name for v in actuator.file_entries)


def _take(function: Callable[..., int], memory: int, values: Mapping[str, Any], model: str) -> None:
    """Hand parameters to the C side, which judges them by the same limits and rules; the words are found here."""
    if not function(memory, _numbers(values, model)):
        raise ParameterError(check_parameters(values, model) or ["the parameters are refused"])


def _table(rows: Array, shape: tuple[int, ...], what: str, model: str) -> Array:
    table: Array = np.ascontiguousarray(rows, dtype=np.float64)
    if table.shape != shape:
        raise ValueError(f"inputs have shape {table.shape}, not {shape}")
    if not np.isfinite(table).all():
        row, column = np.argwhere(~np.isfinite(table))[0]
        raise ValueError(f"{what} {row}: {get(model).inputs[column].name} = {table[row, column]} is not finite")
    return table


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
        self._in = (ct.c_double * (3 + len(LOADS) + len(chosen.further_inputs)))()
        self._out = (ct.c_double * len(chosen.outputs))()
        self._flags = {i for i, v in enumerate(chosen.outputs) if v.kind == "Boolean"}
        _take(self._library.actuator_start, self._at, values, model)

    @property
    def state(self) -> bytes:
        """Everything that changes while running."""
        return self._memory.raw[self._state:self._state + self._state_size]

    @state.setter
    def state(self, state: bytes) -> None:
        if len(state) != self._state_size:
            raise ValueError(f"a state has {self._state_size} bytes, not {len(state)}")
        ct.memmove(self._at + self._state, state, self._state_size)

    def bind(self, values: Mapping[str, Any]) -> None:
        """Take parameter values, anew after a tunable one changed."""
        _take(self._library.actuator_bind, self._at, values, self._model)

    def carried(self, *motion: float) -> tuple[float, ...]:
        """Return what the vehicle's motion makes of the actuator, from the inputs of the motion."""
        if len(motion) != len(MOTION):
            raise TypeError(f"the motion has {len(MOTION)} inputs, not {len(motion)}")
        out = (ct.c_double * len(Carried._fields))()
        self._library.actuator_carried(self._at, (ct.c_double * len(MOTION))(*motion), out)
        return tuple(out)

    def outputs(self, inputs: core.Inputs) -> tuple[Any, ...]:
        """Return the outputs in the interface's order."""
        self._in[:] = list(inputs)
        self._library.actuator_outputs(self._at, self._in, self._out)
        return self._results()

    def run(self, end: float, inputs: core.Inputs, ramp: core.Ramp | None = None) -> tuple[Any, ...]:
        """Move on to `end` [s] from the start; see :meth:`emcas_fmu.runtime.core.Core.run`."""
        self._in[:] = list(inputs)
        change = None if ramp is None else (ct.c_double * (1 + len(ramp[1])))(ramp[0], *ramp[1])
        result = self._library.actuator_run(self._at, end, self._in, change, self._out)
        if result:
            raise ArithmeticError(REASONS[result])
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
            _take(self._library.actuator_start, self._at + i * self._size, values, self._model)

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
            raise ArithmeticError(f"actuators {listed}: {REASONS[self._results[which[0]]]}")
        return self.outputs


def run_table(values: Mapping[str, Any], step: float, inputs: Array, model: str = NONLINEAR) -> Array:
    """Return the outputs at the times of the rows of `inputs`, `step` [s] apart from 0, each row held until the next.

    Columns as the inputs and outputs of the variable table, in SI. Raises ArithmeticError
    where the equations cannot be followed, CompilerError where there is no compiled kernel.
    """
    library = _loaded(model)
    rows = _table(inputs, (len(inputs), len(get(model).inputs)), "row", model)
    memory = ct.create_string_buffer(library.actuator_size())
    _take(library.actuator_start, ct.addressof(memory), values, model)
    outputs: Array = np.empty((len(rows), len(get(model).outputs)))
    result = ct.c_int(0)
    reached = library.actuator_simulate(ct.addressof(memory), len(rows), step, rows.ctypes.data, outputs.ctypes.data,
                                        ct.addressof(result))
    if reached < len(rows):
        raise ArithmeticError(f"at {reached * step:.6g} s: {REASONS[result.value]}")
    return outputs


