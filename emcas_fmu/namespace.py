"""Named values as attributes: ``namespace({"drive.kp": 5}).drive.kp``."""

from __future__ import annotations

import re
from collections.abc import Mapping
from functools import reduce
from types import SimpleNamespace
from typing import Any, TypeVar

from .errors import hint

R = TypeVar("R", bound="Record")
_ELEMENT = re.compile(r"(.+)\[(\d+)\]")


class Names(SimpleNamespace):
    """Values as attributes; the error for an unknown name lists the known names."""

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        raise AttributeError(f"there is no {name}{hint(name, vars(self))}; there is {', '.join(vars(self))}")


class Record(Names):
    """Values as attributes that cannot be set, such as the states at one instant."""

    def __setattr__(self, name: str, value: Any) -> None:
        raise AttributeError(f"{name} cannot be set here; use a local variable, or return the value")

    def replace(self: R, /, **changes: Any) -> R:
        """Return a copy in which the named values are changed. Raises TypeError for an unknown name."""
        known = vars(self)
        if unknown := [name for name in changes if name not in known]:
            raise TypeError(f"there is no {', '.join(unknown)}; there is {', '.join(known)}")
        return type(self)(**{**known, **changes})


def with_values(p: Any, changes: Mapping[str, Any]) -> Any:
    """Return a copy of a namespace; the values of the dotted names in `changes` are changed or added."""
    copy = Names(**vars(p))
    for name, value in changes.items():
        first, _, rest = name.partition(".")
        setattr(copy, first, with_values(vars(copy).get(first, Names()), {rest: value}) if rest else value)
    return copy


def with_values_where(ops: Any, condition: Any, p: Any, changes: Mapping[str, Any]) -> Any:
    """Return a copy of a namespace; the values of the dotted names in `changes` are changed where `condition` holds.

    Raises AttributeError for a name that the namespace does not have.
    """
    return with_values(p, {name: ops.where(condition, value, value_of(p, name)) for name, value in changes.items()})


def value_of(p: Any, name: str) -> Any:
    """Return the value at a dotted name. Raises AttributeError for a name that the namespace does not have."""
    return reduce(getattr, name.split("."), p)


def namespace(values: Mapping[str, Any], structure: Any = None) -> Any:
    """Return nested namespaces from values with dotted names; ``a.b[0]``, ``a.b[1]``, ... become the tuple ``a.b``.

    The elements of a tuple are in the order of `values`. `structure`, the choices made when an actuator is composed,
    becomes the attribute of that name; it contains no parameters.
    """
    arrays: dict[str, list[Any]] = {}
    flat: dict[str, Any] = {}
    for name, value in values.items():
        element = _ELEMENT.fullmatch(name)
        if element:
            arrays.setdefault(element[1], []).append(value)
        else:
            flat[name] = value
    root: Any = Names(structure=structure)
    for name, value in {**flat, **{k: tuple(v) for k, v in arrays.items()}}.items():
        node = root
        *path, leaf = name.split(".")
        for part in path:
            node = vars(node).setdefault(part, Names())
        setattr(node, leaf, value)
    return root
