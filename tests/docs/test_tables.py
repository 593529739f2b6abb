"""Tables of the documents are those their script makes."""

from __future__ import annotations

import importlib.util
import sys
from types import ModuleType

import pytest

from emcas_fmu.variables import INPUTS, OUTPUTS

from .recipes import ROOT


@pytest.fixture(scope="module")
def tables() -> ModuleType:
    """docs/make_tables.py as a module."""
    spec = importlib.util.spec_from_file_location("make_tables", ROOT / "docs/make_tables.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # where its data class looks for its own names
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("document", ["hosts.md", "ci.md", "models.md"])
def test_not_stale(tables: ModuleType, document: str) -> None:
    text = (ROOT / "docs" / document).read_text(encoding="utf-8")
    assert tables.renewed(text, tables.TABLES[document]) == text, "run python docs/make_tables.py"


def test_staleness_is_seen(tables: ModuleType) -> None:
    old = "<!-- single -->\n| `fin_command` | in | deg |\n<!-- /single -->"
    new = tables.renewed(old, {"single": tables.single})
    assert all(f"| `{v.name}` | " in new for v in (*INPUTS, *OUTPUTS))
    assert "| in | deg |" not in new
    with pytest.raises(ValueError, match="single"):
        tables.renewed("no markers", {"single": tables.single})
