"""What pythonfmu's wrapper needs of the entry module of an FMU. Standard library only: it is embedded in the FMU."""

from __future__ import annotations

import atexit
import sys
from collections.abc import Mapping
from typing import Any

_kept: list[Mapping[str, Any]] = []


def keep(namespace: Mapping[str, Any]) -> None:
    """Hold one more reference to a module's namespace, and see to the wrapper's end.

    The wrapper executes the entry module at every instantiation and afterwards drops a
    reference to its namespace that it only borrowed; without this the namespace would
    be freed under later instances.
    """
    if not _kept and sys.platform == "linux":
        atexit.register(_release_wrapper, str(namespace.get("__file__", "")))
    _kept.append(namespace)


def _release_wrapper(entry: str) -> None:
    """Let the wrapper release its state while that is still its own.

    As the process ends its static state is destroyed, and then released once more by the library's own
    finalizer: a count is decremented in memory that was freed, which now and then aborts a host that was done.
    Released before, by the same finalizer, there is nothing left to be released twice.
    """
    folder = entry.rpartition("/resources/")[0]
    try:
        import ctypes
        import os

        with open("/proc/self/maps", encoding="utf-8", errors="replace") as maps:  # noqa: PTH123
            paths = {line.split(maxsplit=5)[5].rstrip().removesuffix(" (deleted)") for line in maps if line.count("/")}
        for path in paths:
            if folder and path.startswith(f"{folder}/binaries/"):
                # Only if it is still loaded; the file may be gone.
                ctypes.CDLL(path, mode=os.RTLD_NOLOAD | os.RTLD_NOW).finalizePythonInterpreter()
    except Exception:  # noqa: BLE001  the interpreter is ending, and without this all is as it was
        pass
