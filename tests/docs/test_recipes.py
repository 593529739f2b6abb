"""The tested code blocks of docs/use/hosts.md run."""

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
def folder(shipped_unit: Callable[..., Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with EMCAS.fmu, EMCAS3.fmu, EMCAS4.fmu, host.c and FMI's headers."""
    folder = tmp_path_factory.mktemp("recipes")
    standard_headers(folder / "headers")
    for name, options in (("EMCAS", {}), ("EMCAS3", {"fmi": "3"}), ("EMCAS4", {"fins": 4})):
        shutil.copy(shipped_unit(**options), folder / f"{name}.fmu")
    shutil.copy(ROOT / "examples/c_host/host.c", folder)
    return folder


def run(name: str, folder: Path) -> str:
    """Run a block in a separate process and return the last line that it prints, or ""."""
    language, text = BLOCKS[name]
    program = [sys.executable, "-W", "error", "-c", text] if language == "python" else ["sh", "-euc", text]
    process = subprocess.run(program, cwd=folder, capture_output=True, text=True, timeout=60)
    assert process.returncode == 0, process.stderr
    return (process.stdout.splitlines() or [""])[-1]


def test_every_block_is_run() -> None:
    assert sorted(BLOCKS) == [
        "c_fmi3", "c_fmi3_build", "c_host", "c_loop", "c_loop_build",
        "fmpy", "fmpy_fmi3", "fmpy_four", "fmpy_loop", "libcosim"]


def test_fmpy_reaches_the_command(folder: Path) -> None:
    """0.25 s after a command of 10 deg a part of the overshoot under load is left."""
    assert abs(float(run("fmpy", folder)) - 10.0) < 0.5


def test_fmpy_in_a_loop_reaches_the_command(folder: Path) -> None:
    assert abs(float(run("fmpy_loop", folder)) - 0.2) < 0.02


def test_fmi_3_in_fmpy_has_events_and_reaches_the_command(folder: Path) -> None:
    rows, angle = run("fmpy_fmi3", folder).split()
    assert int(rows) > 41  # rows of 5 ms, and one more for each event
    assert abs(float(angle) - 0.1) < 0.01  # a part of the overshoot is left


@pytest.mark.slow
def test_fmi_3_in_c_has_events_and_reaches_the_command(folder: Path) -> None:
    """Events do not shift the loop's steps. The hinge moment at 0.2 rad is 40 N.m."""
    (folder / "loop3.c").write_text(BLOCKS["c_fmi3"][1], encoding="utf-8")
    run("c_fmi3_build", folder)
    rows = [line.split() for line in (folder / "loop3.txt").read_text(encoding="utf-8").splitlines()]
    assert sum(len(row) == 2 for row in rows) >= 290
    assert 3 <= sum(row[-1] == "event" for row in rows) < 100
    assert abs(float(rows[-1][1]) - 0.2) < 0.02  # a part of the overshoot under load is left


def test_fmpy_with_four_fins(folder: Path) -> None:
    run("fmpy_four", folder)  # contains assertions


def test_libcosim_reaches_the_command(folder: Path) -> None:
    if importlib.util.find_spec("libcosimpy") is None:
        missing("there is no libcosimpy (pip install libcosimpy)")
    assert abs(float(run("libcosim", folder)) - 0.1) < 0.01


@pytest.fixture(scope="module")
def loop(folder: Path) -> Path:
    """The folder with the page's C program."""
    (folder / "loop.c").write_text(BLOCKS["c_loop"][1], encoding="utf-8")
    return folder


def test_c_loop_has_the_kernels_response(loop: Path) -> None:
    """The hinge moments are equal. Only constants that a compiler folds can differ: 1e-9 rad allows for their growth.

    It is far below an encoder's count, 1e-5 rad.
    """
    for name in ("cc", "unzip"):
        tool(name, {"cc": "gcc"}.get(name, name))
    run("c_loop_build", loop)
    rows = np.loadtxt(loop / "loop.txt")
    assert rows.shape == (300, 2)
    angle = np.concatenate([[0.0], rows[:, 1]])
    found = simulate(load_parameters().values, 0.3, kernel="python", fin_command=0.2, aero_torque=-200.0 * angle)
    assert abs(angle[-1] - 0.2) < 0.02  # a part of the overshoot is left
    assert np.abs(found["fin_angle"] - angle).max() < 1e-9


def test_c_loop_compiles_without_warnings(loop: Path, tmp_path: Path) -> None:
    program = tool("gcc", "gcc")
    shutil.unpack_archive(loop / "EMCAS.fmu", tmp_path, "zip")
    for language in (["-std=c11"], ["-x", "c++"]):
        compiled = subprocess.run([program, *language, "-pedantic", "-Wall", "-Wextra", "-Werror",
                                   f"-I{loop}/headers", f"-I{tmp_path}/sources", "-fsyntax-only", loop / "loop.c"],
                                  capture_output=True, text=True)
        assert compiled.returncode == 0, compiled.stderr


def test_c_host_has_the_response_of_fmpy(folder: Path) -> None:
    """The hinge moments are equal, and all bits of the response."""
    for name in ("cc", "unzip"):
        tool(name, {"cc": "gcc"}.get(name, name))
    run("c_host", folder)
    with (folder / "response.csv").open(encoding="utf-8", newline="") as file:
        rows = [{key: float(value) for key, value in row.items()} for row in csv.DictReader(file)]
    assert len(rows) == 301
    assert abs(rows[-1]["fin_angle"] - 0.2) < 0.02
    assert all(math.isfinite(value) for row in rows for value in row.values())
    inputs = {"fin_command": [0.0 if k < 50 else 0.2 for k in range(301)],
              "aero_torque": [-200.0 * row["fin_angle"] for row in rows]}
    with open_subject(folder / "EMCAS.fmu") as subject:
        found = subject.run(Excitation("host", {key: np.array(column) for key, column in inputs.items()}),
                            outputs=["fin_angle"])
    assert found.columns["fin_angle"].tolist() == [row["fin_angle"] for row in rows]


@pytest.mark.parametrize("compiler", [["gcc", "-std=c11"], ["g++", "-x", "c++"]], ids=["C", "C++"])
def test_c_host_compiles_without_warnings(folder: Path, tmp_path: Path, compiler: list[str]) -> None:
    program = tool(compiler[0], compiler[0])
    compiled = subprocess.run([program, *compiler[1:], "-pedantic", "-Wall", "-Wextra", "-Werror",
                               f"-I{folder}/headers", ROOT / "examples/c_host/host.c", "-o", tmp_path / "host",
                               "-ldl"], capture_output=True, text=True)
    assert compiled.returncode == 0, compiled.stderr
    bad = subprocess.run([tmp_path / "host", ROOT], capture_output=True, text=True)
    assert bad.returncode == 1
    assert "is this an unpacked FMU?" in bad.stderr
