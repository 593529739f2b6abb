"""Workarounds for pythonfmu's wrapper in the entry module of an FMU. Standard library only: embedded in the FMU."""

from __future__ import annotations

import atexit
import sys
from collections.abc import Mapping
from typing import Any

_kept: list[Mapping[str, Any]] = []


def keep(namespace: Mapping[str, Any]) -> None:
    """Hold one more reference to a module's namespace, and release the wrapper's state when the process ends.

    The wrapper executes the entry module at every instantiation and afterwards drops a borrowed reference to its
    namespace; without this the namespace would be freed while later instances use it.
    """
    if not _kept and sys.platform == "linux":
        atexit.register(_release_wrapper, str(namespace.get("__file__", "")))
    _kept.append(namespace)


def _release_wrapper(entry: str) -> None:
    """Make the wrapper release its state before the process destroys it.

    When the process ends, the wrapper's static state is destroyed and then released once more by the library's
    finalizer: a count is decremented in freed memory, which sometimes aborts a host that has finished. Calling the
    same finalizer before leaves nothing to release twice.
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
    except Exception:  # noqa: BLE001  the interpreter is ending; without this call everything else still works
        pass
