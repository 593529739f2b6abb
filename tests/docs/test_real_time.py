"""The program with two FMUs in docs/use/real_time.md runs, and an FMU needs the memory that the page says."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import pytest

from emcas_fmu.parameters import load_parameters
from emcas_fmu.simulation import simulate
from tests.fmu.built import lean
from tests.hosts.host import standard_headers, tool
from tests.marks import slow

from .recipes import ROOT, recipes

pytestmark = pytest.mark.fmu
PAGE = "use/real_time.md"
BLOCKS = recipes(PAGE)
SIZE = '#include <stdio.h>\n#include "fmi2.c"\nint main(void) { printf("%d", (int)sizeof(instance)); return 0; }\n'
FLAGS = ("-std=c99", "-O2", "-ffp-contract=off", "-Iheaders", "-IEMCAS/sources")


@pytest.fixture(scope="module")
def folder(shipped_unit: Callable[..., Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the page's two FMUs and files, and FMI's headers."""
    folder = tmp_path_factory.mktemp("real_time")
    (folder / "tuned.toml").write_text(BLOCKS["tuned"][1], encoding="utf-8")
    shutil.copy(shipped_unit(), folder / "EMCAS.fmu")
    lean(load_parameters(folder / "tuned.toml"), folder / "Tuned.fmu", identifier="Tuned")
    standard_headers(folder / "headers")
    (folder / "loop.c").write_text(BLOCKS["loop"][1], encoding="utf-8")
    (folder / "size.c").write_text(SIZE, encoding="utf-8")
    return folder


@pytest.mark.parametrize("compiler", ["gcc", *slow("clang")])
def test_two_fmus_in_one_program_have_the_kernels_responses(folder: Path, compiler: str) -> None:
    """The hinge moments are proportional to the angle. 1e-9 rad allows for constants that a compiler folds."""
    tool("unzip", "unzip")
    unoptimised = folder / f"unoptimised_{compiler}"  # same bits in a third of the time
    unoptimised.write_text(f'#!/bin/sh\nexec {tool(compiler, compiler)} "$@" -O0\n', encoding="utf-8")
    unoptimised.chmod(0o755)
    run = subprocess.run(["sh", "-euc", BLOCKS["build"][1]], cwd=folder, capture_output=True, text=True, timeout=300,
                         env={**os.environ, "CC": str(unoptimised)})
    assert (run.returncode, run.stderr) == (0, "")
    rows = np.loadtxt(folder / "loop.txt")
    assert rows.shape == (300, 3)
    for column, file in ((1, None), (2, folder / "tuned.toml")):
        angle = np.concatenate([[0.0], rows[:, column]])
        found = simulate(load_parameters(file).values, 0.3, kernel="python", fin_command=0.2,
                         aero_torque=-200.0 * angle)
        assert np.abs(found["fin_angle"] - angle).max() < 1e-9
    assert np.abs(rows[:, 1] - rows[:, 2]).max() > 0.01


@pytest.mark.slow
def test_two_fmus_of_fmi_3_link_into_one_library(folder: Path) -> None:
    """Each has only the functions of FMI 3.0 with its prefix."""
    gcc, own = tool("gcc", "gcc"), dict[str, set[str]]()
    for name in ("EMCAS3", "Tuned3"):
        lean(load_parameters(), folder / f"{name}.fmu", identifier=name, fmi="3")
        shutil.unpack_archive(folder / f"{name}.fmu", folder / name, "zip")
        subprocess.run([gcc, "-std=c99", "-fPIC", "-O0", "-Iheaders", "-c", f"{name}/sources/fmi3.c", "-o",
                        f"{name}.o"], cwd=folder, check=True)
        listed = subprocess.run([tool("nm", "binutils"), "-gj", "--defined-only", f"{name}.o"], cwd=folder,
                                capture_output=True, text=True, check=True)
        own[name] = {symbol.removeprefix(f"{name}_") for symbol in listed.stdout.split()}
    subprocess.run([gcc, "-shared", "EMCAS3.o", "Tuned3.o", "-lm", "-o", "both.so"], cwd=folder, check=True)
    assert own["EMCAS3"] == own["Tuned3"]
    assert all(name.startswith("fmi3") for name in own["EMCAS3"])
    assert {"fmi3DoStep", "fmi3InstantiateCoSimulation"} < own["EMCAS3"]


def deepest(graph: str, entry: str) -> int:
    """Return the stack [bytes] of the deepest path of calls from a function, from a call graph written by gcc."""
    nodes = re.findall(r'node: \{ title: "([^"]+)" label: "[^"]*?(\d+) bytes', graph)
    frames = {name: int(size) for name, size in nodes}
    calls: Mapping[str, set[str]] = {name: set() for name in frames}
    for caller, called in re.findall(r'edge: \{ sourcename: "([^"]+)" targetname: "([^"]+)"', graph):
        calls[caller].add(called)
    rules = {name for name in frames if "rules_check" in name}  # called by their address

    def depth(name: str, path: tuple[str, ...] = ()) -> int:
        assert name not in path, "recursion"
        inner = calls.get(name, set()) | (rules if "__indirect_call" in calls.get(name, ()) else set())
        return frames.get(name, 0) + max((depth(each, (*path, name)) for each in inner), default=0)

    (found,) = (name for name in frames if name.endswith(entry))
    return depth(found)


@pytest.mark.slow  # compiles with optimisation
def test_memory_of_an_instance_and_stack_are_those_of_the_page(folder: Path) -> None:
    """The size of an instance is exact. The stack depends on the compiler, but is within the page's limits."""
    gcc, page = tool("gcc", "gcc"), (ROOT / "docs" / PAGE).read_text(encoding="utf-8")
    shutil.unpack_archive(folder / "EMCAS.fmu", folder / "EMCAS", "zip")
    subprocess.run([gcc, *FLAGS, "-O0", "size.c", "-o", "size", "-lm"], cwd=folder, check=True)
    size = subprocess.run([folder / "size"], capture_output=True, text=True, check=True).stdout
    assert f"| an instance [bytes] | {size} |" in page
    compiled = subprocess.run([gcc, *FLAGS, "-fcallgraph-info=su", "-c", "EMCAS/sources/fmi2.c", "-o", "frames.o"],
                              cwd=folder, capture_output=True, text=True)
    assert compiled.returncode == 0, compiled.stderr
    graph = (folder / "frames.ci").read_text(encoding="utf-8")
    assert 1000 < deepest(graph, "EMCAS_fmi2DoStep") < 4096
    assert deepest(graph, "EMCAS_fmi2DoStep") < deepest(graph, "EMCAS_fmi2Instantiate") < 10_000
