"""The tables of docs/model/friction.md are up to date."""

from __future__ import annotations

import pytest

from ..docs.recipes import ROOT
from ..docs.test_tables import script


@pytest.mark.slow
def test_the_script_makes_the_same_tables() -> None:
    tables, maker = script("make_tables"), script("make_friction")
    text = (ROOT / "docs/model/friction.md").read_text(encoding="utf-8")
    assert tables.renewed(text, maker.TABLES["model/friction.md"]) == text, "run python docs/figures/make_friction.py"
