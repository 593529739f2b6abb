"""The table of docs/friction.md is the one its script makes."""

from __future__ import annotations

from ..docs.recipes import ROOT
from ..docs.test_tables import script


def test_not_stale() -> None:
    tables, maker = script("make_tables"), script("make_friction")
    text = (ROOT / "docs/friction.md").read_text(encoding="utf-8")
    assert tables.renewed(text, maker.TABLES["friction.md"]) == text, "run python docs/make_friction.py"
