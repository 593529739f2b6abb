"""Workarounds for pythonfmu's wrapper in the entry module of an FMU. Standard library only: embedded in the FMU."""

from __future__ import annotations

import atexit
import os
import sys
from collections.abc import Mapping
from contextlib import suppress
from typing import Any

_namespaces: list[Mapping[str, Any]] = []


def keep(namespace: Mapping[str, Any]) -> None:
    """Hold one more reference to a module's namespace, and release the wrappers' state when the process ends.

    The wrapper executes the entry module at every instantiation and afterwards drops a borrowed reference to its
    namespace; without this the namespace would be freed while later instances use it.
    """
    if not _namespaces and sys.platform == "linux":
        atexit.register(_release_wrappers)
    _namespaces.append(namespace)


def _release_wrappers() -> None:
    """Make each loaded wrapper release its state before the process destroys it.

    When the process ends, the wrapper's static state is destroyed and then released once more by the library's
    finalizer: a count is decremented in freed memory, which sometimes aborts a host that has finished. This earlier
    call of the same finalizer prevents the second release.
    """
    with suppress(Exception):  # the interpreter is ending, and nothing else depends on these calls
        import ctypes

        with open("/proc/self/maps", encoding="utf-8", errors="replace") as maps:  # noqa: PTH123
            paths = {line.split(maxsplit=5)[5].rstrip().removesuffix(" (deleted)") for line in maps if line.count("/")}
        # Each FMU that a host has unpacked: the wrapper adds its resources folder to sys.path.
        entries = {entry.rstrip("/") for entry in sys.path}
        for folder in {entry.removesuffix("/resources") for entry in entries if entry.endswith("/resources")}:
            real = os.path.realpath(folder)
            for path in (path for path in paths if path.startswith(f"{real}/binaries/")):
                # If the file is gone, the loader knows the library only by the path that the host used.
                for name in (path, folder + path.removeprefix(real)):
                    with suppress(OSError, AttributeError):  # not loaded, not by this name, or not a wrapper
                        ctypes.CDLL(name, mode=os.RTLD_NOLOAD | os.RTLD_NOW).finalizePythonInterpreter()
