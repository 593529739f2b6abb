"""Tables of the documents equal those that their scripts make."""

from __future__ import annotations

import importlib.util
import sys
from types import ModuleType

import pytest

from tests.default_actuator import INPUTS, OUTPUTS

from .recipes import ROOT


def script(name: str) -> ModuleType:
    """Return a script of docs/figures as a module."""
    if name in sys.modules:
        return sys.modules[name]
    spec = importlib.util.spec_from_file_location(name, ROOT / "docs" / "figures" / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # data classes and other scripts look it up there
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def tables() -> ModuleType:
    return script("make_tables")


@pytest.mark.parametrize(("maker", "document"), [
    ("make_tables", "use/hosts.md"), ("make_tables", "use/fins.md"), ("make_tables", "use/requirements.md"),
    ("make_tables", "use/your_actuator.md"), ("make_tables", "tools/ci.md"),
    ("make_tables", "model/models.md"), ("make_tables", "model/elastic.md"), ("make_tables", "model/drive.md"),
    ("make_supply", "model/supply.md"), ("make_numerics", "model/numerics.md"),
    ("make_efficiency", "model/efficiency.md"),
    pytest.param("make_budget", "model/accuracy.md", marks=pytest.mark.slow),
    pytest.param("make_faults", "model/faults.md", marks=pytest.mark.slow),
    pytest.param("make_sensors", "model/sensors.md", marks=pytest.mark.slow),
    pytest.param("make_control", "model/control.md", marks=pytest.mark.slow),
    pytest.param("make_two_degrees", "model/control.md", marks=pytest.mark.slow),
    pytest.param("make_campaigns", "tools/campaigns.md", marks=pytest.mark.slow),
])
def test_table_is_up_to_date(tables: ModuleType, maker: str, document: str) -> None:
    text = (ROOT / "docs" / document).read_text(encoding="utf-8")
    assert tables.renewed(text, script(maker).TABLES[document]) == text, f"run python docs/figures/{maker}.py"


def test_picture_of_the_package_is_up_to_date() -> None:
    maker = script("make_architecture")
    assert (ROOT / "docs/figures/architecture.svg").read_text(encoding="utf-8") == maker.picture()


def test_stale_table_is_detected(tables: ModuleType) -> None:
    old = "<!-- single -->\n| `fin_command` | in | deg |\n<!-- /single -->"
    new = tables.renewed(old, {"single": tables.single})
    assert all(f"| `{v.name}` | " in new for v in (*INPUTS, *OUTPUTS))
    assert "| in | deg |" not in new
    with pytest.raises(ValueError, match="single"):
        tables.renewed("no markers", {"single": tables.single})
