"""The tables of docs/model/accuracy.md are those that its script makes."""

from __future__ import annotations

import importlib.util

import pytest

from .recipes import ROOT

pytestmark = pytest.mark.slow


def test_not_stale() -> None:
    spec = importlib.util.spec_from_file_location("make_budget", ROOT / "docs/figures/make_budget.py")
    assert spec is not None
    assert spec.loader is not None
    script = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(script)
    text = (ROOT / "docs/model/accuracy.md").read_text(encoding="utf-8")
    assert text.count("| `elastic` with `hinge-stiffness` |") == 1
    assert script.renewed(text.replace("| gain margin | 7.5 dB", "| gain margin | 7.4 dB")) == text, (
        "run python docs/figures/make_budget.py")
