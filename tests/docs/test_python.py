"""The code blocks of docs/use/python.md run one after another."""

from __future__ import annotations

import ast
import importlib.util
import shutil
import subprocess
import sys
from math import degrees
from pathlib import Path

import pytest

import emcas_fmu
from emcas_fmu.runtime import library
from tests.hosts.host import missing

from .recipes import ROOT, recipes

BLOCKS = recipes("use/python.md")


def test_page_uses_the_whole_interface_except_types_of_arguments_and_results() -> None:
    nodes = [node for language, text in BLOCKS.values() if language == "python" for node in ast.walk(ast.parse(text))]
    used = {alias.name for node in nodes if isinstance(node, ast.ImportFrom) and node.module == "emcas_fmu"
            for alias in node.names}
    assert set(emcas_fmu.__all__) - used == {"Built", "EmcasError", "Excitation", "ParameterSet", "Response",
                                             "Validation"}


@pytest.mark.fmu
@pytest.mark.slow  # about 10 s: it builds, validates, analyses and tunes
def test_code_blocks_run(tmp_path: Path) -> None:
    for module in ("pandas", "casadi", "control"):
        if importlib.util.find_spec(module) is None:
            missing(f"there is no {module} (pip install -e '.[test]')")
    if not library.available("nonlinear"):
        missing("there is no C compiler")
    shutil.copytree(ROOT / "examples/own_actuator", tmp_path / "examples/own_actuator")
    (tmp_path / "requirements.toml").write_text(BLOCKS["requirements"][1], encoding="utf-8")
    program = "".join(f"print('== {name}')\n{text}" for name, (language, text) in BLOCKS.items()
                      if language == "python")
    run = subprocess.run([sys.executable, "-W", "error", "-c", program], cwd=tmp_path, capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    printed = {name: lines for name, *lines in map(str.splitlines, run.stdout.split("== ")[1:])}
    assert printed["load"][0].startswith("39.0 ")
    assert printed["change"][0].endswith("is -1 1/s; it must be within 0 .. 100000 1/s")
    end, angle, in_degrees = map(float, printed["response"][0].split())
    assert end == 0.3
    assert abs(in_degrees - 10.0) < 0.2  # Table 2's accuracy
    assert abs(degrees(angle) - in_degrees) < 1e-12  # the same number, rounded differently
    assert all((tmp_path / name).stat().st_size for name in ("response.csv", "response.svg", "EMCAS.fmu"))
    assert printed["build"][1] == "True the one criterion is met []"
    assert 10.0 < float(printed["analyse"][0].split()[0]) < 40.0  # Hz, of the example; 21 Hz at zero
    assert printed["tune"][0].startswith("True ")
    time, least, most = map(float, printed["batch"][0].split())
    assert (time, least < most) == (0.2, True)
    assert 30.0 < float(printed["fins"][0].split()[0]) < 39.0  # 210 A lower the source's voltage by 4.2 V
