"""How long work reports how far it is."""

from __future__ import annotations

import logging
from collections.abc import Callable

LOG = logging.getLogger("emcas_fmu")
"""What takes long and is done once, such as compiling, is announced here (info), and what falls back (warning)."""

Progress = Callable[[str, int, int], None]
"""Called with the name of what is begun, how many are done and how many there are."""


def warn(message: str) -> None:
    """Announce what is done otherwise than it should be; worker processes leave that to the one that started them."""
    from multiprocessing import parent_process  # late: it takes a while, and is hardly ever needed

    if parent_process() is None:
        LOG.warning(message)


def silent(_name: str, _done: int, _total: int) -> None:
    """Report to nobody."""
