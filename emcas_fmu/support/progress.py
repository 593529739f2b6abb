"""Progress reports and interruptions of long work, and announcements."""

from __future__ import annotations

import logging
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from queue import SimpleQueue
from typing import Any

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


@contextmanager
def waking(done: SimpleQueue[Any]) -> Iterator[None]:
    """Let Ctrl-C put None into the queue `done`, where a KeyboardInterrupt could leave a lock that is never released.

    Only the main thread can do so; in others nothing changes.
    """
    if threading.current_thread() is not threading.main_thread() or (
            signal.getsignal(signal.SIGINT) is not signal.default_int_handler):
        yield
        return
    signal.signal(signal.SIGINT, lambda *_: done.put(None))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, signal.default_int_handler)
