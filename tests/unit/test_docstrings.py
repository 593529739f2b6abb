"""Every public function, class and method of the package has a docstring, or overrides one with a docstring."""

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
    """Return the parsed files of the package; not at import, since every worker collects the tests."""
    folder = Path(emcas_fmu.__file__).parent
    return {file.relative_to(folder).as_posix(): ast.parse(file.read_text(encoding="utf-8"))
            for file in folder.rglob("*.py")}


@cache
def classes() -> dict[str, list[ast.ClassDef]]:
    """Return the package's classes by name; several may have the same name."""
    by_name: dict[str, list[ast.ClassDef]] = defaultdict(list)
    for node in chain.from_iterable(map(ast.walk, trees().values())):
        if isinstance(node, ast.ClassDef):
            by_name[node.name].append(node)
    return dict(by_name)


@cache
def operations() -> set[str]:
    """Return the names of the operations of equations."""
    return {each.name for owner in (*classes()["Ops"], *classes()["Bits"]) for each in owner.body
            if isinstance(each, ast.FunctionDef)}


def public(body: list[ast.stmt]) -> Iterator[Public]:
    return (node for node in body if isinstance(node, Public) and not node.name.startswith("_"))


def overrides(method: Public, owner: ast.ClassDef) -> bool:
    """Return whether a base class has the method; a class of another library is assumed to have it."""
    for base in (ast.unparse(base).partition("[")[0].rpartition(".")[2] for base in owner.bases):
        if base not in classes() and base not in ("ABC", "NamedTuple", "Protocol"):
            return True
        if any(method.name in {each.name for each in public(known.body)} or overrides(method, known)
               for known in classes().get(base, ())):
            return True
    return False


def undocumented(body: list[ast.stmt], owner: ast.ClassDef | None = None) -> Iterator[str]:
    """Yield names without a docstring. Operations need none, and the message of a rule is its docstring."""
    for node in public(body):
        decorators = [ast.unparse(each) for each in node.decorator_list]
        rule = any(each.startswith("rule(") or each.endswith(".setter") for each in decorators)
        if not (rule or ast.get_docstring(node) or (owner and (node.name in operations() or overrides(node, owner)))):
            yield node.name
        if isinstance(node, ast.ClassDef):
            yield from (f"{node.name}.{name}" for name in undocumented(node.body, node))


def test_everything_public_has_a_docstring() -> None:
    assert [f"{file}: {name}" for file, tree in trees().items() for name in undocumented(tree.body)] == []


def test_missing_docstring_is_found() -> None:
    source = ('class A:\n    """A."""\n    def f(self): ...\nclass B(ABC):\n    """B."""\n    def g(self): ...\n'
              "def h(): ...")
    assert list(undocumented(ast.parse(source).body)) == ["A.f", "B.g", "h"]
