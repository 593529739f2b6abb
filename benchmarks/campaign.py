"""Throughput of campaigns: one process, Dask with one and two workers, a worker killed mid-run; bytes and overhead.

    python benchmarks/campaign.py [--samples 400] [--workers 1 2] [--json FILE]

Two campaigns: `short` (one step of 0.6 s a sample) and `full`, models/campaign.toml (two steps and a sweep
of 12 s). Rates are samples per second of wall time once workers are up, compared in turn, round after
round, so that a machine that changes its speed hurts all alike.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import statistics
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from emcas_fmu.studies.campaign.run import by_dask, in_process, local_client
from emcas_fmu.studies.campaign.sample import rows
from emcas_fmu.studies.campaign.store import Store
from emcas_fmu.studies.campaign.study import Campaign, load_study
from emcas_fmu.support.files import models_directory
from tests.campaign.conftest import BASIC

SHORT = BASIC.replace("samples = 24", "samples = 100000").replace("0.3 s", "0.6 s")
SHARE = 40  # of the full campaign's samples to the short one's, which cost so much less


def nothing(*_: Any) -> dict[str, Any]:
    """A task's work without the work."""
    return {}


class Contest:
    """One campaign run in several ways."""

    def __init__(self, study: Campaign, folder: Path) -> None:
        self.study, self._folder, self._runs = study, folder, 0
        self.bytes = 0.0

    def store(self) -> Store:
        """A folder of its own for every run."""
        self._runs += 1
        return Store(self._folder / str(self._runs), self.study)

    def rate(self, run: Callable[[Store, Any], None]) -> float:
        """Samples per second."""
        with self.store() as store:
            missing = store.missing()
            begin = time.perf_counter()
            run(store, missing)
            taken = time.perf_counter() - begin
            if len(store.missing()):
                raise RuntimeError("samples are missing")
        parts = list(store.folder.glob("samples/*.parquet"))
        self.bytes = sum(part.stat().st_size for part in parts) / self.study.samples
        return self.study.samples / taken

    def alone(self) -> float:
        """In this process, without Dask."""
        return self.rate(lambda store, missing: in_process(self.study, missing, store.write))

    def by(self, client: Any, keep: Callable[[Store], Callable[[Any], Any]] | None = None) -> float:
        """By workers."""
        return self.rate(lambda store, missing: by_dask(
            client, self.study, missing, keep(store) if keep else store.write))


def killing(client: Any) -> Callable[[Store], Callable[[Any], Any]]:
    """A `keep` that kills a worker when the first rows arrive."""
    victims = list(client.run(os.getpid).values())

    def made(store: Store) -> Callable[[Any], Any]:
        def keep(found: Any) -> None:
            if victims:
                os.kill(victims[0], signal.SIGKILL)
                victims.clear()
            store.write(found)
        return keep
    return made


def overhead(client: Any, study: Campaign) -> float:
    """What Dask and this program take for a task [ms], drawing one sample included."""
    tasks = replace(study, samples=1000)
    missing = np.arange(tasks.samples)
    begin = time.perf_counter()
    by_dask(client, tasks, missing, lambda _: None, 1, nothing)
    return (time.perf_counter() - begin) / len(missing) * 1e3


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--samples", type=int, default=400, help="of the full campaign (the short: 40 times as many)")
    parser.add_argument("--workers", type=int, nargs="+", default=[1, 2], help="numbers of workers (default 1 2)")
    parser.add_argument("--repeat", type=int, default=3, help="rounds (default 3)")
    parser.add_argument("--json", type=Path, help="write the figures to this file")
    arguments = parser.parse_args()
    results: dict[str, Any] = {}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "short.toml").write_text(SHORT, encoding="utf-8")
        files = {"short": (folder / "short.toml", SHARE), "full": (models_directory() / "campaign.toml", 1)}
        for label, (file, share) in files.items():
            study = replace(load_study(file), samples=arguments.samples * share)
            (folder / label).mkdir()
            contest = Contest(study, folder / label)
            first = study.draw([0])
            rates: dict[str, list[float]] = {}
            for _ in range(arguments.repeat):
                rates.setdefault("one process", []).append(contest.alone())
                for workers in arguments.workers:
                    with local_client(workers) as client:
                        overhead(client, study)  # connections open
                        client.run(rows, study, [0], first)  # libraries loaded, kernel bound
                        rates.setdefault(f"{workers} worker{'s' * (workers > 1)}", []).append(contest.by(client))
                        if workers > 1:
                            rates.setdefault(f"{workers} workers, one killed", []).append(
                                contest.by(client, killing(client)))
            with local_client(max(arguments.workers)) as client:
                overhead(client, study)
                task = overhead(client, study)
            begin = time.perf_counter()
            study.draw(range(1000) if study.samples >= 1000 else range(study.samples))
            draw = (time.perf_counter() - begin) / min(study.samples, 1000) * 1e6
            results[label] = {"samples": study.samples, "rates": rates, "bytes": contest.bytes,
                              "task_ms": task, "draw_us": draw}
            alone = statistics.median(rates["one process"])
            print(f"{label}: {study.samples} samples, {1e3 / alone:.2f} ms a sample in one process")
            for what, found in rates.items():
                print(f"  {what:24} {statistics.median(found):8.1f} /s   x {statistics.median(found) / alone:.2f}")
            print(f"  {contest.bytes:.0f} bytes a sample, {task:.2f} ms a task, {draw:.0f} us to draw one")
    if arguments.json:
        arguments.json.write_text(json.dumps(results, indent=1), encoding="utf-8")


if __name__ == "__main__":
    main()
