"""The table of docs/friction.md is the one its script makes."""

from __future__ import annotations

import importlib.util

import pytest

from ..docs.recipes import ROOT


def test_not_stale(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(ROOT / "docs")  # where the script finds its helper
    spec = importlib.util.spec_from_file_location("make_friction", ROOT / "docs/make_friction.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    text = (ROOT / "docs/friction.md").read_text(encoding="utf-8")
    assert module.renewed(text, module.TABLES) == text, "run python docs/make_friction.py"
