"""Every public function, class and method of the package has a docstring, or overrides one that has."""

from __future__ import annotations

import ast
from collections import defaultdict
from collections.abc import Iterator
from functools import cache
from itertools import chain
from pathlib import Path

import emcas_fmu

Public = ast.FunctionDef | ast.ClassDef


@cache
def trees() -> dict[str, ast.Module]:
    """Return the files of the package, parsed: not when tests are collected, which every worker does."""
    folder = Path(emcas_fmu.__file__).parent
    return {file.relative_to(folder).as_posix(): ast.parse(file.read_text(encoding="utf-8"))
            for file in folder.rglob("*.py")}


@cache
def classes() -> dict[str, list[ast.ClassDef]]:
    """Return the package's classes by name; some have the same."""
    found: dict[str, list[ast.ClassDef]] = defaultdict(list)
    for node in chain.from_iterable(map(ast.walk, trees().values())):
        if isinstance(node, ast.ClassDef):
            found[node.name].append(node)
    return dict(found)


@cache
def operations() -> set[str]:
    """Return the names of the operations of equations."""
    return {each.name for owner in (*classes()["Ops"], *classes()["Bits"]) for each in owner.body
            if isinstance(each, ast.FunctionDef)}


def public(body: list[ast.stmt]) -> Iterator[Public]:
    return (node for node in body if isinstance(node, Public) and not node.name.startswith("_"))


def overrides(method: Public, owner: ast.ClassDef) -> bool:
    """Whether a base class has the method; one from another library does."""
    for base in (ast.unparse(base).partition("[")[0].rpartition(".")[2] for base in owner.bases):
        if base not in classes() and base not in ("ABC", "NamedTuple", "Protocol"):
            return True
        if any(method.name in {each.name for each in public(known.body)} or overrides(method, known)
               for known in classes().get(base, ())):
            return True
    return False


def bare(body: list[ast.stmt], owner: ast.ClassDef | None = None) -> Iterator[str]:
    """Yield the names without a docstring, but those of operations and rules, whose message is their docstring."""
    for node in public(body):
        decorators = [ast.unparse(each) for each in node.decorator_list]
        rules = any(each.startswith("rule(") or each.endswith(".setter") for each in decorators)
        if not (rules or ast.get_docstring(node) or (owner and (node.name in operations() or overrides(node, owner)))):
            yield node.name
        if isinstance(node, ast.ClassDef):
            yield from (f"{node.name}.{name}" for name in bare(node.body, node))


def test_everything_public_has_a_docstring() -> None:
    assert list(chain.from_iterable((f"{file}: {name}" for name in bare(tree.body))
                                    for file, tree in trees().items())) == []


def test_a_missing_one_is_found() -> None:
    source = ('class A:\n    """A."""\n    def f(self): ...\nclass B(ABC):\n    """B."""\n    def g(self): ...\n'
              "def h(): ...")
    assert list(bare(ast.parse(source).body)) == ["A.f", "B.g", "h"]
