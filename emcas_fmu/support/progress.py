"""Progress reports and interruptions of long work, and announcements."""

from __future__ import annotations

import logging
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from queue import SimpleQueue
from typing import Any

LOG = logging.getLogger("emcas_fmu")
"""Announces slow work done once, such as compiling (info), fallbacks and probable mistakes in an actuator (warning)."""

Progress = Callable[[str, int, int], None]
"""A function that is called with the name of the work, the number of parts done, and the number of all parts."""


def announce(message: str) -> None:
    """Announce a fallback, or a probable mistake in an actuator, unless in a worker, whose parent announces it."""
    from multiprocessing import parent_process  # late: the import is slow and rarely needed

    if parent_process() is None:
        LOG.warning(message)


def silent(_name: str, _done: int, _total: int) -> None:
    """Report nothing."""


@contextmanager
def _at_interrupts(act: Callable[[], object]) -> Iterator[None]:
    """Call `act` at Ctrl-C until the block ends, instead of the usual handler.

    Outside the main thread, or if Python did not install the handler, Ctrl-C is handled as before.
    """
    handler = signal.getsignal(signal.SIGINT)
    if threading.current_thread() is not threading.main_thread() or handler is None:
        yield
        return
    signal.signal(signal.SIGINT, lambda *_: act())
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, handler)


def waking(done: SimpleQueue[Any]) -> AbstractContextManager[None]:
    """Return a context in which Ctrl-C puts None into the queue `done`.

    A KeyboardInterrupt inside the queue could leave its lock held. If the program has its own handler of Ctrl-C, this
    handler remains. Outside the main thread Ctrl-C is handled as before.
    """
    usual = signal.getsignal(signal.SIGINT) is signal.default_int_handler
    return _at_interrupts(lambda: done.put(None)) if usual else nullcontext()


@contextmanager
def uninterrupted() -> Iterator[None]:
    """Delay Ctrl-C until the block ends, in the main thread and if Python installed the handler."""
    delayed = list[bool]()
    try:
        with _at_interrupts(lambda: delayed.append(True)):
            yield
    finally:
        if delayed:
            signal.raise_signal(signal.SIGINT)
