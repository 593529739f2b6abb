"""The tables of docs/model/measured.md equal the comparisons with measured records."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from .recipes import ROOT
from .test_tables import script


@pytest.mark.slow
def test_tables_are_up_to_date(monkeypatch: pytest.MonkeyPatch) -> None:
    if not (folder := os.environ.get("EMCAS_RECORDS")):
        pytest.skip("no measured records: docs/model/measured.md says where they can be had, EMCAS_RECORDS names them")
    monkeypatch.syspath_prepend(str(ROOT / "docs" / "figures"))
    maker = script("make_measured")
    assert maker.main(True, maker.documents(Path(folder), False)) == 0
