"""Many actuators side by side, in machine code."""

from __future__ import annotations

import ctypes as ct
import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor, wait
from math import isfinite

import numpy as np

from ..actuators import NONLINEAR, get
from ..parameters import ParameterError
from ..support.progress import Progress, silent
from .codegen import MOTION_SLICE
from .compiled import REASONS, Array, address, by_schedule, doubles, longest_line, prepare, refusal
from .library import WORTH_VECTORS, loaded, vectors

STEPS = 100_000  # expected number of steps of a batch: 100 s in steps of 1 ms
_CACHE_LINE = 64  # bytes; the longest vectors have as many
_CHUNK = 4096  # number of actuators that are prepared in one call
_PIECES = 50  # number of parts of a step, after each of which progress is reported

# A function that advances groups `first` to `last` - 1 of a batch to an end [s], with inputs (columns, strides, number
# of the motion) and outputs (address, stride, results). Returns the number of actuators that did not reach the end.
_Move = Callable[..., int]


class _Groups(ct.Structure):
    """The struct batch of many.h."""

    _fields_ = (("count", ct.c_size_t), ("order", ct.c_void_p), ("common", ct.c_void_p), ("indices_count", ct.c_size_t),
                ("indices", ct.c_void_p), ("varying", ct.c_void_p), ("groups", ct.c_void_p),
                ("group_size", ct.c_size_t), ("same_schedule", ct.c_int), ("in_order", ct.c_int))


class Batch:
    """Many actuators side by side, each with its parameters. They are initially at rest, and their inputs are 0.

    `parameters` is an array [count, parameters], or [1, parameters] for `count` equal actuators, with rows of
    :func:`emcas_fmu.runtime.compiled.parameter_row`. `threads` is the number of threads that share a step. `lanes` (1,
    4 or 8; by default as many as the processor's vectors hold, or 1 where compiling for vectors is not worth its time)
    is the number of actuators that are advanced at once, without effect on the results. Raises ParameterError naming
    the first actuator whose parameters break a limit or rule, CompilerError if no kernel can be compiled, ValueError
    for a wrong shape, `count` or number of `lanes`.
    """

    def __init__(self, parameters: Array, count: int, model: str = NONLINEAR, threads: int = 1,
                 progress: Progress = silent, lanes: int | None = None) -> None:
        if count < 1:
            raise ValueError(f"a batch of {count} actuators: at least one is necessary")
        actuator = get(model)
        self.count, self._model = count, model
        self._parameters: Array = np.ascontiguousarray(parameters, dtype=np.float64)
        if self._parameters.shape not in ((count, len(actuator.parameters)), (1, len(actuator.parameters))):
            raise ValueError(f"parameters have shape {self._parameters.shape}, not ({count}, "
                             f"{len(actuator.parameters)}) or (1, {len(actuator.parameters)})")
        self._threads = threads
        self._pools: dict[int, ThreadPoolExecutor] = {}  # by process
        # Columns that begin a multiple of a page apart would compete for the same lines of the cache.
        stride = -(-count // 8) * 8 + 8
        self._table = np.zeros((len(actuator.outputs), stride))
        self.outputs: Array = self._table[:, :count]
        """Outputs [outputs, count] at the end of the last step, in the interface's order and in SI."""
        self._results = np.zeros(count, dtype=np.intc)
        self._out = address(self._table), stride, address(self._results)
        self._motion = range(len(actuator.inputs))[MOTION_SLICE]
        self._motion_number = 1  # changes with the vehicle's motion
        self._columns: list[Array] = [np.zeros(()) for _ in actuator.inputs]
        self._addresses = (ct.c_void_p * len(self._columns))(*map(address, self._columns))
        self._strides = (ct.c_ssize_t * len(self._columns))()
        many = vectors(model, STEPS * count if lanes is None else WORTH_VECTORS, lanes)
        self._groups, self._move = self._prepared(many or loaded(model), progress)

    def _prepared(self, library: ct.CDLL, progress: Progress) -> tuple[int, _Move]:
        """Return the number of groups, of as many actuators as a vector holds, and the function that advances them."""
        lanes, sets = library.batch_lanes(), self._parameters
        groups = -(-self.count // lanes)
        common = prepare(library, sets[:1]).values[0]
        varies, reads, schedules = np.zeros(len(common), dtype=bool), np.zeros(len(common), dtype=bool), []
        library.batch_reads(address(reads))
        for chunk in _chunks(len(sets), _CHUNK):
            prepared = prepare(library, sets[chunk])
            if prepared.refused.any():
                index = chunk.start + int(np.argmax(prepared.refused))
                raise ParameterError([f"actuator {index}: {problem}" for problem in refusal(sets[index], self._model)])
            # Compared as bits, since 0 and -0 differ.
            varies |= (prepared.values.view(np.int64) != common.view(np.int64)).any(axis=0)
            schedules.append(prepared.schedules)
            progress("preparing actuators", chunk.stop, 2 * len(sets))
        all_schedules = np.concatenate(schedules)
        same = bool((all_schedules == all_schedules[0]).all())
        order = np.arange(self.count, dtype=np.uintp) if same else by_schedule(all_schedules)
        order = np.concatenate([order, np.full(groups * lanes - self.count, order[-1])])
        # With one lane all values are stored if any of them varies, so that they need no copy.
        indices = np.flatnonzero(varies & reads if lanes > 1 else varies | varies.any()).astype(np.uintp)
        varying = _aligned(groups * lanes * len(indices) * 8).view(np.float64).reshape(groups, len(indices), lanes)
        for chunk in _chunks(groups, _CHUNK // lanes) if len(indices) else ():
            values = prepare(library, sets[order[chunk.start * lanes:chunk.stop * lanes]]).values[:, indices]
            varying[chunk] = values.reshape(-1, lanes, len(indices)).transpose(0, 2, 1)
            progress("preparing actuators", min(len(sets) + chunk.stop * lanes, 2 * len(sets)), 2 * len(sets))
        progress("preparing actuators", 2 * len(sets), 2 * len(sets))
        size = library.batch_group_size(longest_line(all_schedules))
        size = -(-size // _CACHE_LINE) * _CACHE_LINE
        memory = _aligned(size * groups)
        self._arrays = order, common, indices, varying, memory  # not freed, since the library has their addresses
        batch = _Groups(self.count, address(order), address(common), len(indices), address(indices), address(varying),
                        address(memory), size, same, same)
        library.batch_start(ct.byref(batch), 0, groups)

        def move(first: int, last: int, *more: object) -> int:
            failed: int = library.batch_run(ct.byref(batch), first, last, *more)
            return failed

        return groups, move

    def hold(self, index: int, value: float | Array) -> None:
        """Hold the input with this `index` in the interface at a `value` in SI, a number for all or an array [count].

        An array is not copied, unless it repeats one value in memory. The caller checks the shape, and that the
        values are finite.
        """
        column = doubles(value)
        stride = 0 if not column.shape else 1 if self.count == 1 else column.strides[0] // column.itemsize
        self._columns[index] = column if stride else np.array(column.flat[0])
        self._addresses[index] = address(self._columns[index])
        self._strides[index] = stride
        if index in self._motion:
            self._motion_number += 1

    @property
    def moved(self) -> bool:
        """Whether at least one actuator has advanced in the last step."""
        return not self._results.all()

    def run(self, end: float, progress: Progress = silent) -> Array:
        """Advance every actuator to `end` [s from the start] with its inputs held; return :attr:`outputs`.

        Raises ValueError for an end that is not finite, ArithmeticError naming actuators whose step cannot be computed
        (ten at most for each reason); these keep their states and outputs, the others have moved.
        """
        if not isfinite(end):
            raise ValueError(f"the end of the step, {end} s, is not finite")
        if self._move_all(end, progress):
            failed = {REASONS[code]: np.flatnonzero(self._results == code) for code in np.unique(self._results) if code}
            raise ArithmeticError("; ".join(
                f"actuators {', '.join(map(str, which[:10]))}{', ...' * (len(which) > 10)}: {reason}"
                for reason, which in failed.items()))
        return self.outputs

    def _pool(self) -> ThreadPoolExecutor:
        """Return the threads of this process: a forked child has none of its parent's."""
        process = os.getpid()
        if process not in self._pools:
            self._pools[process] = ThreadPoolExecutor(self._threads)
        return self._pools[process]

    def _move_all(self, end: float, progress: Progress) -> int:
        """Advance all actuators; return the number of those that did not reach the end."""
        arguments = (self._addresses, self._strides, self._motion_number, *self._out)
        if progress is silent and self._threads <= 1:
            return self._move(0, self._groups, end, *arguments)
        pieces = _chunks(self._groups, -(-self._groups // (self._threads if progress is silent else _PIECES)))

        def move(piece: slice) -> int:
            return self._move(piece.start, piece.stop, end, *arguments)

        failed, running = 0, [self._pool().submit(move, piece) for piece in pieces] if self._threads > 1 else []
        try:
            for k, piece in enumerate(pieces):
                failed += running[k].result() if running else move(piece)
                progress("moving actuators", piece.stop, self._groups)
        finally:
            wait(running)  # even if `progress` raises, nothing moves after this call
        return failed


def _chunks(count: int, size: int) -> list[slice]:
    return [slice(k, min(k + size, count)) for k in range(0, count, size)]


def _aligned(size: int) -> Array:
    """Return an array of `size` bytes that begins at a line of the cache."""
    memory = np.empty(size + _CACHE_LINE, dtype=np.uint8)
    begin = -address(memory) % _CACHE_LINE
    return memory[begin:begin + size]
