"""Imports follow the layers of the architecture page: none upward, and none in a circle."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from collections.abc import Iterator
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
MODULES = {".".join(file.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__"): file
           for file in (ROOT / "emcas_fmu").rglob("*.py")}
PAGE = (ROOT / "docs/develop/architecture.md").read_text(encoding="utf-8")
LISTED = re.search(r"```layers\n(.*?)```", PAGE, re.DOTALL)
assert LISTED is not None
LAYERS = [[f"emcas_fmu.{name.strip()}" for name in line.split(",")] for line in LISTED[1].strip().splitlines()]


def layer(module: str) -> int:
    """Return a module's layer, 0 at the top; of the listed names that contain the module, the longest counts."""
    names = [(len(name), k) for k, line in enumerate(LAYERS) for name in line if f"{module}.".startswith(f"{name}.")]
    assert names, f"{module} is in no layer of docs/develop/architecture.md"
    return max(names)[1]


def imported(module: str, tree: ast.AST) -> Iterator[str]:
    """Yield the package's modules that a module imports anywhere, also only for type checking."""
    file = MODULES[module]
    package = module.split(".")[:None if file.name == "__init__.py" else -1]
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom):
            base = [*package[:len(package) - node.level + 1]] * bool(node.level) + (node.module or "").split(".")
            name = ".".join(filter(None, base))
            yield from (each if (each := f"{name}.{alias.name}") in MODULES else name for alias in node.names)
        elif isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)


def upward(module: str, source: str) -> list[str]:
    """Return the imports of a module from layers above it."""
    return [name for name in imported(module, ast.parse(source))
            if name.startswith("emcas_fmu.") and layer(name) < layer(module)]


@pytest.mark.parametrize("module", sorted(MODULES.keys() - {"emcas_fmu", "emcas_fmu.__main__"}))
def test_no_module_imports_from_above(module: str) -> None:
    assert upward(module, MODULES[module].read_text(encoding="utf-8")) == []


@pytest.mark.parametrize("source", [
    "from ..studies.report import acceptance", "from .. import studies", "import emcas_fmu.api",
    "def f():\n    from ..studies import tuning", "if TYPE_CHECKING:\n    from emcas_fmu.commands import root"])
def test_import_from_above_is_found(source: str) -> None:
    assert upward("emcas_fmu.bench.measure", source)
    assert not upward("emcas_fmu.cli", source)


def test_every_listed_module_exists() -> None:
    assert [name for line in LAYERS for name in line if name not in MODULES] == []


def without_type_checking(tree: ast.AST) -> ast.AST:
    """Return a module without the imports for type checking."""
    for node in ast.walk(tree):
        if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING":
            node.body = [ast.Pass()]
    return tree


def circle(sources: dict[str, str]) -> list[str]:
    """Return modules that import each other at run time, also inside functions; empty without such a circle.

    Imports from the package that contains the module are not counted.
    """
    graph = {name: {each for each in imported(name, without_type_checking(ast.parse(source)))
                    if each in MODULES and not f"{name}.".startswith(f"{each}.")} for name, source in sources.items()}
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        return list(error.args[1])
    return []


def test_no_modules_import_each_other() -> None:
    assert circle({name: file.read_text(encoding="utf-8") for name, file in MODULES.items()}) == []


def test_circle_of_imports_is_found() -> None:
    one, other = "emcas_fmu.bench.measure", "emcas_fmu.bench.subject"
    assert circle({one: "from .subject import Subject", other: "def f():\n    from . import measure"})
    assert not circle({one: "from .subject import Subject", other: "if TYPE_CHECKING:\n    from .measure import Test"})


@pytest.mark.parametrize(("modules", "heavy"), [
    ("api, studies.explore.page", "matplotlib scipy.linalg scipy.stats"),
    ("commands.simulate, commands.campaign, studies.validate.validation_output, studies.baseline.comparison_output, "
     "studies.baseline.files, studies.tuning.output, studies.tuning.optimise, studies.tuning.study", "matplotlib")])
def test_commands_do_not_import_heavy_libraries(modules: str, heavy: str) -> None:
    """They would take half of the start time of every command; only pages and plots need Matplotlib."""
    program = (f"import sys, {', '.join(f'emcas_fmu.{name}' for name in modules.split(', '))}; "
               f"print(*sorted(set({heavy.split()}) & sys.modules.keys()))")
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == ""
