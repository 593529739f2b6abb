"""FMU states as bytes, and their checks. This file is embedded in the FMU: standard library and runtime.core only."""

from __future__ import annotations

import json
import zlib
from collections.abc import Sequence
from typing import Any

from ...runtime.core import finite


class StoredState(tuple[Any, ...]):
    """A state deserialized from bytes with the right checksum; its values may still be wrong."""

    __slots__ = ()


def to_bytes(guid: str, state: Any) -> bytes:
    """Return a state as bytes, with a checksum and the GUID of its FMU."""
    body = json.dumps(state).encode()
    return f"{guid} {zlib.crc32(body):08x} ".encode() + body


def from_bytes(guid: str, data: bytes) -> str | StoredState:
    """Return the state that bytes contain, or the reason why they contain no state of the FMU with this GUID."""
    try:
        found_guid, check, body = bytes(data).split(b" ", 2)
        if found_guid.decode() != guid:
            return f"it is of another FMU, not of {guid}"
        if int(check, 16) != zlib.crc32(body):
            return "its checksum is wrong"
        state = _tuples(json.loads(body))
        return StoredState(state) if isinstance(state, tuple) else "it contains no state"
    except Exception as error:  # noqa: BLE001  no exception may leave the slave
        return f"it cannot be read ({type(error).__name__})"


def _tuples(value: Any) -> Any:
    return tuple(_tuples(v) for v in value) if isinstance(value, list) else value


def is_text(value: Any) -> bool:
    """Return whether a value is a string that can be passed to a host."""
    return isinstance(value, str) and "\0" not in value and value.encode(errors="ignore").decode() == value


def wrong_variable(values: Any, rows: Sequence[tuple[Any, ...]]) -> str:
    """Return the name of the first variable with an impossible value, or that their number is wrong; otherwise ""."""
    if not (isinstance(values, tuple) and len(values) == len(rows)):
        return "wrong number of variables"

    def possible(value: Any, kind: str) -> bool:
        if kind == "Real":
            return isinstance(value, float) or finite(value)
        if kind == "Integer":
            return finite(value) and value == int(value) and abs(value) < 2**31
        return finite(value) and value in (0, 1) if kind == "Boolean" else is_text(value)

    return next((str(row[0]) for value, row in zip(values, rows, strict=True) if not possible(value, row[1])), "")
