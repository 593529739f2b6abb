"""What docs/use/hosts.md says is tested runs exactly as printed there."""

from __future__ import annotations

import csv
import importlib.util
import math
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from emcas_fmu.bench.excitation import Excitation
from emcas_fmu.bench.fmu_subject import open_subject
from emcas_fmu.parameters import load_parameters
from emcas_fmu.simulation import simulate
from tests.hosts.host import missing, standard_headers, tool

from .recipes import ROOT, recipes

pytestmark = pytest.mark.fmu

BLOCKS = recipes("use/hosts.md")


@pytest.fixture(scope="module")
def place(shipped_unit: Callable[..., Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with EMCAS.fmu, EMCAS3.fmu, EMCAS4.fmu, host.c and FMI's headers, as a reader has them."""
    folder = tmp_path_factory.mktemp("recipes")
    standard_headers(folder / "headers")
    for name, options in (("EMCAS", {}), ("EMCAS3", {"fmi": "3"}), ("EMCAS4", {"fins": 4})):
        shutil.copy(shipped_unit(**options), folder / f"{name}.fmu")
    shutil.copy(ROOT / "examples/c_host/host.c", folder)
    return folder


def run(name: str, place: Path) -> str:
    """The last line a block prints, run in a separate process; nothing if it prints none."""
    language, text = BLOCKS[name]
    program = [sys.executable, "-W", "error", "-c", text] if language == "python" else ["sh", "-euc", text]
    done = subprocess.run(program, cwd=place, capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    return (done.stdout.splitlines() or [""])[-1]


def test_every_block_is_run() -> None:
    assert sorted(BLOCKS) == [
        "c_fmi3", "c_fmi3_build", "c_host", "c_loop", "c_loop_build",
        "fmpy", "fmpy_fmi3", "fmpy_four", "fmpy_loop", "libcosim"]


def test_fmpy(place: Path) -> None:
    """At its command of 10 deg except for the rest of an overshoot under load, 0.25 s after the command."""
    assert abs(float(run("fmpy", place)) - 10.0) < 0.5


def test_fmpy_in_a_loop(place: Path) -> None:
    assert abs(float(run("fmpy_loop", place)) - 0.2) < 0.02


def test_fmi_3(place: Path) -> None:
    rows, angle = run("fmpy_fmi3", place).split()
    assert int(rows) > 41  # of 5 ms, and one more for each event
    assert abs(float(angle) - 0.1) < 0.01  # at its command, but for what is left of an overshoot


@pytest.mark.slow
def test_fmi_3_in_c(place: Path) -> None:
    """Events do not move the loop away from its steps: a moment of 40 N.m at 0.2 rad, held as in FMI 2.0's."""
    (place / "loop3.c").write_text(BLOCKS["c_fmi3"][1], encoding="utf-8")
    run("c_fmi3_build", place)
    rows = [line.split() for line in (place / "loop3.txt").read_text(encoding="utf-8").splitlines()]
    assert sum(len(row) == 2 for row in rows) >= 290
    assert 3 <= sum(row[-1] == "event" for row in rows) < 100
    assert abs(float(rows[-1][1]) - 0.2) < 0.02  # at its command, but for what is left of an overshoot under load


def test_four_fins(place: Path) -> None:
    run("fmpy_four", place)  # it asserts


def test_libcosim(place: Path) -> None:
    if importlib.util.find_spec("libcosimpy") is None:
        missing("there is no libcosimpy (pip install libcosimpy)")
    assert abs(float(run("libcosim", place)) - 0.1) < 0.01


@pytest.fixture(scope="module")
def loop(place: Path) -> Path:
    """The folder, with the page's program in C in it."""
    (place / "loop.c").write_text(BLOCKS["c_loop"][1], encoding="utf-8")
    return place


def test_c_loop(loop: Path) -> None:
    """The program in C has the response of the Python kernel for the same hinge moments.

    Neither reorders sums, so that only constants that one compiler folds can differ (here nothing does): 1e-9 rad is
    room for last bits grown over 0.3 s, and far below an encoder's count, 1e-5 rad.
    """
    for name in ("cc", "unzip"):
        tool(name, {"cc": "gcc"}.get(name, name))
    run("c_loop_build", loop)
    rows = np.loadtxt(loop / "loop.txt")
    assert rows.shape == (300, 2)
    angle = np.concatenate([[0.0], rows[:, 1]])
    found = simulate(load_parameters().values, 0.3, kernel="python", fin_command=0.2, aero_torque=-200.0 * angle)
    assert abs(angle[-1] - 0.2) < 0.02  # at its command, but for what is left of an overshoot
    assert np.abs(found["fin_angle"] - angle).max() < 1e-9


def test_c_loop_is_clean(loop: Path, tmp_path: Path) -> None:
    program = tool("gcc", "gcc")
    shutil.unpack_archive(loop / "EMCAS.fmu", tmp_path, "zip")
    for language in (["-std=c11"], ["-x", "c++"]):
        made = subprocess.run([program, *language, "-pedantic", "-Wall", "-Wextra", "-Werror", f"-I{loop}/headers",
                               f"-I{tmp_path}/sources", "-fsyntax-only", loop / "loop.c"],
                              capture_output=True, text=True)
        assert made.returncode == 0, made.stderr


def test_c_host(place: Path) -> None:
    """The response in C is that of fmpy under the same hinge moments, to the last bit."""
    for name in ("cc", "unzip"):
        tool(name, {"cc": "gcc"}.get(name, name))
    run("c_host", place)
    with (place / "response.csv").open(encoding="utf-8", newline="") as file:
        rows = [{key: float(value) for key, value in row.items()} for row in csv.DictReader(file)]
    assert len(rows) == 301
    assert abs(rows[-1]["fin_angle"] - 0.2) < 0.02
    assert all(math.isfinite(value) for row in rows for value in row.values())
    inputs = {"fin_command": [0.0 if k < 50 else 0.2 for k in range(301)],
              "aero_torque": [-200.0 * row["fin_angle"] for row in rows]}
    with open_subject(place / "EMCAS.fmu") as subject:
        found = subject.run(Excitation("host", {key: np.array(column) for key, column in inputs.items()}),
                            outputs=["fin_angle"])
    assert found.columns["fin_angle"].tolist() == [row["fin_angle"] for row in rows]


@pytest.mark.parametrize("compiler", [["gcc", "-std=c11"], ["g++", "-x", "c++"]], ids=["C", "C++"])
def test_c_host_is_clean(place: Path, tmp_path: Path, compiler: list[str]) -> None:
    program = tool(compiler[0], compiler[0])
    made = subprocess.run([program, *compiler[1:], "-pedantic", "-Wall", "-Wextra", "-Werror", f"-I{place}/headers",
                           ROOT / "examples/c_host/host.c", "-o", tmp_path / "host", "-ldl"], capture_output=True,
                          text=True)
    assert made.returncode == 0, made.stderr
    bad = subprocess.run([tmp_path / "host", ROOT], capture_output=True, text=True)
    assert bad.returncode == 1
    assert "is this an unpacked FMU?" in bad.stderr
