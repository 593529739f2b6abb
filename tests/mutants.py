"""Test whether the quick check finds a wrong sign, operator or constant: random mutants, each in a copy of the tree.

    python -m tests.mutants --count 45 --seed 1 [--under emcas_fmu/physics ...] [-n 2]

Prints killed, ALIVE or no effect for each, with its line and change; exit code 1 if fewer than 95 % of the mutants with
an effect were killed. A mutant has no effect if only actuators use its file, and every shipped actuator, alone and with
each extension, computes and declares the same to the last character (`python -m tests.kernels --digest`). A mutant of
another file without effect counts as alive.
"""

from __future__ import annotations

import argparse
import ast
import os
import random
import re
import shutil
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from functools import cache, partial
from pathlib import Path
from queue import SimpleQueue
from typing import NamedTuple

ROOT = Path(__file__).parents[1]
UNDER = tuple(f"emcas_fmu/{name}" for name in (
    "physics", "steppers", "control", "actuators", "extensions", "runtime", "bench"))
ENOUGH = 0.95
TOO_LONG = 900  # s
# Tests of the quick check that run first: they find most mutants, in seconds.
SHARP = {"emcas_fmu/bench": ("tests/bench",),
         "emcas_fmu/runtime": tuple(f"tests/unit/test_{name}.py" for name in ("batch", "compiled", "simulate")),
         "emcas_fmu": ("tests/trajectories",)}
DECLARED = {"physics", "steppers", "control", "actuators", "extensions"}  # the folders whose code defines actuators
_SWAPPED = {ast.Add: "-", ast.Sub: "+", ast.Mult: "/", ast.Div: "*"}
_FLIPPED = {ast.Lt: ">=", ast.GtE: "<", ast.Gt: "<=", ast.LtE: ">", ast.Eq: "!=", ast.NotEq: "=="}
_OTHER = {"minimum": "maximum", "maximum": "minimum", "min": "max", "max": "min"}
_NO_C = re.compile(r'/\*.*?\*/|"(?:\\.|[^"\\\n])*"|^[ \t]*#(?:[^\n]*\\\n)*[^\n]*', re.DOTALL | re.MULTILINE)
_C = re.compile(r"(?<= )(?:[-+*/<>]|[-+]=|[<>=!]=|&&|\|\|)(?= )|(?<![\w.])\d+(?:\.\d+)?(?![\w.])")
_C_SWAPPED = {"+": "-", "-": "+", "*": "/", "/": "*", "+=": "-=", "-=": "+=", "<": ">=", ">=": "<", ">": "<=",
              "<=": ">", "==": "!=", "!=": "==", "&&": "||", "||": "&&"}
_TEXTS = (ast.Raise, ast.JoinedStr, ast.Assert)  # texts of errors and formats, which compute nothing


class Mutant(NamedTuple):
    """One change: the file, its line, begin and end of the changed text [bytes], and the new text."""

    file: str
    line: int
    begin: int
    end: int
    new: str


def _sites(node: ast.AST) -> Iterator[ast.AST]:
    """Yield a tree's nodes without annotations, texts of errors, __repr__ and sizes of caches."""
    for name, value in ast.iter_fields(node):
        if name in ("annotation", "returns"):
            continue
        for child in value if isinstance(value, list) else [value]:
            if isinstance(child, ast.AST) and not isinstance(child, _TEXTS) and not (
                    isinstance(child, ast.FunctionDef) and child.name == "__repr__") and not (
                    isinstance(child, ast.Call) and ast.unparse(child.func) == "lru_cache"):
                yield child
                yield from _sites(child)


def _changed(node: ast.AST, text: bytes, begins: Sequence[int]) -> tuple[int, int, str] | None:
    """Return begin and end of the changed text of a node [bytes] and the new text; None if the node does not change."""
    def offset(part: ast.expr, end: bool = False) -> int:
        line, column = (part.end_lineno, part.end_col_offset) if end else (part.lineno, part.col_offset)
        return begins[(line or 1) - 1] + (column or 0)

    def between(left: ast.expr, right: ast.expr, old: bytes, new: str) -> tuple[int, int, str] | None:
        """Return the change of the operator between two nodes; None if a comment is between them."""
        low, high = offset(left, True), offset(right)
        begin = text.find(old, low, high)
        return None if begin < 0 or b"#" in text[low:high] else (begin, begin + len(old), new)

    signs = {ast.Add: b"+", ast.Sub: b"-", ast.Mult: b"*", ast.Div: b"/", ast.Lt: b"<", ast.GtE: b">=", ast.Gt: b">",
           ast.LtE: b"<=", ast.Eq: b"==", ast.NotEq: b"!=", ast.And: b"and", ast.Or: b"or"}
    if isinstance(node, ast.BinOp) and type(node.op) in _SWAPPED:
        return between(node.left, node.right, signs[type(node.op)], _SWAPPED[type(node.op)])
    if isinstance(node, ast.Compare) and type(node.ops[0]) in _FLIPPED:
        return between(node.left, node.comparators[0], signs[type(node.ops[0])], _FLIPPED[type(node.ops[0])])
    if isinstance(node, ast.BoolOp):
        other = "or" if isinstance(node.op, ast.And) else "and"
        return between(node.values[0], node.values[1], signs[type(node.op)], other)
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
        return offset(node), offset(node) + 1, ""
    if isinstance(node, ast.Constant) and isinstance(node.value, (int, float)) and not isinstance(node.value, bool):
        number = node.value
        larger = number + max(1, number // 10) if isinstance(number, int) else number * 1.1 or 0.1
        return offset(node), offset(node, True), repr(larger)
    name = node.func if isinstance(node, ast.Call) else None
    word = name.attr if isinstance(name, ast.Attribute) else name.id if isinstance(name, ast.Name) else ""
    if name is not None and word in _OTHER:
        return offset(name, True) - len(word), offset(name, True), _OTHER[word]
    return None


def _in_c(text: str) -> Iterator[tuple[int, int, str]]:
    """Yield begin, end and new text of the changes of C code, except in comments, texts and preprocessor lines."""
    code = _NO_C.sub(lambda match: " " * len(match[0]), text)
    for match in _C.finditer(code):
        word = match[0]
        if word in _C_SWAPPED:
            yield match.start(), match.end(), _C_SWAPPED[word]
        else:
            yield match.start(), match.end(), repr(float(word) * 1.1 or 0.1) if "." in word else str(int(word) + 1)


def mutants(under: Sequence[str] = UNDER, root: Path = ROOT, c: bool = False) -> list[Mutant]:
    """Return every mutant of the Python files in these folders, or of these files; with `c`, of the C files instead."""
    found = []
    for start in (root / each for each in under):
        for path in sorted(p for p in start.rglob("*.*") if p.suffix in (".c", ".h")) if c else []:
            text = path.read_bytes()
            found += [Mutant(path.relative_to(root).as_posix(), text.count(b"\n", 0, begin) + 1, begin, end, new)
                      for begin, end, new in _in_c(text.decode("ascii"))]
        for path in [] if c else sorted(start.rglob("*.py")) if start.is_dir() else [start]:
            text = path.read_bytes()
            begins = [0]
            for row in text.splitlines(keepends=True):
                begins.append(begins[-1] + len(row))
            for node in _sites(ast.parse(text)):
                if (change := _changed(node, text, begins)) is not None:
                    line = text.count(b"\n", 0, change[0]) + 1
                    found.append(Mutant(path.relative_to(root).as_posix(), line, *change))
    return found


@contextmanager
def applied(mutant: Mutant, tree: Path) -> Iterator[str]:
    """Apply a mutant to a tree, yield the line before and after as text, and restore the file."""
    path = tree / mutant.file
    before = path.read_bytes()
    after = before[:mutant.begin] + mutant.new.encode() + before[mutant.end:]
    lines = [text.splitlines()[mutant.line - 1].decode().strip() for text in (before, after)]
    path.write_bytes(after)
    try:
        yield " -> ".join(lines)
    finally:
        path.write_bytes(before)


def _imported(path: Path, root: Path) -> set[Path]:
    """Return the files of the package that a file imports, also inside functions."""
    found = set()
    for node in ast.walk(ast.parse(path.read_bytes())):
        if isinstance(node, ast.ImportFrom):
            base = (path.parents[node.level - 1] if node.level else root).joinpath(*(node.module or "").split("."))
            found |= {base.with_suffix(".py"), *(base / f"{name.name}.py" for name in node.names)}
    return {file for file in found if file.is_file()}


@cache
def declared_only(root: Path = ROOT) -> frozenset[str]:
    """Return the files that only actuators import, directly or indirectly."""
    files = [path for path in (root / "emcas_fmu").rglob("*.py") if path.name != "__init__.py"]
    within = {path for path in files if path.relative_to(root).parts[1] in DECLARED}
    new = set().union(*(_imported(path, root) for path in files if path not in within)) & within
    used: set[Path] = set()
    while new:
        used |= new
        new = set().union(*(_imported(path, root) for path in new)) & within - used
    return frozenset(path.relative_to(root).as_posix() for path in within - used)


def _python(tree: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, "PYTHONPATH": str(tree), "PYTHONDONTWRITEBYTECODE": "1"}
    return subprocess.run([sys.executable, "-m", *arguments], cwd=tree, env=environment, capture_output=True, text=True,
                          timeout=TOO_LONG)


def _digest(tree: Path) -> str:
    """Return a digest of everything that actuators compute and declare in a tree; empty if this fails."""
    done = _python(tree, "tests.kernels", "--digest")
    return done.stdout if done.returncode == 0 else ""


@cache
def _digest_of_original() -> str:
    return _digest(ROOT)


def killed(tree: Path, file: str) -> bool:
    """Return whether the quick check fails in a tree with one changed file; run the tests for that folder first."""
    first = next(tests for folder, tests in SHARP.items() if file.startswith(folder))
    quick = (ROOT / "tests/quick.txt").read_text(encoding="utf-8").split("\n")
    options = [line for line in quick if line.startswith("--")]
    for tests in ([*options, *first], ["@tests/quick.txt", *(f"--ignore={test}" for test in first)]):
        try:
            if _python(tree, "pytest", "-x", "-q", "-p", "no:cacheprovider", "-n", "0", *tests, "-m",
                       "not fmu and not acceptance and not slow").returncode:
                return True
        except subprocess.TimeoutExpired:  # the mutant does not end
            return True
    return False


def try_mutant(mutant: Mutant, trees: SimpleQueue[Path]) -> tuple[str, str]:
    """Try a mutant in a free tree; return "killed", "no effect" or "ALIVE", and the change as text."""
    tree = trees.get()
    try:
        with applied(mutant, tree) as change:
            if killed(tree, mutant.file):
                return "killed", change
            same = mutant.file in declared_only() and _digest(tree) == _digest_of_original() != ""
            return "no effect" if same else "ALIVE", change
    finally:
        trees.put(tree)


def main() -> int:
    """Try the requested mutants; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=45)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--under", nargs="+", default=UNDER)
    parser.add_argument("--c", action="store_true", help="change the C files")
    parser.add_argument("-n", "--processes", type=int, default=2)
    options = parser.parse_args()
    found = mutants(options.under, c=options.c)
    chosen = random.Random(options.seed).sample(found, min(options.count, len(found)))
    trees: SimpleQueue[Path] = SimpleQueue()
    verdicts: Counter[str] = Counter()
    with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(options.processes) as pool:
        for number in range(options.processes):
            trees.put(Path(shutil.copytree(ROOT, Path(folder) / f"tree{number}", ignore=shutil.ignore_patterns(
                ".git", ".venv", "__pycache__", ".*_cache"))))
        if killed(Path(folder) / "tree0", UNDER[0]):
            print("the quick check fails without a mutant: correct this first")
            return 2
        for mutant, (verdict, change) in zip(chosen, pool.map(partial(try_mutant, trees=trees), chosen)):
            verdicts[verdict] += 1
            print(f"{verdict:9} {mutant.file}:{mutant.line}  {change}", flush=True)
    print(f"{verdicts['killed']} of {len(chosen)} killed, {verdicts['no effect']} without effect, "
          f"{verdicts['ALIVE']} alive")
    return 0 if verdicts["killed"] >= ENOUGH * (verdicts["killed"] + verdicts["ALIVE"]) else 1


if __name__ == "__main__":
    sys.exit(main())
