"""Documents inside the FMU."""

from __future__ import annotations

from ..parameters import ParameterSet


def documents(parameters: ParameterSet, guid: str) -> dict[str, bytes]:
    """Archive name to content."""
    return {}
