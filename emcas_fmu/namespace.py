"""Named values as attributes: ``namespace({"drive.kp": 5}).drive.kp``. Standard library only."""

from __future__ import annotations

import re
from collections.abc import Mapping
from types import SimpleNamespace
from typing import Any

_ELEMENT = re.compile(r"(.+)\[(\d+)\]")


class Record(SimpleNamespace):
    """Named values of one moment: states, or what acts on them."""

    def replace(self, **changes: Any) -> Record:
        """Return a copy with other values; TypeError for a name there is not."""
        known = vars(self)
        if unknown := [name for name in changes if name not in known]:
            raise TypeError(f"there is no {', '.join(unknown)}; there is {', '.join(known)}")
        return Record(**{**known, **changes})


def with_values(p: Any, changes: Mapping[str, Any]) -> Any:
    """Return a copy of a namespace with other values at these dotted names, or with further ones."""
    copy = SimpleNamespace(**vars(p))
    for name, value in changes.items():
        first, _, rest = name.partition(".")
        setattr(copy, first, with_values(getattr(copy, first, SimpleNamespace()), {rest: value}) if rest else value)
    return copy


def namespace(values: Mapping[str, Any], structure: Any = None) -> Any:
    """Return nested namespaces of flat values; ``a.b[0]``, ``a.b[1]``, ... become the tuple ``a.b``.

    `structure` is kept under that name: what is fixed when an actuator is put together, and no parameter.
    """
    arrays: dict[str, list[Any]] = {}
    flat: dict[str, Any] = {}
    for name, value in values.items():
        element = _ELEMENT.fullmatch(name)
        if element:
            arrays.setdefault(element[1], []).append(value)
        else:
            flat[name] = value
    root = SimpleNamespace(structure=structure)
    for name, value in {**flat, **{k: tuple(v) for k, v in arrays.items()}}.items():
        node = root
        *path, leaf = name.split(".")
        for part in path:
            if not hasattr(node, part):
                setattr(node, part, SimpleNamespace())
            node = getattr(node, part)
        setattr(node, leaf, value)
    return root
