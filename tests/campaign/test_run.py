"""Dask: the rows equal those of one process, also if workers die or the run is killed and continued."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from queue import SimpleQueue
from typing import Any

import pyarrow as pa
import pytest

from emcas_fmu.studies.campaign import run
from emcas_fmu.studies.campaign.distributions import CampaignError
from emcas_fmu.studies.campaign.run import by_dask, chunk_size, in_process, local_client
from emcas_fmu.studies.campaign.sample import SampleColumns
from emcas_fmu.studies.campaign.store import Store
from emcas_fmu.studies.campaign.study import Campaign, load_study
from emcas_fmu.support.progress import waking

from .conftest import SMALL, Write
from .work import DEADLY, deadly, slow

LONGER = SMALL.replace("samples = 24", "samples = 250").replace('"0.3 s"', '"1 s"')


def undisturbed(study: Campaign, folder: Path) -> pa.Table:
    """Return the rows of an undisturbed run in this process."""
    with Store(folder, study) as store:
        in_process(study, store.missing(), store.write)
        return store.table()


def same(one: pa.Table, other: pa.Table) -> bool:
    """Return whether all values are identical, also missing ones."""
    return bool(repr(one.to_pylist()) == repr(other.to_pylist()))


def test_workers_give_the_rows_of_one_process(small: Campaign, store: Store, tmp_path: Path, client: Any) -> None:
    by_dask(client, small, store.missing(), store.write, chunk=5)
    assert same(store.table(), undisturbed(small, tmp_path / "undisturbed"))


@pytest.mark.slow
def test_killed_worker_loses_no_sample(small: Campaign, store: Store, tmp_path: Path, client: Any) -> None:
    victims = list(client.run(os.getpid).values())
    indices: list[int] = []

    def write(rows: SampleColumns) -> None:
        if not indices:
            os.kill(victims[0], signal.SIGKILL)
        indices.extend(rows["index"].tolist())
        store.write(rows)

    by_dask(client, small, store.missing(), write, chunk=2, work=slow)
    assert sorted(indices) == list(range(24))  # no sample is lost or written twice
    assert same(store.table(), undisturbed(small, tmp_path / "undisturbed"))


@pytest.mark.slow
def test_sample_that_kills_its_workers_fails_alone(small: Campaign, store: Store, tmp_path: Path, client: Any) -> None:
    by_dask(client, small, store.missing(), store.write, chunk=3, work=deadly)
    found, expected = store.table().to_pylist(), undisturbed(small, tmp_path / "undisturbed").to_pylist()
    lost = found.pop(DEADLY)
    assert expected.pop(DEADLY)["motor.torque_constant"] == lost["motor.torque_constant"]
    assert lost["status"] == "failed"
    assert "every worker that ran it died" in lost["error"]
    assert found == expected


@pytest.mark.slow
def test_run_continues_if_a_worker_restarts_slowly(
        small: Campaign, store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    """A restart takes seconds, longer than Dask's limit in this test; on a busy machine longer than its default."""
    import dask.distributed  # sets Dask's defaults

    monkeypatch.setattr(run, "_RESTARTED", 60.0)  # limits the time of this test
    with dask.config.set({"distributed.deploy.lost-worker-timeout": "10 ms"}), local_client(1) as other:
        (victim,) = other.run(os.getpid).values()
        os.kill(victim, signal.SIGKILL)
        by_dask(other, small, store.missing(), store.write)
    assert not len(store.missing())


@pytest.mark.slow
def test_error_if_no_worker_is_left(small: Campaign, store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(run, "_RESTARTED", 1.0)
    with local_client(1) as other:
        other.retire_workers()
        with pytest.raises(CampaignError, match=r"no worker has run for 1 s: .* the same command continues"):
            by_dask(other, small, store.missing(), store.write)
    assert len(store.missing()) == 24


@pytest.mark.parametrize("arguments", [{}, {
    "host_restrictions": set(), "worker_restrictions": set(), "resource_restrictions": {}}])
def test_error_if_every_worker_is_paused(arguments: Mapping[str, Any]) -> None:
    """Dask pauses workers whose memory is nearly full. It has one error for queued tasks and one for others."""
    from distributed import scheduler

    kind = scheduler.NoValidWorkerError if arguments else scheduler.NoWorkerError
    with pytest.raises(CampaignError, match=r"no worker has run for 2 s: .* the same command continues"), \
            run._connected():
        raise kind(task="rows", timeout=2.0, **arguments)


@pytest.mark.slow
def test_error_if_the_scheduler_is_lost(small: Campaign, store: Store) -> None:
    with local_client(1) as other:
        def write(rows: SampleColumns) -> None:
            store.write(rows)
            other.cluster.close()

        with pytest.raises(CampaignError, match=r"the scheduler was lost .* the same command continues"):
            by_dask(other, small, store.missing(), write, chunk=1, work=slow)
    assert len(store.missing()) < 24


def start(file: Path, folder: Path, *more: str) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "emcas_fmu.cli", "campaign", str(file), "--output", str(folder), *more]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True)


def wait_for_parts(process: subprocess.Popen[str], folder: Path, count: int) -> None:
    """Wait until the folder contains `count` parts."""
    end = time.monotonic() + 60.0
    while len(list(folder.glob("samples/part-*"))) < count:
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < end, "no parts within a minute"
        time.sleep(0.005)


def wait_for_end(group: int) -> None:
    """Wait until no process of a group is left: the workers end with their run."""
    end = time.monotonic() + 30.0
    while True:
        try:
            os.killpg(group, 0)
        except ProcessLookupError:
            return
        assert time.monotonic() < end, "workers outlive the run"
        time.sleep(0.05)


@pytest.mark.slow
def test_killed_run_is_continued(write: Write, tmp_path: Path) -> None:
    """After SIGKILL the stored parts remain unchanged, and only the other samples are run."""
    file, folder = write(LONGER), tmp_path / "out"
    process = start(file, folder, "--workers", "2", "--chunk", "7")
    wait_for_parts(process, folder, 3)
    process.kill()
    process.communicate()
    wait_for_end(process.pid)
    study = load_study(file)
    parts = {path.name: (path.stat().st_mtime_ns, path.read_bytes()) for path in folder.glob("samples/part-*")}
    before = len(Store(folder, study).missing())
    assert 0 < before <= 250 - 3 * 7
    process = start(file, folder, "--workers", "1", "--chunk", "11")
    output, errors = process.communicate(timeout=120.0)
    assert process.returncode == 0, errors
    assert "250 samples" in output
    now = {path.name: (path.stat().st_mtime_ns, path.read_bytes()) for path in folder.glob("samples/part-*")}
    assert parts.items() < now.items()
    rows = sum(pa.parquet.read_metadata(path).num_rows for path in folder.glob("samples/part-*"))
    assert rows == 250  # no sample is stored twice
    assert same(Store(folder, study).table(), undisturbed(study, tmp_path / "undisturbed"))


@pytest.mark.skipif(sys.platform == "win32", reason="sends a signal")
def test_ctrl_c_is_handled_between_tasks() -> None:
    """An exception while Dask waits could leave a lock that nobody releases."""
    queue: SimpleQueue[Any] = SimpleQueue()
    with waking(queue):
        os.kill(os.getpid(), signal.SIGINT)
        assert queue.get(timeout=10.0) is None
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


@pytest.mark.slow
def test_ctrl_c_keeps_the_finished_samples(write: Write, tmp_path: Path) -> None:
    # So many samples that the run is not finished when a busy machine sends the signal late.
    file, folder = write(LONGER.replace("samples = 250", "samples = 20_000")), tmp_path / "out"
    process = start(file, folder, "--workers", "1", "--chunk", "2")
    wait_for_parts(process, folder, 2)
    os.killpg(process.pid, signal.SIGINT)  # to every process, as a terminal does
    _, errors = process.communicate(timeout=60.0)
    assert process.returncode == 130, errors
    assert "the same command continues" in " ".join(errors.split())
    assert "Traceback" not in errors
    assert 0 < len(Store(folder, load_study(file)).missing()) <= 20_000 - 2 * 2


@pytest.mark.parametrize(("count", "threads", "size"), [(10, 2, 1), (160, 2, 10), (10**6, 4, 3333), (1, 64, 1)])
def test_chunk_size(small: Campaign, count: int, threads: int, size: int) -> None:
    assert chunk_size(small, count, threads) == size  # 3333 samples of 0.3 s take about 200 s
    assert chunk_size(replace(small, fmu="EMCAS.fmu"), count, threads) == min(size, 66)
