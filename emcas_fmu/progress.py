"""How long work reports how far it is."""

from __future__ import annotations

import logging
from collections.abc import Callable

LOG = logging.getLogger("emcas_fmu")
"""What takes long and is done once, such as compiling, is announced here (level info)."""

Progress = Callable[[str, int, int], None]
"""Called with the name of what is begun, how many are done and how many there are."""


def silent(_name: str, _done: int, _total: int) -> None:
    """Report to nobody."""
