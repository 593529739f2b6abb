"""One run at a time in a folder; a killed one leaves nothing."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from emcas_fmu.studies.campaign.distributions import CampaignError
from emcas_fmu.studies.campaign.store import Store
from emcas_fmu.studies.campaign.study import Study, load_study

from .conftest import SMALL, Write, campaign

HOLDING = """
import sys
from pathlib import Path
from emcas_fmu.studies.campaign.store import Store
from emcas_fmu.studies.campaign.study import load_study
store = Store(Path(sys.argv[1]), load_study(Path(sys.argv[2])))
print("held", flush=True)
sys.stdin.read()
"""


@pytest.fixture
def other(write: Write, tmp_path: Path) -> Iterator[subprocess.Popen[str]]:
    """Another process that writes to the folder `out`."""
    process = subprocess.Popen([sys.executable, "-c", HOLDING, str(tmp_path / "out"), str(write(SMALL))],
                               stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert process.stdout.readline() == "held\n"
    yield process
    process.kill()
    process.communicate()


def test_a_second_run_is_refused(tmp_path: Path, other: subprocess.Popen[str]) -> None:
    partial = tmp_path / "out" / "samples" / ".part-000000000.parquet.1.partial"
    partial.write_bytes(b"PAR1")  # what the other is writing
    for _ in range(2):  # asking does not change who has it
        done = campaign(tmp_path / "small.toml", "--output", tmp_path / "out", "--workers", 0)
        assert done.exit_code == 2, done.output
        said = " ".join(done.stderr.split())
        assert f"another process (pid {other.pid} on " in said
        assert f"writes to {tmp_path / 'out'}" in said
    assert partial.exists()
    assert list((tmp_path / "out" / "samples").glob("part-*")) == []


@pytest.mark.slow
def test_a_killed_run_holds_nothing(tmp_path: Path, other: subprocess.Popen[str]) -> None:
    other.kill()
    other.wait()
    with Store(tmp_path / "out", load_study(tmp_path / "small.toml")) as store:
        assert len(store.missing()) == 24


def test_one_process_is_no_exception(write: Write, small: Study, tmp_path: Path) -> None:
    with Store(tmp_path / "out", small), pytest.raises(CampaignError, match="another process"):
        Store(tmp_path / "out", small)
    changed = load_study(write(SMALL.replace("seed = 5", "seed = 7")))
    for _ in range(2):  # a refusal lets go of the folder
        with pytest.raises(CampaignError, match="contains another campaign"):
            Store(tmp_path / "out", changed)
    Store(tmp_path / "out", small).close()
