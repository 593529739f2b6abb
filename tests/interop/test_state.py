"""An FMU state saved in one process continues in another."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path
from typing import Any

import pytest

from .units import UNITS

pytestmark = [pytest.mark.fmu, pytest.mark.slow]
TESTS = Path(__file__).parents[1]
# Any Python can run it: it needs the standard library only.
RUN = """
import json, pathlib, sys
sys.path.insert(0, sys.argv[1])
from host import OK, Fmu, Instance
unit, state, action = Instance(Fmu(sys.argv[2])), pathlib.Path(sys.argv[3]), sys.argv[4]
begin, end, commands, loads, parameters = json.loads(sys.argv[5])
assert max(unit.initialize(**({} if action == "restore" else parameters))) == OK
if action == "restore":
    assert unit.restore(state.read_bytes()) == OK
rows = []
for k in range(begin, end):
    inputs = {name: 0.15 if k < 120 else -0.1 for name in commands} | {name: -12.0 if k > 60 else 0.0 for name in loads}
    assert max(unit.set(name, value) for name, value in inputs.items()) == OK
    assert unit.step(k * 1e-3, 1e-3) == OK
    rows.append({name: float(value).hex() for name, value in unit.outputs().items()})
if action == "save":
    state.write_bytes(unit.serialize(unit.save()))
unit.free()
assert "emcas_fmu" not in sys.modules
print(json.dumps(rows))
"""
MIDDLE, END = 100, 200  # ms; at 100 ms the fin moves, and the drive's delay buffer contains commands


def interpreters() -> list[str]:
    """Return this Python, and the system's if its version differs and is supported."""
    system = shutil.which("python3", path="/usr/bin") or sys.executable
    done = subprocess.run([system, "-c", "import sys; print(*sys.version_info[:2])"], capture_output=True, text=True)
    version = tuple(map(int, done.stdout.split()))
    return [sys.executable, *([system] if (3, 10) <= version != sys.version_info[:2] else [])]


@pytest.mark.parametrize("unit", [name for name in UNITS if name != "four3"])  # four3 has names of arrays
def test_state_continues_with_the_same_bits_in_another_process(unit: str, tmp_path: Path) -> None:
    """The other process sets no parameter and makes no step before it restores the state."""
    with zipfile.ZipFile(UNITS[unit].build(tmp_path)) as archive:
        archive.extractall(tmp_path / "unpacked")

    def rows(program: str, begin: int, end: int, action: str) -> Any:
        task = json.dumps([begin, end, UNITS[unit].commands, UNITS[unit].loads, UNITS[unit].parameters])
        done = subprocess.run([program, "-I", "-S", "-c", RUN, TESTS / "fmu", tmp_path / "unpacked", tmp_path / "state",
                               action, task], capture_output=True, text=True, timeout=120)
        assert done.returncode == 0, done.stderr
        return json.loads(done.stdout)

    whole = rows(sys.executable, 0, END, "")
    assert rows(sys.executable, 0, MIDDLE, "save") == whole[:MIDDLE]
    for program in interpreters():
        assert rows(program, MIDDLE, END, "restore") == whole[MIDDLE:]
    assert max(float.fromhex(row[UNITS[unit].angles[0]]) for row in whole) > 0.1  # rad, of the commanded 0.15 rad
