"""What the bench gives, against the numbers that are kept: a changed sign, operator or constant moves one of them.

Margins are those of a search to 1e-6; the rest are sums of NumPy and of the linear algebra beneath, which round as the
processor lets them, to some 1e-13 of what a mark of a column that cancels is the rest of.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from . import figures

KEPT = json.loads(figures.FILE.read_text(encoding="utf-8"))


def check(found: dict[str, list[Any]], kept: dict[str, list[Any]]) -> None:
    assert list(found) == list(kept)
    for name, values in found.items():
        expected = [pytest.approx(x, rel=1e-6, abs=1e-11) if isinstance(x, float) else x for x in kept[name]]
        assert values == expected, name


def test_excitations(tmp_path: Path) -> None:
    check(figures.excited(tmp_path), KEPT["excitations"])


def test_figures_of_made_up_columns() -> None:
    check(figures.measured(), KEPT["figures"])


@pytest.mark.parametrize("model", figures.JUDGED)
def test_every_figure_of_every_test_judged(model: str, tmp_path: Path) -> None:
    check(figures.judged(model, tmp_path), KEPT[model])
