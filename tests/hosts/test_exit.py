"""The end of a process that has run the Python FMU: no memory is released twice."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from .host import tool

HERE = Path(__file__).parent
RUN = """
import shutil, sys
from pathlib import Path
host, before, after, *copies = sys.argv[1:]
sys.path.insert(0, host)
from host import OK, Fmu, Instance
class Resources(type(Path())):
    def as_uri(self):
        return f"file://{before}{self}{after}"
for copy in copies:
    fmu = Fmu(copy)
    fmu.folder = Resources(copy)
    unit = Instance(fmu)
    assert max(unit.initialize()) == OK
    assert unit.run(0.0, 0.01, 1e-3, fin_command=0.1) == OK
    unit.free()
    shutil.rmtree(copy)
print("done")
"""


@pytest.mark.slow
@pytest.mark.fmu
@pytest.mark.parametrize(("before", "after", "link", "count"), [
    ("", "", False, 1), ("/", "/", False, 1), ("", "", True, 2)])
def test_python_host_does_not_use_freed_memory_at_its_end(python: Path, linux: None, tmp_path: Path, before: str,
                                                          after: str, link: bool, count: int) -> None:
    """pythonfmu's wrapper alone would release its state twice: at the end of the process and in its finalizer.

    The host unpacks a copy for each instance, and deletes it. The URI of the resources has different spellings.
    """
    valgrind = tool("valgrind", "valgrind")
    copies = [shutil.copytree(python, tmp_path / "here" / str(k)) for k in range(count)]
    if link:
        (tmp_path / "there").symlink_to(tmp_path / "here")
        copies = [tmp_path / "there" / copy.name for copy in copies]
    done = subprocess.run([valgrind, "--num-callers=6", sys.executable, "-I", "-S", "-c", RUN, HERE.parent / "fmu",
                           before, after, *copies],
                          env={**os.environ, "PYTHONMALLOC": "malloc"}, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr[-3000:]
    assert done.stdout == "done\n"
    # valgrind may report errors in the interpreter and the loader, but none in the wrapper's finalizer.
    assert "ERROR SUMMARY" in done.stderr
    assert "finalizePythonInterpreter" not in done.stderr
