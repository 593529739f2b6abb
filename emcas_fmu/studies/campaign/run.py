"""Running a campaign's samples: in this process, or by Dask on this machine or on others."""

from __future__ import annotations

import asyncio
import logging
import signal
import threading
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from importlib import import_module
from queue import SimpleQueue
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ... import __version__
from ...actuators import NONLINEAR
from ...bench.excitation import STEP
from ...runtime import library
from ...simulation import Array
from .distributions import CampaignError
from .measure import POWER_ROWS
from .plan import Plan
from .sample import Rows, failed, rows
from .sampling import Sampler
from .study import Study

# Simulated in a task by default: some tenths of a second of work with the kernel, a few seconds with an FMU. What is
# taken for a task (milliseconds) is little beside it, what a kill loses is little.
SIMULATED, BY_FMU = 1000.0, 20.0  # s
# Deaths of a worker under a task before it is given up. Dask's own 3 costs as many restarts more for a
# sample that kills every worker, and one spares a task whose worker was killed from outside.
ALLOWED_DEATHS = 1
_AHEAD = 3  # tasks submitted for each thread: none waits for the client
# Run by a worker as it starts. A Ctrl-C reaches every process of a terminal: this one ends the others.
_UNINTERRUPTED = "import signal; signal.signal(signal.SIGINT, signal.SIG_IGN)"
_CONNECT = 20.0  # s
_WORKERS = 120.0  # s, until the first worker is there

Work = Callable[[bytes, Sequence[int], Array], Rows]
Keep = Callable[[Rows], object]
Indices = NDArray[np.int64]


def _distributed() -> Any:
    return import_module("distributed")  # an extra: not needed for the rest of this module


def chunked(missing: Indices, size: int) -> deque[Indices]:
    """Return the indices in chunks, in order."""
    return deque(missing[k:k + size] for k in range(0, len(missing), size))


def chunk_size(plan: Plan, count: int, threads: int) -> int:
    """Return the samples in a task: at least eight tasks for a thread, so that all end at about the same time."""
    most = int((BY_FMU if plan.fmu else SIMULATED) / plan.duration)
    return max(1, min(most, count // (8 * threads)))


def _compile(plan: Plan, samples: int) -> None:
    if not plan.fmu:
        library.compile_for(plan.model, samples * plan.duration / STEP * POWER_ROWS)


def in_process(study: Study, missing: Indices, keep: Keep, chunk: int | None = None) -> None:
    """Run samples in this process, without Dask."""
    sampler, packed = Sampler(study), study.plan.packed()
    _compile(study.plan, len(missing))
    for indices in chunked(missing, chunk or chunk_size(study.plan, len(missing), 1)):
        keep(rows(packed, indices.tolist(), sampler.draw(indices.tolist())))


@contextmanager
def local_client(workers: int, model: str = NONLINEAR) -> Iterator[Any]:
    """A Dask client with worker processes of its own on this machine, for a campaign of a model; gone when it ends."""
    import dask

    distributed = _distributed()
    library.available(model)  # compile once, not once a worker
    # Any free port, of this machine only: two campaigns may run at a time.
    # Restarted workers are reported by rows, not by log lines between the progress bar's.
    options = {"distributed.scheduler.allowed-failures": ALLOWED_DEATHS, "distributed.admin.tick.limit": "1h"}
    with ExitStack() as stack:
        stack.enter_context(dask.config.set(options))
        try:
            cluster = stack.enter_context(distributed.LocalCluster(
                n_workers=workers, threads_per_worker=1, processes=True, dashboard_address="127.0.0.1:0",
                silence_logs=logging.CRITICAL, preload=[_UNINTERRUPTED]))
        except RuntimeError as error:
            raise CampaignError(f"worker processes could not be started ({error}); --workers 0 runs in this "
                                "process") from error
        yield stack.enter_context(distributed.Client(cluster))


@contextmanager
def remote_client(address: str) -> Iterator[Any]:
    """A client of a scheduler that is running. Raises CampaignError where it, or its workers, cannot be used."""
    with ExitStack() as stack:
        # Without Dask's own messages and tracebacks on a lost connection, of which a CampaignError tells.
        stack.enter_context(_distributed().utils.silence_logging_cmgr(logging.CRITICAL + 1))
        try:
            # Before a client, which tries without end where something else answers.
            kind = asyncio.run(asyncio.wait_for(_kind(address), _CONNECT))
            if kind != "Scheduler":
                raise ValueError(f"a {kind} answers")
            client = stack.enter_context(_distributed().Client(address, timeout=_CONNECT))
        # What is no scheduler may answer anything, and the sizes read from that be any.
        except (OSError, ValueError, MemoryError, TypeError, KeyError) as error:
            raise CampaignError(
                f"--scheduler {address}: no scheduler answers there ({_reason(error)}); start one with `dask "
                "scheduler`, and give its address such as tcp://host:8786, which is not that of its dashboard, "
                "http://host:8787") from error
        _ready(client, address)
        yield client


async def _kind(address: str) -> str:
    """Return what a Dask process calls itself."""
    distributed = _distributed()
    options = distributed.Security().get_connection_args("client")
    async with distributed.rpc(address, timeout=_CONNECT, connection_args=options) as process:
        return str((await process.identity())["type"])


def _reason(error: Exception) -> str:
    if isinstance(error, (TimeoutError, asyncio.TimeoutError)):
        return f"within {_CONNECT:g} s"
    return str(error) or type(error).__name__


def _ready(client: Any, address: str) -> None:
    """Wait for workers; raise CampaignError where there is none, or one without this version of the package."""
    try:
        client.wait_for_workers(1, timeout=_WORKERS)
    except TimeoutError as error:
        raise CampaignError(f"--scheduler {address}: has no worker; start some with `dask worker {address}`") from error
    try:
        versions = client.run(_version)
    except ModuleNotFoundError as error:
        raise CampaignError(f"--scheduler {address}: a worker has no emcas ({error}); install emcas-fmu "
                            f"{__version__} where it runs") from error
    for worker, version in versions.items():
        if version != __version__:
            raise CampaignError(f"--scheduler {address}: worker {worker} has emcas {version}, not {__version__}; "
                                "install the same")


def _version() -> str:
    return __version__


def by_dask(client: Any, study: Study, missing: Indices, keep: Keep, chunk: int | None = None,
            work: Work = rows) -> None:
    """Run samples on a client's workers; `keep` is given rows as they come, in any order.

    A task whose workers die is taken apart: its samples run one at a time, alone, and one that again
    kills its workers is kept as failed. Raises CampaignError where the scheduler is lost.
    """
    threads = max(sum(client.ncores().values()), 1)
    sampler, packed = Sampler(study), study.plan.packed()
    _compile(study.plan, len(missing))  # for workers on this machine

    def submit(indices: Indices) -> Any:
        return client.submit(work, packed, indices.tolist(), sampler.draw(indices.tolist()), pure=False)

    chunks = chunked(missing, chunk or chunk_size(study.plan, len(missing), threads))
    suspects = _run(submit, chunks, keep, _AHEAD * threads)
    for index in _run(submit, chunked(suspects, 1), keep, 1).tolist():
        keep(failed(study.plan, [index], sampler.draw([index]),
                    ["every worker that ran it died (out of memory, or a crash)"]))


@contextmanager
def _connected() -> Iterator[None]:
    """What a client raises without its scheduler, as CampaignError."""
    distributed = _distributed()
    closed = getattr(distributed.client, "ClosedClientError", TimeoutError)  # older ones cancel only
    try:
        yield
    except (distributed.CancelledError, distributed.comm.CommClosedError, TimeoutError, closed) as error:
        raise CampaignError(f"the scheduler was lost ({type(error).__name__}); what was done is kept: the same "
                            "command goes on") from error


@contextmanager
def waking(done: SimpleQueue[Any]) -> Iterator[None]:
    """Have Ctrl-C wake who waits for `done`, by None.

    Raised in the middle of Dask's waiting it may leave a lock that is never released, and the run would not end.
    """
    if threading.current_thread() is not threading.main_thread() or (
            signal.getsignal(signal.SIGINT) is not signal.default_int_handler):
        yield
        return
    signal.signal(signal.SIGINT, lambda *_: done.put(None))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def _run(submit: Callable[[Indices], Any], chunks: deque[Indices], keep: Keep, ahead: int) -> Indices:
    """Run chunks of samples, `ahead` tasks at a time; return the samples of tasks whose workers died."""
    distributed = _distributed()
    running: dict[str, Indices] = {}
    dead = [np.empty(0, dtype=np.int64)]
    done: SimpleQueue[Any] = SimpleQueue()

    def launch() -> None:
        if chunks:
            indices = chunks.popleft()
            with _connected():
                task = submit(indices)
            running[task.key] = indices
            task.add_done_callback(done.put)

    with waking(done):
        for _ in range(ahead):
            launch()
        while running:
            if (task := done.get()) is None:
                raise KeyboardInterrupt
            indices = running.pop(task.key)
            try:
                with _connected():
                    rows_of_task = task.result()
            except distributed.KilledWorker:
                dead.append(indices)
            else:
                keep(rows_of_task)
            launch()
    return np.sort(np.concatenate(dead))
