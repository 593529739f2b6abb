"""The tool `tests/mutants.py` changes every sign, operator and constant of a file, and restores the file."""

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

C = """#define TWO 2 + 2  /* as it is */
/* 1 + 1 */
double f(double *x) { if (x[1] <= 0.5 && *x) *x += 2.0 - g("%d / 3"); return *x; }
"""
C_CHANGED = {"x[2] <= 0.5 && *x) *x += 2.0 - g", "x[1] > 0.5 && *x) *x += 2.0 - g", "x[1] <= 0.55 && *x) *x += 2.0 - g",
             "x[1] <= 0.5 || *x) *x += 2.0 - g", "x[1] <= 0.5 && *x) *x -= 2.0 - g", "x[1] <= 0.5 && *x) *x += 2.2 - g",
             "x[1] <= 0.5 && *x) *x += 2.0 + g"}


def test_each_change_of_python_is_made_and_undone(tmp_path: Path) -> None:
    (tmp_path / "f.py").write_text(SOURCE, encoding="utf-8")
    changes = set()
    for mutant in mutants(["f.py"], tmp_path):
        with applied(mutant, tmp_path) as change:
            lines = (tmp_path / "f.py").read_text(encoding="utf-8").splitlines()
            assert [new for new, old in zip(lines, SOURCE.splitlines()) if new != old] == [lines[mutant.line - 1]]
            changes.add(change.split(" -> ")[1])
        assert (tmp_path / "f.py").read_text(encoding="utf-8") == SOURCE
    assert changes == CHANGED


def test_each_change_of_c_is_made(tmp_path: Path) -> None:
    (tmp_path / "f.h").write_text(C, encoding="utf-8")
    lines = [(C[:mutant.begin] + mutant.new + C[mutant.end:]).splitlines() for mutant in mutants(["."], tmp_path, True)]
    assert {line.split("if (")[1].split("(")[0] for _, _, line in lines} == C_CHANGED


def test_every_name_in_the_quick_check_exists() -> None:
    """Pytest ignores a wrong name of an excluded test: the test would run again without notice."""
    for line in (ROOT / "tests/quick.txt").read_text(encoding="utf-8").splitlines():
        path, _, test = line.removeprefix("--ignore=").removeprefix("--deselect=").partition("::")
        if "tests/" in path:
            name = test.partition("[")[0]
            text = (ROOT / path).read_text(encoding="utf-8") if test else str((ROOT / path).exists())
            assert (f"def {name}(" if test else "True") in text, line


def test_mutant_of_the_package_is_another_program() -> None:
    for mutant in mutants(["emcas_fmu/physics", "emcas_fmu/runtime/schedule.py"])[::40]:
        text = (ROOT / mutant.file).read_bytes()
        changed = ast.parse(text[:mutant.begin] + mutant.new.encode() + text[mutant.end:])
        assert ast.dump(changed) != ast.dump(ast.parse(text))
