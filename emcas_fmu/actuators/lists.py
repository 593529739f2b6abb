"""Whether what a declaration lists is a list of things."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

from ..errors import EmcasError


def check_lists(actuator: Any) -> None:
    """Raise EmcasError for a field of a declaration that has one thing instead of several, or several as one of them.

    A comma or a * was forgotten: an array of parameters and FIN are tuples, and some things are named tuples.
    """
    for field in fields(actuator):
        kind, listed = str(field.type), getattr(actuator, field.name)
        if kind.endswith(", ...]") and type(listed) not in (tuple, list):
            raise EmcasError(f"actuator {actuator.name}: {field.name} lists things; write a comma behind a single one, "
                             f"{field.name}=(...,)")
        if kind.endswith(", ...]") and "tuple[tuple" not in kind and any(type(each) is tuple for each in listed):
            raise EmcasError(f"actuator {actuator.name}: {field.name} has several things in the place of one; write * "
                             "before them, as in *em.FIN and *em.array(...)")
