"""docs/model/measured.md: its tables are what the comparisons with measured records give."""

from __future__ import annotations

import importlib.util
import os
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.slow
def test_the_tables_are_those_of_the_records(monkeypatch: pytest.MonkeyPatch) -> None:
    if not (folder := os.environ.get("EMCAS_RECORDS")):
        pytest.skip("no measured records: docs/model/measured.md says where they can be had, EMCAS_RECORDS names them")
    monkeypatch.syspath_prepend(str(ROOT / "docs" / "figures"))
    spec = importlib.util.spec_from_file_location("make_measured", ROOT / "docs" / "figures" / "make_measured.py")
    assert spec is not None
    assert spec.loader is not None
    script = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(script)
    assert script.main(True, script.documents(Path(folder), False)) == 0
