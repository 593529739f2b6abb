"""Errors that a user can correct; the commands show them as messages without a traceback."""

from __future__ import annotations

import errno
import os
import re
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from difflib import get_close_matches
from inspect import unwrap
from pathlib import Path
from typing import Any

_DENIED = ("permission denied", "change its permissions or choose another file", "choose another path")
_FULL = ("the disk is full", "free some space", "free some space or choose another path")
_QUOTA = getattr(errno, "EDQUOT", errno.ENOSPC)  # missing on Windows
# The problem by the system's error code, with the remedies for a file to be read and a file to be written.
_REASONS = {
    errno.ENOENT: ("there is no such file or folder", "check its name", "make its folder first"),
    errno.EISDIR: ("it is a folder", "choose a file", "choose a file"),
    errno.ENOTDIR: ("a part of its path is a file, not a folder", "check the path", "check the path"),
    errno.EACCES: _DENIED, errno.EPERM: _DENIED, errno.EROFS: _DENIED, _QUOTA: _FULL, errno.ENOSPC: _FULL,
    errno.EFBIG: ("it would exceed the largest size of a file", "choose another file",
                  "choose another path, or see ulimit -f"),
    errno.ENAMETOOLONG: ("the name is too long", "check its name", "choose a shorter name"),
}


class EmcasError(Exception):
    """A request cannot be executed; the message names the thing, its value and the remedy."""


class EmcasWarning(UserWarning):
    """A request can be executed but is unusual."""


class ArgumentError(EmcasError, ValueError):
    """An argument cannot be used; the message names the function, the argument, its value and the expected type."""


class BuildError(EmcasError):
    """The FMU cannot be built; the message says why and what to do."""


def unreadable(path: Path | str, error: OSError | UnicodeDecodeError) -> str:
    """Return the message for a file that cannot be read, with the remedy."""
    if isinstance(error, UnicodeDecodeError):
        return (f"{path}: cannot be read: it is not a text file in UTF-8 (byte {error.start}); choose a text file, "
                "or save it as UTF-8")
    reason, remedy, _ = _reason(error)
    return f"{path}: cannot be read: {reason}; {remedy}"


def unwritable(path: Path | str, error: OSError) -> str:
    """Return the message for a file that cannot be written, with the remedy."""
    reason, _, remedy = _reason(error)
    return f"{path}: cannot be written: {reason}; {remedy}"


@contextmanager
def writing(path: Path | str) -> Iterator[None]:
    """Raise EmcasError, which names `path` and the remedy, for an OSError in the block."""
    try:
        yield
    except OSError as error:
        raise EmcasError(unwritable(path, error)) from error


def in_words(error: OSError) -> str:
    """Return the message for an error of the operating system, with the remedy if the error names a file."""
    if error.filename is None:
        return error.strerror or str(error)
    path = os.fsdecode(error.filename)
    reading = error.errno == errno.ENOENT or (os.path.exists(path) and not os.access(path, os.R_OK))  # noqa: PTH110
    return unreadable(path, error) if reading else unwritable(path, error)


def _reason(error: OSError) -> tuple[str, str, str]:
    return _REASONS.get(error.errno or 0, (error.strerror or str(error), "choose another file", "choose another path"))


def location(function: Callable[..., Any]) -> str:
    """Return file, line and name of an actuator's function, for a message."""
    code = getattr(unwrap(function), "__code__", None)
    return f"{code.co_filename}, line {code.co_firstlineno}: {code.co_name}()" if code else repr(function)


def declared_in(path: Path, name: str, call: str = "") -> str:
    """Return a Python file's path and the first line in which `name` is the first argument of a `call`.

    Without a `call`, `name` may be the first or a named argument of any. If there is no such line, return the path.
    """
    text = path.read_text(encoding="utf-8", errors="replace")
    match = re.search(rf"{call}[(=]\s*(['\"]){re.escape(name.partition('[')[0])}\1", text)
    return f"{path}, line {text.count(chr(10), 0, match.start(1)) + 1}" if match else str(path)


def called_from(path: Path) -> str:
    """Return the path of a file, the line that is being executed in it, and its function; "" if no line of it is."""
    name, frame = str(path), sys._getframe()
    while frame is not None and frame.f_code.co_filename != name:
        frame = frame.f_back  # type: ignore[assignment]
    return f"{name}, line {frame.f_lineno}: {frame.f_code.co_name}()" if frame else ""


def hint(word: Any, among: Iterable[str]) -> str:
    """Return the end of a message: the word in `among` that resembles an unknown `word`; "" if none does."""
    close = get_close_matches(str(word), list(among), 1)
    return f"; did you mean {close[0]}?" if close else ""
