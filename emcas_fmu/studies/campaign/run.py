"""Run the samples of a campaign: in this process, or with Dask on this machine or others.

Workers are processes: the estimates of sweeps are mostly computed in Python, where threads would wait for each other.
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
from .sample import Rows, failed, rows
from .study import Study

# Simulated time of a task by default [s], with the kernel and with an FMU: tenths of a second of work, and seconds. It
# is long compared with the overhead of milliseconds, and short enough to be lost if a worker is killed.
SIMULATED, BY_FMU = 1000.0, 20.0
# Deaths of workers after which a task is still repeated. Dask's default of 3 costs more restarts for a sample that
# kills every worker; 0 would abandon a task whose worker was killed from outside.
ALLOWED_DEATHS = 1
_AHEAD = 3  # tasks submitted per thread, so that no thread waits for the client
# Workers run this first. A terminal sends Ctrl-C to every process; only the client handles it, and ends the workers.
_UNINTERRUPTED = "import signal; signal.signal(signal.SIGINT, signal.SIG_IGN)"
_CONNECT = 20.0  # s, longest wait for a scheduler
_WORKERS = 120.0  # s, longest wait for the first worker
# A run without any worker on this machine ends after this time [s]. A restart needs 3 s, and tens on a busy machine.
_RESTARTED = 300.0
# Dask removes a worker for good if it is not running at one instant, by default 15 s after its death: also if it
# restarts slowly, or has died again since. Without workers the run would wait for ever.
_NEVER = "365 days"

Work = Callable[[Study, Sequence[int], Array], Rows]
Keep = Callable[[Rows], object]
Indices = NDArray[np.int64]


def _distributed() -> Any:
    return import_module("distributed")  # an extra, which `in_process` does not need


def _prepared(study: Study, missing: Indices, chunk: int | None, threads: int) -> Iterator[Indices]:
    """Compile the kernel if that saves time, also for workers on this machine; return chunks of indices, in order."""
    if not study.fmu:
        library.compile_for(study.model, len(missing) * study.duration / STEP * POWER_ROWS)
    size = chunk or chunk_size(study, len(missing), threads)
    return (missing[k:k + size] for k in range(0, len(missing), size))


def chunk_size(study: Study, count: int, threads: int) -> int:
    """Return the number of samples in a task: with eight or more tasks per thread, threads end at about one time."""
    most = int((BY_FMU if study.fmu else SIMULATED) / study.duration)
    return max(1, min(most, count // (8 * threads)))


def in_process(study: Study, missing: Indices, keep: Keep, chunk: int | None = None) -> None:
    """Run the samples `missing` (indices) in this process, without Dask; pass the rows of each chunk to `keep`."""
    for indices in _prepared(study, missing, chunk, 1):
        keep(rows(study, indices.tolist(), study.draw(indices.tolist())))


@contextmanager
def local_client(workers: int, model: str = NONLINEAR) -> Iterator[Any]:
    """Yield a Dask client with `workers` processes on this machine, for campaigns of a model. Raises CampaignError."""
    import dask

    distributed = _distributed()  # its import sets Dask's defaults
    library.available(model)  # compiles once, not in every worker
    # The rows tell of dead workers; log lines would break the progress bar.
    with dask.config.set({"distributed.scheduler.allowed-failures": ALLOWED_DEATHS,
                          "distributed.deploy.lost-worker-timeout": _NEVER,
                          "distributed.scheduler.no-workers-timeout": _RESTARTED,
                          "distributed.admin.tick.limit": "1h"}):
        try:  # at any free port of this machine: two campaigns may run at a time
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
            # First, since a client tries forever if another program answers.
            kind = asyncio.run(asyncio.wait_for(_kind(address), _CONNECT))
            if kind != "Scheduler":
                raise ValueError(f"a {kind} answers")
            client = distributed.Client(address, timeout=_CONNECT)
        # Another server may send any bytes, which Dask reads as sizes.
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
    """Wait for workers. Raises CampaignError if none appears, or one has another version of the package or none."""
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


def by_dask(client: Any, study: Study, missing: Indices, keep: Keep, chunk: int | None = None,
            work: Work = rows) -> None:
    """Run the samples `missing` (indices) on a client's workers; pass rows to `keep` in the order of completion.

    Samples of a task whose workers died are run again, one at a time; a sample that kills its workers again is recorded
    as failed. `work` computes the rows of a task. Raises CampaignError if the connection to the scheduler is lost or no
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
    """Raise CampaignError in place of the errors of a client whose scheduler or whose workers are gone."""
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
