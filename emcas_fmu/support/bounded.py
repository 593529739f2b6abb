"""A time limit for code that may not end by itself."""

from __future__ import annotations

import ctypes
import threading
from collections.abc import Iterator
from contextlib import contextmanager


class Endless(BaseException):
    """The time limit has passed; not an Exception, so that `except Exception` in the code does not catch it."""


@contextmanager
def bounded(seconds: float) -> Iterator[None]:
    """Raise Endless in the block, at the line that is being executed, if the block lasts longer than `seconds`.

    A timer in another thread does not slow the code down. A call of C code, such as time.sleep, ends first.
    """
    thread, lock, running = threading.get_ident(), threading.Lock(), [True]

    def end() -> None:
        with lock:
            if running:
                ctypes.pythonapi.PyThreadState_SetAsyncExc(ctypes.c_ulong(thread), ctypes.py_object(Endless))

    timer = threading.Timer(seconds, end)
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        with lock:
            running.clear()
        timer.cancel()
