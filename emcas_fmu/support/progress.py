"""Progress reports of long work, and announcements."""

from __future__ import annotations

import logging
from collections.abc import Callable

LOG = logging.getLogger("emcas_fmu")
"""Announces slow work that is done once, such as compiling (info), and fallbacks (warning)."""

Progress = Callable[[str, int, int], None]
"""Called with the name of the work, the number of parts done, and their total number."""


def warn(message: str) -> None:
    """Announce a fallback, but not from a worker process: its parent announces the same."""
    from multiprocessing import parent_process  # late: the import is slow and rarely needed

    if parent_process() is None:
        LOG.warning(message)


def silent(_name: str, _done: int, _total: int) -> None:
    """Report nothing."""
