"""Whether the quick check finds a wrong sign, operator or constant: random mutants, each in a copy of the tree.

    python -m tests.mutants --count 45 --seed 1 [--under emcas_fmu/physics ...] [-n 2]

Prints killed, ALIVE or no effect for each, with its place and change; exit code 1 where less than 95 % of those with an
effect were killed. A mutant has none where nothing but actuators uses its file, and every shipped actuator, bare and
with each extension, computes and declares the same to the last character (`python -m tests.kernels --digest`). Others
that have none count as alive.
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
# Of the quick check, run first: they find most, in seconds.
SHARP = {"emcas_fmu/bench": ("tests/bench",),
         "emcas_fmu/runtime": tuple(f"tests/unit/test_{name}.py" for name in ("batch", "compiled", "simulate")),
         "emcas_fmu": ("tests/trajectories",)}
DECLARED = {"physics", "steppers", "control", "actuators", "extensions"}  # what actuators are made of
_SWAPPED = {ast.Add: "-", ast.Sub: "+", ast.Mult: "/", ast.Div: "*"}
_FLIPPED = {ast.Lt: ">=", ast.GtE: "<", ast.Gt: "<=", ast.LtE: ">", ast.Eq: "!=", ast.NotEq: "=="}
_OTHER = {"minimum": "maximum", "maximum": "minimum", "min": "max", "max": "min"}
_NO_C = re.compile(r'/\*.*?\*/|"(?:\\.|[^"\\\n])*"|^[ \t]*#(?:[^\n]*\\\n)*[^\n]*', re.DOTALL | re.MULTILINE)
_C = re.compile(r"(?<= )(?:[-+*/<>]|[-+]=|[<>=!]=|&&|\|\|)(?= )|(?<![\w.])\d+(?:\.\d+)?(?![\w.])")
_C_SWAPPED = {"+": "-", "-": "+", "*": "/", "/": "*", "+=": "-=", "-=": "+=", "<": ">=", ">=": "<", ">": "<=",
              "<=": ">", "==": "!=", "!=": "==", "&&": "||", "||": "&&"}
_TEXTS = (ast.Raise, ast.JoinedStr, ast.Assert)  # errors' texts and formats: what is in them is not computed with


class Mutant(NamedTuple):
    """A change of one place: the file, its line, from where to where its text changes [bytes], and the new text."""

    file: str
    line: int
    begin: int
    end: int
    new: str


def _sites(node: ast.AST) -> Iterator[ast.AST]:
    """Give a tree's nodes but for annotations, texts of errors, __repr__ and sizes of caches."""
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
    """Return from where to where a node's text changes [bytes], and the new text; None of a node that stays."""
    def place(part: ast.expr, end: bool = False) -> int:
        line, column = (part.end_lineno, part.end_col_offset) if end else (part.lineno, part.col_offset)
        return begins[(line or 1) - 1] + (column or 0)

    def between(left: ast.expr, right: ast.expr, old: bytes, new: str) -> tuple[int, int, str] | None:
        """Return the operator's place; a bracket or a line's end may stand about it, a comment may not."""
        low, high = place(left, True), place(right)
        at = text.find(old, low, high)
        return None if at < 0 or b"#" in text[low:high] else (at, at + len(old), new)

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
        return place(node), place(node) + 1, ""
    if isinstance(node, ast.Constant) and isinstance(node.value, (int, float)) and not isinstance(node.value, bool):
        number = node.value
        larger = number + max(1, number // 10) if isinstance(number, int) else number * 1.1 or 0.1
        return place(node), place(node, True), repr(larger)
    name = node.func if isinstance(node, ast.Call) else None
    word = name.attr if isinstance(name, ast.Attribute) else name.id if isinstance(name, ast.Name) else ""
    if name is not None and word in _OTHER:
        return place(name, True) - len(word), place(name, True), _OTHER[word]
    return None


def _in_c(text: str) -> Iterator[tuple[int, int, str]]:
    """Give from where to where C changes, and to what: not in comments, texts and lines of the preprocessor."""
    code = _NO_C.sub(lambda found: " " * len(found[0]), text)
    for found in _C.finditer(code):
        word = found[0]
        if word in _C_SWAPPED:
            yield found.start(), found.end(), _C_SWAPPED[word]
        else:
            yield found.start(), found.end(), repr(float(word) * 1.1 or 0.1) if "." in word else str(int(word) + 1)


def mutants(under: Sequence[str] = UNDER, root: Path = ROOT, c: bool = False) -> list[Mutant]:
    """Return every mutant of the Python files below these folders, or of these files; of C files instead with `c`."""
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
    """Change one place of a tree; put it back in the end. Yields the line before and after, in words."""
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
    """Return the files of the package that a file imports from, inside functions too."""
    found = set()
    for node in ast.walk(ast.parse(path.read_bytes())):
        if isinstance(node, ast.ImportFrom):
            base = (path.parents[node.level - 1] if node.level else root).joinpath(*(node.module or "").split("."))
            found |= {base.with_suffix(".py"), *(base / f"{name.name}.py" for name in node.names)}
    return {file for file in found if file.is_file()}


@cache
def declared_only(root: Path = ROOT) -> frozenset[str]:
    """Return the files that act through the actuators alone: nothing else imports them, or what imports them."""
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
    """Return a digest of all that actuators compute and declare in a tree."""
    done = _python(tree, "tests.kernels", "--digest")
    return done.stdout if done.returncode == 0 else ""


@cache
def _digest_as_it_is() -> str:
    return _digest(ROOT)


def killed(tree: Path, file: str) -> bool:
    """Return whether the quick check fails in a tree where a file is changed: the sharpest tests for that first."""
    first = next(tests for folder, tests in SHARP.items() if file.startswith(folder))
    quick = (ROOT / "tests/quick.txt").read_text(encoding="utf-8").split("\n")
    options = [line for line in quick if line.startswith("--")]
    for tests in ([*options, *first], ["@tests/quick.txt", *(f"--ignore={test}" for test in first)]):
        try:
            if _python(tree, "pytest", "-x", "-q", "-p", "no:cacheprovider", "-n", "0", *tests, "-m",
                       "not fmu and not acceptance and not slow").returncode:
                return True
        except subprocess.TimeoutExpired:  # it runs for ever
            return True
    return False


def tried(mutant: Mutant, trees: SimpleQueue[Path]) -> tuple[str, str]:
    """Return what becomes of a mutant in one of the trees that are free, and the change in words."""
    tree = trees.get()
    try:
        with applied(mutant, tree) as change:
            if killed(tree, mutant.file):
                return "killed", change
            same = mutant.file in declared_only() and _digest(tree) == _digest_as_it_is() != ""
            return "no effect" if same else "ALIVE", change
    finally:
        trees.put(tree)


def main() -> int:
    """Try the mutants that the arguments ask for. Returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=45)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--under", nargs="+", default=UNDER)
    parser.add_argument("--c", action="store_true", help="of the C files")
    parser.add_argument("-n", "--processes", type=int, default=2)
    given = parser.parse_args()
    places = mutants(given.under, c=given.c)
    chosen = random.Random(given.seed).sample(places, min(given.count, len(places)))
    trees: SimpleQueue[Path] = SimpleQueue()
    ends: Counter[str] = Counter()
    with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(given.processes) as pool:
        for place in range(given.processes):
            trees.put(Path(shutil.copytree(ROOT, Path(folder) / f"tree{place}", ignore=shutil.ignore_patterns(
                ".git", ".venv", "__pycache__", ".*_cache"))))
        if killed(Path(folder) / "tree0", UNDER[0]):
            print("the quick check fails without a mutant: mend that first")
            return 2
        for mutant, (end, change) in zip(chosen, pool.map(partial(tried, trees=trees), chosen)):
            ends[end] += 1
            print(f"{end:9} {mutant.file}:{mutant.line}  {change}", flush=True)
    print(f"{ends['killed']} of {len(chosen)} killed, {ends['no effect']} without effect, {ends['ALIVE']} alive")
    return 0 if ends["killed"] >= ENOUGH * (ends["killed"] + ends["ALIVE"]) else 1


if __name__ == "__main__":
    sys.exit(main())
