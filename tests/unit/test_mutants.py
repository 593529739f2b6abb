"""The tool that changes signs, operators and constants (`tests/mutants.py`), on a file of one of each."""

from __future__ import annotations

import ast
from pathlib import Path

from tests.mutants import ROOT, applied, mutants

SOURCE = '''"""A docstring with 1 + 1."""
def f(a: Literal[3], b=-2.0):
    if a < 0 and b:
        raise ValueError(f"{a + 1}")
    return max(a, b) * (
        a - 10)
'''
CHANGED = {"def f(a: Literal[3], b=2.0):", "def f(a: Literal[3], b=-2.2):", "if a >= 0 and b:", "if a < 1 and b:",
           "if a < 0 or b:", "return min(a, b) * (", "return max(a, b) / (", "a + 10)", "a - 11)"}


def test_each_change_is_made_and_put_back(tmp_path: Path) -> None:
    (tmp_path / "f.py").write_text(SOURCE, encoding="utf-8")
    found = set()
    for mutant in mutants(["f.py"], tmp_path):
        with applied(mutant, tmp_path) as change:
            lines = (tmp_path / "f.py").read_text(encoding="utf-8").splitlines()
            assert [new for new, old in zip(lines, SOURCE.splitlines()) if new != old] == [lines[mutant.line - 1]]
            found.add(change.split(" -> ")[1])
        assert (tmp_path / "f.py").read_text(encoding="utf-8") == SOURCE
    assert found == CHANGED


def test_a_mutant_of_the_package_is_another_program() -> None:
    for mutant in mutants(["emcas_fmu/physics", "emcas_fmu/runtime/schedule.py"])[::40]:
        text = (ROOT / mutant.file).read_bytes()
        changed = ast.parse(text[:mutant.begin] + mutant.new.encode() + text[mutant.end:])
        assert ast.dump(changed) != ast.dump(ast.parse(text))
