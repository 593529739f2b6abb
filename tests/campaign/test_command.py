"""`emcas campaign`: help, outputs, one sample, a running scheduler, errors and exit codes."""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest

from emcas_fmu.bench.writers import plain
from emcas_fmu.studies.campaign.sample import SampleColumns
from emcas_fmu.studies.campaign.store import Store

from .conftest import SMALL, Write, campaign


def test_help_has_examples() -> None:
    result = campaign("--help")
    assert result.exit_code == 0
    for part in ("emcas campaign", "--only", "--scheduler", "130"):
        assert part in result.output


def test_campaign_and_one_of_its_samples(write: Write, tmp_path: Path) -> None:
    file, folder = write(SMALL), tmp_path / "out"
    result = campaign(file, "--output", folder, "--workers", 0, "--chunk", 10)
    assert result.exit_code == 0, result.output
    assert "24 samples; GUID {" in result.output
    assert sorted(p.name for p in folder.iterdir() if p.name != ".lock") == [
        "campaign.json", "samples", "summary.html", "summary.json"]
    assert len(list((folder / "samples").iterdir())) == 3
    stored = pq.read_table(folder / "samples").to_pylist()[17]
    one = campaign(file, "--only", 17, "--json", tmp_path / "one.json")
    assert one.exit_code == 0
    assert "step.rise_time" in one.output
    assert json.loads((tmp_path / "one.json").read_text(encoding="utf-8")) == plain(stored)
    again = campaign(file, "--output", folder, "--workers", 0, "--report", tmp_path / "r.html", "--json",
                     tmp_path / "r.json")
    assert again.exit_code == 0
    assert len(list((folder / "samples").iterdir())) == 3  # no sample was missing
    pages = [path.read_text(encoding="utf-8").splitlines() for path in (tmp_path / "r.html", folder / "summary.html")]
    differing = [line for line, other in zip(*pages, strict=True) if line != other]
    assert all('<th scope="row">made by</th>' in line for line in differing)
    changed = campaign(write(SMALL.replace("seed = 5", "seed = 6")), "--output", folder, "--workers", 0)
    assert changed.exit_code == 2
    assert "campaign.seed: 5 then, 6 now" in changed.stderr.replace("\n", "")


@pytest.mark.slow
def test_failed_samples_are_results_unless_all_fail(write: Write, tmp_path: Path) -> None:
    never = SMALL.replace('"uniform"\nlow = "-6 degC"\nhigh = "24 degC"', '"normal"\nmean = "100 degC"\nsd = "30 K"')
    stop = '[vary."fin.start_angle"]\ndistribution = "uniform"\nlow = "{} deg"\nhigh = "40 deg"\n'
    some = campaign(write(never + stop.format(-10)), "--output", tmp_path / "some", "--workers", 0)
    assert some.exit_code == 0, some.output
    assert "failed: fin.start_angle" in some.output.replace("\n", " ")
    listed = next(line for line in some.output.splitlines() if "see --only" in line)
    index = listed.rpartition("--only ")[2].strip(" )")
    one = campaign(tmp_path / "small.toml", "--only", index)
    assert one.exit_code == 1
    assert "failed" in one.output
    all_ = SMALL.replace("samples = 24", "samples = 3").replace(
        'amplitude = "5 deg"', 'amplitude = { distribution = "choice", levels = ["0 deg"] }')
    none = campaign(write(all_), "--output", tmp_path / "none", "--workers", 0)
    assert none.exit_code == 1
    assert "the step has no height" in none.output


@pytest.mark.slow
def test_running_scheduler_gives_the_same_rows(write: Write, tmp_path: Path, client: Any) -> None:
    file = write(SMALL)
    result = campaign(file, "--output", tmp_path / "there", "--scheduler", client.scheduler.address)
    assert result.exit_code == 0, result.output
    assert campaign(file, "--output", tmp_path / "here", "--workers", 0).exit_code == 0
    there, here = (pq.read_table(tmp_path / side / "samples").sort_by("index") for side in ("there", "here"))
    assert repr(there.to_pylist()) == repr(here.to_pylist())


@pytest.mark.parametrize(("arguments", "message"), [
    (("--scheduler", "tcp://127.0.0.1:1"), "start one with `dask scheduler`"),
    (("--scheduler", "tcp://127.0.0.1:1", "--workers", "2"), "give one of them"),
    (("--only", "24"), "the indices are 0 to 23"),
    (("--fmu", "none.fmu"), "there is no such file"),
    (("--fmu", "none.toml"), "is not an FMU by its name"),
    (("--fin", "2"), "fin 2 must be a fin of an FMU; name the FMU with --fmu"),
    (("--report", "none/x.html"), "there is no folder"),
    (("--output", "small.toml/x"), "is a file; give a folder"),
])
def test_error_names_the_option_and_the_remedy(
        write: Write, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, arguments: tuple[str, ...],
        message: str) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("emcas_fmu.studies.campaign.run._CONNECT", 1.0)
    result = campaign(write(SMALL), *arguments)
    assert result.exit_code == 2, result.output
    assert message in " ".join(result.stderr.split())
    assert "Traceback" not in result.stderr


class Quiet(BaseHTTPRequestHandler):
    """Handler that does not log requests."""

    def log_message(self, format: str, *args: Any) -> None:
        pass


@pytest.fixture
def web_server() -> Iterator[int]:
    """The port of a web server, which does not understand Dask's messages."""
    server = ThreadingHTTPServer(("127.0.0.1", 0), Quiet)
    thread = threading.Thread(target=server.serve_forever)
    thread.start()
    yield server.server_port
    server.shutdown()
    thread.join()
    server.server_close()


def error_of_scheduler(write: Write, address: str) -> str:
    result = campaign(write(SMALL), "--scheduler", address)
    assert result.exit_code == 2, result.output
    return " ".join(result.stderr.split())


@pytest.mark.slow
def test_error_soon_names_an_address_without_a_scheduler(
        write: Write, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, web_server: int, client: Any) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("emcas_fmu.studies.campaign.run._CONNECT", 1.0)
    begin = time.monotonic()
    message = error_of_scheduler(write, f"tcp://127.0.0.1:{web_server}")
    assert time.monotonic() - begin < 15.0  # the limit is 1 s; a busy machine is slower
    assert "no scheduler answers there (within 1 s)" in message
    assert "tcp://host:8786, not that of its dashboard, http://host:8787" in message
    client.wait_for_workers(1, timeout=30)  # on a busy machine it may be missing for a while
    assert "a Worker answers" in error_of_scheduler(write, next(iter(client.scheduler_info()["workers"])))


def test_missing_samples_are_counted_in_the_error(
        write: Write, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A part is removed during the run."""
    write_rows, folder = Store.write, tmp_path / "out"

    def lose(store: Store, rows: SampleColumns) -> Path:
        path = write_rows(store, rows)
        if rows["index"][0] == 10:
            path.unlink()
        return path

    monkeypatch.setattr(Store, "write", lose)
    result = campaign(write(SMALL), "--output", folder, "--workers", 0, "--chunk", 10)
    assert result.exit_code == 1, result.output
    assert "10 of 24 samples are missing" in " ".join(result.stderr.split())
