"""Commands whose output cannot be written or is not read, and commands that Ctrl-C stops."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from tests.marks import slow
from tests.tools.test_full_disk import OLD, SMALL

EMCAS = f"'{sys.executable}' -m emcas_fmu.cli"
FULL = "error: standard output: cannot be written: the disk is full; free some space or choose another path\n"
pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="needs /dev/full")
# The command receives Ctrl-C's signal at its third step of progress, however slow the machine is.
STOPPED = """
import os, signal, sys
from emcas_fmu.cli import app
from emcas_fmu.commands import common

calls = []

def stepper(bars, label):
    def step(name, done, total):
        calls.append(done)
        if len(calls) == 3:
            os.kill(os.getpid(), signal.SIGINT)
    return step

common.stepper = stepper
app()
"""


def shell(command: str, folder: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(["bash", "-c", command], cwd=folder, capture_output=True, text=True, timeout=300, check=False)


@pytest.mark.parametrize("arguments", [
    "--version", "parameters --json", *slow(  # these end in the same code
        "--help", "simulate --help", "parameters", "parameters --sets",
        f"simulate --step 1 --stop 0.1 --kernel python {SMALL} --json x.json",
        f"validate --case step_plus1 {SMALL} --json x.json")])
def test_unwritable_output_is_an_error_of_one_line(arguments: str, tmp_path: Path) -> None:
    done = shell(f"{EMCAS} {arguments} > /dev/full", tmp_path)
    assert done.returncode == 2
    assert done.stderr == FULL
    assert [path.name for path in tmp_path.iterdir()] == ["x.json"] * ("x.json" in arguments)


def test_unwritable_output_of_build_fmu_is_an_error_of_one_line(tmp_path: Path) -> None:
    script = Path(__file__).parents[2] / "build_fmu.py"
    done = shell(f"'{sys.executable}' {script} --help > /dev/full", tmp_path)
    assert (done.returncode, done.stderr) == (2, FULL)


@pytest.mark.parametrize("arguments", ["parameters --json", *slow("--help", "parameters")])
# The command may have written everything before head ends.
@pytest.mark.parametrize(("reader", "codes"), [("true", {"141"}), *slow(("head -1", {"0", "141"}))])
def test_unread_output_causes_no_message(arguments: str, reader: str, codes: set[str], tmp_path: Path) -> None:
    done = shell(f"{EMCAS} {arguments} | {reader}; echo ${{PIPESTATUS[0]}} >&2", tmp_path)
    assert done.stderr.strip() in codes


@pytest.mark.parametrize("arguments", [
    f"baseline record {SMALL} --fresh -o made", *slow(
        "reference --directory made", f"report {SMALL} -o made/page.html --json made/x.json",
        f"validate {SMALL} --json made/x.json --report made/page.html")])
def test_ctrl_c_changes_no_file(arguments: str, tmp_path: Path) -> None:
    folder = tmp_path / "made"
    folder.mkdir()
    for name in ("provenance.toml", "EMCAS_step_plus1_ref.csv", "baseline.toml", "step.csv", "page.html", "x.json"):
        (folder / name).write_bytes(OLD)
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    done = subprocess.run([sys.executable, "-c", STOPPED, *arguments.split()], cwd=tmp_path, capture_output=True,
                          text=True, timeout=300, check=False)
    assert done.returncode == 130, done.stderr
    assert "Traceback" not in done.stderr
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == before
    assert [path.name for path in tmp_path.iterdir()] == ["made"]
