"""TOML: the standard library's reader (in Python 3.10 its backport), and functions that return lines to write."""

import json
import re
import sys
from collections.abc import Mapping
from typing import Any

if sys.version_info >= (3, 11):
    import tomllib as tomllib
else:
    import tomli as tomllib

__all__ = ["entry", "literal", "table", "tomllib"]

_BARE = re.compile(r"[A-Za-z0-9_-]+")


def literal(written: Any) -> str:
    """Return a text, number, truth value, list or table as TOML on one line."""
    if isinstance(written, Mapping):
        return f"{{ {', '.join(entry(*each) for each in written.items())} }}"
    if isinstance(written, (list, tuple)):
        return f"[{', '.join(map(literal, written))}]"
    if isinstance(written, str):  # as in JSON, but with DEL escaped; UTF-8 has no lone surrogates
        text = json.dumps(written.encode(errors="replace").decode(), ensure_ascii=False)
        return text.replace("\x7f", "\\u007f")
    return json.dumps(written)


def entry(name: str, written: Any) -> str:
    """Return the line of a key, quoted if necessary, and its value."""
    return f"{name if _BARE.fullmatch(name) else literal(name)} = {literal(written)}"


def table(name: str, entries: Mapping[str, Any]) -> str:
    """Return the lines of a table: its name in brackets, then a line for each entry."""
    return "\n".join([f"[{name}]", *(entry(*each) for each in entries.items())])
