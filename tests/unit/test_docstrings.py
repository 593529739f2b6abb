"""Every public function, class and method of the package has a docstring, or overrides one that has."""

from __future__ import annotations

import ast
from collections import defaultdict
from collections.abc import Iterator
from itertools import chain
from pathlib import Path

import emcas_fmu

FOLDER = Path(emcas_fmu.__file__).parent
TREES = {file.relative_to(FOLDER).as_posix(): ast.parse(file.read_text(encoding="utf-8"))
         for file in FOLDER.rglob("*.py")}
CLASSES: dict[str, list[ast.ClassDef]] = defaultdict(list)  # by name; some classes have the same
for node in chain.from_iterable(map(ast.walk, TREES.values())):
    if isinstance(node, ast.ClassDef):
        CLASSES[node.name].append(node)
OPERATIONS = {each.name for owner in (*CLASSES["Ops"], *CLASSES["Bits"]) for each in owner.body
              if isinstance(each, ast.FunctionDef)}
Public = ast.FunctionDef | ast.ClassDef


def public(body: list[ast.stmt]) -> Iterator[Public]:
    return (node for node in body if isinstance(node, Public) and not node.name.startswith("_"))


def overrides(method: Public, owner: ast.ClassDef) -> bool:
    """Whether a base class has the method; one from another library does."""
    for base in (ast.unparse(base).partition("[")[0].rpartition(".")[2] for base in owner.bases):
        if base not in CLASSES and base not in ("ABC", "NamedTuple", "Protocol"):
            return True
        if any(method.name in {each.name for each in public(known.body)} or overrides(method, known)
               for known in CLASSES.get(base, ())):
            return True
    return False


def bare(body: list[ast.stmt], owner: ast.ClassDef | None = None) -> Iterator[str]:
    """Yield the names without a docstring, but those of operations and rules, whose message is their docstring."""
    for node in public(body):
        decorators = [ast.unparse(each) for each in node.decorator_list]
        rules = any(each.startswith("rule(") or each.endswith(".setter") for each in decorators)
        if not (rules or ast.get_docstring(node) or (owner and (node.name in OPERATIONS or overrides(node, owner)))):
            yield node.name
        if isinstance(node, ast.ClassDef):
            yield from (f"{node.name}.{name}" for name in bare(node.body, node))


def test_everything_public_has_a_docstring() -> None:
    assert list(chain.from_iterable((f"{file}: {name}" for name in bare(tree.body))
                                    for file, tree in TREES.items())) == []


def test_a_missing_one_is_found() -> None:
    source = ('class A:\n    """A."""\n    def f(self): ...\nclass B(ABC):\n    """B."""\n    def g(self): ...\n'
              "def h(): ...")
    assert list(bare(ast.parse(source).body)) == ["A.f", "B.g", "h"]
