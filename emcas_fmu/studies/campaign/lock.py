"""One run at a time in a folder: a lock of the operating system's, gone with the process that holds it."""

from __future__ import annotations

import os
import platform
from pathlib import Path

from filelock import FileLock, Timeout

from .distributions import CampaignError

LOCK, OWNER = ".lock", ".owner"


class Lock:
    """Held from the beginning until `release`, or until the process ends, however it does.

    Raises CampaignError where another run holds it, naming its process.
    """

    def __init__(self, folder: Path) -> None:
        self._owner = folder / OWNER
        self._lock = FileLock(folder / LOCK)
        try:
            self._lock.acquire(blocking=False)
        except Timeout as error:
            raise CampaignError(f"another run ({_told(self._owner)}) writes to {folder}; wait for it, or name another "
                                "folder with --output") from error
        # Beside the lock: the locked file itself cannot be read on every system.
        self._owner.write_text(f"pid {os.getpid()} on {platform.node()}", encoding="utf-8")

    def release(self) -> None:
        """Let the next run in."""
        if self._lock.is_locked:
            self._owner.unlink(missing_ok=True)
            self._lock.release()


def _told(owner: Path) -> str:
    try:
        return owner.read_text(encoding="utf-8") or "pid unknown"
    except OSError:
        return "pid unknown"
