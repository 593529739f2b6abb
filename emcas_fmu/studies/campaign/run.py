"""Run the samples of a campaign in this process, or with Dask on this machine or on several machines.

Workers are processes: the figures of sweeps are mostly computed in Python, where threads would wait for each other.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from importlib import import_module
from itertools import islice
from queue import SimpleQueue
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ... import __version__
from ...actuators import NONLINEAR
from ...motions import STEP
from ...runtime import library
from ...simulation import Array
from ...support.progress import waking
from .distributions import CampaignError
from .experiments import POWER_ROWS
from .sample import SampleColumns, failed, rows
from .study import Campaign

# Simulated time of a task [s]: with the kernel (tenths of a second of work) and with an FMU (seconds of work). The
# overhead of a task is milliseconds, and little work is lost if a worker is killed.
SIMULATED, BY_FMU = 1000.0, 20.0
# Number of workers that may die while they run a task before the task is abandoned. Dask's default of 3 costs more
# restarts for a sample that kills every worker; with 0, a task would be abandoned if its worker is killed from outside.
ALLOWED_DEATHS = 1
_AHEAD = 3  # submitted tasks per thread: no thread waits for the client
# Workers run this first. A terminal sends Ctrl-C to every process; only the client handles it, and ends the workers.
_UNINTERRUPTED = "import signal; signal.signal(signal.SIGINT, signal.SIG_IGN)"
_CONNECT = 20.0  # s, longest wait for a scheduler
_WORKERS = 120.0  # s, longest wait for the first worker
# Time [s] without a worker after which a run on this machine ends. A restart needs 3 s; on a busy machine, tens of s.
_RESTARTED = 300.0
# Time after the death of a worker at which Dask removes the worker for good if it is not running at that instant. The
# default of 15 s also removes workers that restart slowly, or have died again: then the run would wait forever.
_NEVER = "365 days"

Work = Callable[[Campaign, Sequence[int], Array], SampleColumns]
Keep = Callable[[SampleColumns], object]
Indices = NDArray[np.int64]


def _distributed() -> Any:
    return import_module("distributed")  # an extra, which `in_process` does not need


def _prepared(study: Campaign, missing: Indices, chunk: int | None, threads: int) -> Iterator[Indices]:
    """Return chunks of indices, in order; compile the kernel first, also for workers here, if that saves time."""
    if not study.fmu:
        library.compile_for(study.model, len(missing) * study.duration / STEP * POWER_ROWS)
    size = chunk or chunk_size(study, len(missing), threads)
    return (missing[k:k + size] for k in range(0, len(missing), size))


def chunk_size(study: Campaign, count: int, threads: int) -> int:
    """Return the number of samples in a task: a thread gets eight tasks or more if possible, and all end together."""
    most = int((BY_FMU if study.fmu else SIMULATED) / study.duration)
    return max(1, min(most, count // (8 * threads)))


def in_process(study: Campaign, missing: Indices, keep: Keep, chunk: int | None = None) -> None:
    """Run the samples `missing` (indices) in this process, without Dask; pass the rows of each chunk to `keep`."""
    for indices in _prepared(study, missing, chunk, 1):
        keep(rows(study, indices.tolist(), study.draw(indices.tolist())))


@contextmanager
def local_client(workers: int, model: str = NONLINEAR) -> Iterator[Any]:
    """Yield a Dask client with `workers` processes on this machine, for campaigns of a model. Raises CampaignError."""
    import dask

    distributed = _distributed()  # its import sets Dask's defaults
    library.available(model)  # compiles once, not in every worker
    # The rows report dead workers; Dask's log lines would break the progress bar.
    with dask.config.set({"distributed.scheduler.allowed-failures": ALLOWED_DEATHS,
                          "distributed.deploy.lost-worker-timeout": _NEVER,
                          "distributed.scheduler.no-workers-timeout": _RESTARTED,
                          "distributed.admin.tick.limit": "1h"}):
        try:  # the dashboard is at any free port: two campaigns may run at the same time
            client = distributed.Client(
                n_workers=workers, threads_per_worker=1, processes=True, dashboard_address="127.0.0.1:0",
                silence_logs=logging.CRITICAL, preload=[_UNINTERRUPTED])
        except RuntimeError as error:
            raise CampaignError(f"worker processes could not be started ({error}); use --workers 0, which runs in this "
                                "process") from error
        with client:
            yield client


@contextmanager
def remote_client(address: str) -> Iterator[Any]:
    """Yield a client of a running scheduler. Raises CampaignError if the scheduler or its workers cannot be used."""
    distributed = _distributed()
    # A lost connection is reported as a CampaignError, without Dask's messages and tracebacks.
    with distributed.utils.silence_logging_cmgr(logging.CRITICAL + 1):
        try:
            # Check the address first: a client would retry forever if another program answers there.
            kind = asyncio.run(asyncio.wait_for(_kind(address), _CONNECT))
            if kind != "Scheduler":
                raise ValueError(f"a {kind} answers")
            client = distributed.Client(address, timeout=_CONNECT)
        # Dask reads the bytes of another kind of server as sizes, which causes errors of any type.
        except (OSError, ValueError, MemoryError, TypeError, KeyError, asyncio.TimeoutError) as error:
            reason = f"within {_CONNECT:g} s" if isinstance(error, (TimeoutError, asyncio.TimeoutError)) else str(error)
            raise CampaignError(
                f"--scheduler {address}: no scheduler answers there ({reason or type(error).__name__}); start one with "
                "`dask scheduler`, and give its address, such as tcp://host:8786, not that of its dashboard, "
                "http://host:8787") from error
        with client:
            _ready(client, address)
            yield client


async def _kind(address: str) -> str:
    """Return the type that a Dask process reports, such as Scheduler."""
    distributed = _distributed()
    options = distributed.Security().get_connection_args("client")
    async with distributed.rpc(address, timeout=_CONNECT, connection_args=options) as process:
        return str((await process.identity())["type"])


def _ready(client: Any, address: str) -> None:
    """Wait for workers. Raises CampaignError if none appears, or if one lacks the package or has another version."""
    try:
        client.wait_for_workers(1, timeout=_WORKERS)
    except TimeoutError as error:
        raise CampaignError(f"--scheduler {address}: has no worker; start one with `dask worker {address}`") from error
    try:
        versions = client.run(_version)
    except ModuleNotFoundError as error:
        raise CampaignError(f"--scheduler {address}: a worker lacks the package ({error}); install emcas-fmu "
                            f"{__version__} on its machine") from error
    for worker, version in versions.items():
        if version != __version__:
            raise CampaignError(f"--scheduler {address}: worker {worker} has emcas {version}, not {__version__}; "
                                "install the same version")


def _version() -> str:
    return __version__


def by_dask(client: Any, study: Campaign, missing: Indices, keep: Keep, chunk: int | None = None,
            work: Work = rows) -> None:
    """Run the samples `missing` (indices) on a client's workers; pass rows to `keep` in the order of completion.

    Samples of a task whose workers died are run again, one at a time; a sample whose workers die again is recorded as
    failed. `work` computes the rows of a task. Raises CampaignError if the connection to the scheduler is lost or no
    worker on this machine restarts, and KeyboardInterrupt at Ctrl-C.
    """
    threads = max(sum(client.ncores().values()), 1)

    def submit(indices: Indices) -> Any:
        return client.submit(work, study, indices.tolist(), study.draw(indices.tolist()), pure=False)

    suspect = _run(submit, _prepared(study, missing, chunk, threads), keep, _AHEAD * threads)
    for index in _run(submit, iter(suspect[:, np.newaxis]), keep, 1).tolist():
        keep(failed(study, [index], study.draw([index]), ["every worker that ran it died (out of memory, or a crash)"]))


@contextmanager
def _connected() -> Iterator[None]:
    """Raise CampaignError in place of the errors of a client that has lost its scheduler or all workers."""
    distributed = _distributed()
    closed = getattr(distributed.client, "ClosedClientError", TimeoutError)  # not in older versions
    try:
        yield
    except (distributed.CancelledError, distributed.comm.CommClosedError, TimeoutError, closed) as error:
        raise CampaignError(f"the scheduler was lost ({type(error).__name__}); finished samples are kept, and the same "
                            "command continues") from error
    except (distributed.scheduler.NoWorkerError, distributed.scheduler.NoValidWorkerError) as error:
        raise CampaignError(f"no worker has run for {error.timeout:g} s: all have died or are paused (memory or disk "
                            "may be full); finished samples are kept: the same command continues") from error


def _run(submit: Callable[[Indices], Any], chunks: Iterator[Indices], keep: Keep, ahead: int) -> Indices:
    """Run chunks of samples, `ahead` tasks at a time; return the sorted indices in tasks whose workers died."""
    running: dict[str, Indices] = {}
    dead = [np.empty(0, dtype=np.int64)]
    done: SimpleQueue[Any] = SimpleQueue()

    def launch(count: int) -> None:
        for indices in islice(chunks, count):
            with _connected():
                task = submit(indices)
            running[task.key] = indices
            task.add_done_callback(done.put)

    with waking(done):
        launch(ahead)
        while running:
            if (task := done.get()) is None:
                raise KeyboardInterrupt
            indices = running.pop(task.key)
            try:
                with _connected():
                    rows_of_task = task.result()
            except _distributed().KilledWorker:
                dead.append(indices)
            else:
                keep(rows_of_task)
            launch(1)
    return np.sort(np.concatenate(dead))
