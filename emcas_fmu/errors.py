"""Errors a user can mend: shown as a message, without a traceback."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from difflib import get_close_matches
from typing import Any


class EmcasError(Exception):
    """The request cannot be carried out; the message names the thing and the remedy."""


class BuildError(EmcasError):
    """The FMU cannot be built; the message says why and what to do."""


def place(function: Callable[..., Any]) -> str:
    """Return file, line and name of a function that an actuator declares, for a message."""
    code = getattr(function, "__code__", None)
    return f"{code.co_filename}, line {code.co_firstlineno}: {code.co_name}()" if code else repr(function)


def hint(word: Any, among: Iterable[str]) -> str:
    """Return the word nearest to one that is not `among` those there are, as the end of a message; "" if none is."""
    close = get_close_matches(str(word), list(among), 1)
    return f"; did you mean {close[0]}?" if close else ""
