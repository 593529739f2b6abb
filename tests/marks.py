"""Choose the cases of a test that run by default; the others run with `-m slow`."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import pytest


def slow(*cases: Any) -> list[Any]:
    """Return cases for `parametrize`, all marked slow; a tuple contains several arguments."""
    return [pytest.param(*(case if isinstance(case, tuple) else (case,)), marks=pytest.mark.slow) for case in cases]


def others_slow(cases: Iterable[Any], quick: Callable[[Any], bool]) -> list[Any]:
    """Return cases for `parametrize`; those for which `quick` is false are marked slow."""
    return [case if quick(case) else slow(case)[0] for case in cases]
