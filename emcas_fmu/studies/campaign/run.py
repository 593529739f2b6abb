"""Run the samples of a campaign: in this process, or by Dask on this machine or others.

Workers are processes, since springs and the estimates of sweeps are mostly Python's work, for which threads would wait
for each other.
"""

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
from ...motions import STEP
from ...runtime import library
from ...simulation import Array
from .distributions import CampaignError
from .measure import POWER_ROWS
from .plan import Plan
from .sample import Rows, failed, rows
from .sampling import Sampler
from .study import Study

# Simulated time of a task by default: tenths of a second of work with the kernel, seconds with an FMU. That is long
# beside the milliseconds of overhead, and short enough to be lost if a worker is killed.
SIMULATED, BY_FMU = 1000.0, 20.0  # s
# Deaths of workers that a task may cause. Dask's default of 3 costs more restarts for a sample that kills every
# worker; 0 would give up a task whose worker was killed from outside.
ALLOWED_DEATHS = 1
_AHEAD = 3  # tasks submitted for each thread, so that none waits for the client
# Run by workers as they start. A terminal sends Ctrl-C to every process; only this one handles it, and ends the others.
_UNINTERRUPTED = "import signal; signal.signal(signal.SIGINT, signal.SIG_IGN)"
_CONNECT = 20.0  # s, to reach a scheduler
_WORKERS = 120.0  # s, to the first worker

Work = Callable[[bytes, Sequence[int], Array], Rows]
Keep = Callable[[Rows], object]
Indices = NDArray[np.int64]


def _distributed() -> Any:
    return import_module("distributed")  # an extra, which `in_process` does not need


def chunked(missing: Indices, size: int) -> deque[Indices]:
    """Return the indices in chunks, in order."""
    return deque(missing[k:k + size] for k in range(0, len(missing), size))


def chunk_size(plan: Plan, count: int, threads: int) -> int:
    """Return the number of samples in a task: eight tasks or more for a thread, so that all end at about one time."""
    most = int((BY_FMU if plan.fmu else SIMULATED) / plan.duration)
    return max(1, min(most, count // (8 * threads)))


def _compile(plan: Plan, samples: int) -> None:
    if not plan.fmu:
        library.compile_for(plan.model, samples * plan.duration / STEP * POWER_ROWS)


def in_process(study: Study, missing: Indices, keep: Keep, chunk: int | None = None) -> None:
    """Run samples in this process, without Dask; pass the rows of each chunk to `keep`."""
    sampler, packed = Sampler(study), study.plan.packed()
    _compile(study.plan, len(missing))
    for indices in chunked(missing, chunk or chunk_size(study.plan, len(missing), 1)):
        keep(rows(packed, indices.tolist(), sampler.draw(indices.tolist())))


@contextmanager
def local_client(workers: int, model: str = NONLINEAR) -> Iterator[Any]:
    """A Dask client with worker processes on this machine, for a campaign of a model. Raises CampaignError."""
    import dask

    distributed = _distributed()
    library.available(model)  # compiles once, not in every worker
    # Any free port, on this machine only, so that two campaigns may run at a time. Restarted workers show in the rows,
    # not in log lines that break the progress bar.
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
    """A client of a running scheduler. Raises CampaignError if the scheduler or its workers cannot be used."""
    with ExitStack() as stack:
        # A lost connection is a CampaignError: Dask's messages and tracebacks are not needed.
        stack.enter_context(_distributed().utils.silence_logging_cmgr(logging.CRITICAL + 1))
        try:
            # First, since a client tries for ever if something else answers.
            kind = asyncio.run(asyncio.wait_for(_kind(address), _CONNECT))
            if kind != "Scheduler":
                raise ValueError(f"a {kind} answers")
            client = stack.enter_context(_distributed().Client(address, timeout=_CONNECT))
        # Another server may send any bytes, which Dask reads as sizes.
        except (OSError, ValueError, MemoryError, TypeError, KeyError) as error:
            raise CampaignError(
                f"--scheduler {address}: no scheduler answers there ({_reason(error)}); start one with `dask "
                "scheduler`, and give its address such as tcp://host:8786, which is not that of its dashboard, "
                "http://host:8787") from error
        _ready(client, address)
        yield client


async def _kind(address: str) -> str:
    """Return the type that a Dask process reports, such as Scheduler."""
    distributed = _distributed()
    options = distributed.Security().get_connection_args("client")
    async with distributed.rpc(address, timeout=_CONNECT, connection_args=options) as process:
        return str((await process.identity())["type"])


def _reason(error: Exception) -> str:
    if isinstance(error, (TimeoutError, asyncio.TimeoutError)):
        return f"within {_CONNECT:g} s"
    return str(error) or type(error).__name__


def _ready(client: Any, address: str) -> None:
    """Wait for workers. Raises CampaignError if none comes, or one does not have this version of the package."""
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
    """Run samples on a client's workers; pass rows to `keep` as they come, in any order.

    The samples of a task whose workers died are run again one at a time, alone; one that kills its workers again is
    recorded as failed. Raises CampaignError if the scheduler is lost.
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
    """Raise what a client raises without its scheduler as CampaignError."""
    distributed = _distributed()
    closed = getattr(distributed.client, "ClosedClientError", TimeoutError)  # not in older versions
    try:
        yield
    except (distributed.CancelledError, distributed.comm.CommClosedError, TimeoutError, closed) as error:
        raise CampaignError(f"the scheduler was lost ({type(error).__name__}); finished samples are kept: the same "
                            "command goes on") from error


@contextmanager
def waking(done: SimpleQueue[Any]) -> Iterator[None]:
    """Let Ctrl-C put None into the queue `done`.

    A KeyboardInterrupt inside Dask may leave a lock that is never released, and the run would not end.
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
