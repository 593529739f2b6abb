"""Dotted names as attributes: ``tree({"drive.kp": 5}).drive.kp``. Standard library only."""

from __future__ import annotations

import re
from collections.abc import Mapping
from types import SimpleNamespace
from typing import Any

_ELEMENT = re.compile(r"(.+)\[(\d+)\]")


def changed(p: Any, changes: Mapping[str, Any]) -> Any:
    """A copy of a tree with other values, or further ones, at these dotted names."""
    copy = SimpleNamespace(**vars(p))
    for name, value in changes.items():
        first, _, rest = name.partition(".")
        setattr(copy, first, changed(getattr(copy, first), {rest: value}) if rest else value)
    return copy


def tree(values: Mapping[str, Any]) -> Any:
    """Nested namespaces of the values; ``a.b[0]``, ``a.b[1]``, ... become the tuple ``a.b``."""
    arrays: dict[str, list[Any]] = {}
    flat: dict[str, Any] = {}
    for name, value in values.items():
        element = _ELEMENT.fullmatch(name)
        if element:
            arrays.setdefault(element[1], []).append(value)
        else:
            flat[name] = value
    root = SimpleNamespace()
    for name, value in {**flat, **{k: tuple(v) for k, v in arrays.items()}}.items():
        node = root
        *path, leaf = name.split(".")
        for part in path:
            if not hasattr(node, part):
                setattr(node, part, SimpleNamespace())
            node = getattr(node, part)
        setattr(node, leaf, value)
    return root
