"""The table of docs/efficiency.md is the one its script makes."""

from __future__ import annotations

import importlib.util

from ..docs.recipes import ROOT


def test_not_stale() -> None:
    spec = importlib.util.spec_from_file_location("make_efficiency", ROOT / "docs/make_efficiency.py")
    assert spec is not None
    assert spec.loader is not None
    script = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(script)
    text = (ROOT / "docs/efficiency.md").read_text(encoding="utf-8")
    assert text.count("| forward / backward |") == 1
    assert script.renewed(text) == text, "run python docs/make_efficiency.py"
    assert script.renewed(text.replace("18.3 A", "18.4 A")) == text
