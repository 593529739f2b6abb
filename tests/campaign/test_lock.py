"""Only one run at a time may write to a folder; a killed run leaves no lock."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from emcas_fmu.studies.campaign.distributions import CampaignError
from emcas_fmu.studies.campaign.store import Store
from emcas_fmu.studies.campaign.study import Campaign, load_study

from .conftest import SMALL, Write, campaign

LOCK_AND_WAIT = """
import sys
from pathlib import Path
from emcas_fmu.studies.campaign.store import Store
from emcas_fmu.studies.campaign.study import load_study
store = Store(Path(sys.argv[1]), load_study(Path(sys.argv[2])))
print("locked", flush=True)
sys.stdin.read()
"""


@pytest.fixture
def other(write: Write, tmp_path: Path) -> Iterator[subprocess.Popen[str]]:
    """Another process that has locked the folder `out`."""
    process = subprocess.Popen([sys.executable, "-c", LOCK_AND_WAIT, str(tmp_path / "out"), str(write(SMALL))],
                               stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert process.stdout.readline() == "locked\n"
    yield process
    process.kill()
    process.communicate()


def test_second_run_is_refused(tmp_path: Path, other: subprocess.Popen[str]) -> None:
    partial = tmp_path / "out" / "samples" / ".part-000000000.parquet.1.partial"
    partial.write_bytes(b"PAR1")  # file that the other process is writing
    for _ in range(2):  # a refused run does not release the lock
        result = campaign(tmp_path / "small.toml", "--output", tmp_path / "out", "--workers", 0)
        assert result.exit_code == 2, result.output
        message = " ".join(result.stderr.split())
        assert f"another process (pid {other.pid} on " in message
        assert f"writes to {tmp_path / 'out'}" in message
    assert partial.exists()
    assert list((tmp_path / "out" / "samples").glob("part-*")) == []


@pytest.mark.slow
def test_killed_run_releases_the_lock(tmp_path: Path, other: subprocess.Popen[str]) -> None:
    other.kill()
    other.wait()
    with Store(tmp_path / "out", load_study(tmp_path / "small.toml")) as store:
        assert len(store.missing()) == 24


def test_second_store_in_the_same_process_is_refused(write: Write, small: Campaign, tmp_path: Path) -> None:
    with Store(tmp_path / "out", small), pytest.raises(CampaignError, match="another process"):
        Store(tmp_path / "out", small)
    changed = load_study(write(SMALL.replace("seed = 5", "seed = 7")))
    for _ in range(2):  # a refused store releases its lock
        with pytest.raises(CampaignError, match="contains another campaign"):
            Store(tmp_path / "out", changed)
    Store(tmp_path / "out", small).close()
