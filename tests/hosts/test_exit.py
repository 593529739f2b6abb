"""The end of a process that ran the Python FMU: nothing is released twice."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from .host import tool

HERE = Path(__file__).parent
RUN = """
import sys
sys.path.insert(0, sys.argv[2])
from host import OK, Fmu, Instance
unit = Instance(Fmu(sys.argv[1]))
assert max(unit.initialize()) == OK
assert unit.run(0.0, 0.01, 1e-3, fin_command=0.1) == OK
unit.free()
print("done")
"""


@pytest.mark.slow
@pytest.mark.fmu
def test_a_python_host_ends_without_touching_freed_memory(python: Path, linux: None) -> None:
    """The wrapper releases its state as the process ends, and its library's finalizer did so again."""
    valgrind = tool("valgrind", "valgrind")
    done = subprocess.run([valgrind, "--num-callers=6", sys.executable, "-I", "-S", "-c", RUN, python,
                           HERE.parent / "fmu"],
                          env={**os.environ, "PYTHONMALLOC": "malloc"}, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr[-3000:]
    assert done.stdout == "done\n"
    # The interpreter and the loader have findings of their own; none may be of the wrapper's end.
    assert "ERROR SUMMARY" in done.stderr
    assert "finalizePythonInterpreter" not in done.stderr
