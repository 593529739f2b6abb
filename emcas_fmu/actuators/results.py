"""Checks of what an actuator's functions return."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from math import isnan
from typing import Any

from ..errors import EmcasError, location
from ..ops.base import Value


def complete(function: Callable[..., Any], values: Any, names: Iterable[str], optional: Iterable[str] = ()
             ) -> Mapping[str, Value]:
    """Return the `values` that a function has returned, if they are numbers for all `names` and no undeclared one.

    Raises EmcasError, with the function's location, if they are not.
    """
    if not isinstance(values, Mapping):
        raise EmcasError(f"{location(function)} returns {type(values).__name__}; a mapping of names to values is "
                         "needed")
    needed = list(names)
    known = {*needed, *optional}
    if missing := [name for name in needed if name not in values]:
        raise EmcasError(f"{location(function)} returns no {', '.join(missing)}")
    if unknown := [name for name in values if name not in known]:
        raise EmcasError(f"{location(function)} returns {', '.join(map(str, unknown))}, which is not declared; there "
                         f"is {', '.join(sorted(known))}")
    for name, value in values.items():
        if value is None or isinstance(value, (str, Sequence, Mapping)) or (isinstance(value, float) and isnan(value)):
            raise EmcasError(f"{location(function)} returns {name} = {value!r}; a number is needed")
    return values
