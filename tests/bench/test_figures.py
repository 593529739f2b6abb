"""The bench's results equal the stored numbers: a wrong sign, operator or constant changes at least one of them.

Margins are searched to 1e-6. The other numbers are sums computed by NumPy and BLAS, whose rounding depends on the
processor: 1e-13 of the largest summand, also where the summands of a mark cancel.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from . import figures

STORED = json.loads(figures.FILE.read_text(encoding="utf-8"))


def check(computed: dict[str, list[Any]], section: str) -> None:
    stored = STORED[section]
    assert list(computed) == list(stored), "python -m tests.bench.figures stores them, after a change that is intended"
    for name, values in computed.items():
        expected = [pytest.approx(x, rel=1e-6, abs=1e-11) if isinstance(x, float) else x for x in stored[name]]
        assert values == expected, name


def test_excitations_equal_the_stored_marks(tmp_path: Path) -> None:
    check(figures.excitations(tmp_path), "excitations")


def test_figures_of_synthetic_columns_equal_the_stored_marks() -> None:
    check(figures.synthetic_figures(), "figures")


@pytest.mark.parametrize("model", figures.JUDGED)
def test_verdicts_equal_the_stored_verdicts(model: str, tmp_path: Path) -> None:
    check(figures.verdicts(model, tmp_path), model)
