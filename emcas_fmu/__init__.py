"""Fin actuators for flight simulation: simulate them in Python, or build FMI co-simulation FMUs.

Programs use the names of :mod:`emcas_fmu.api`, imported from here: ``from emcas_fmu import load_parameters``.
"""

from __future__ import annotations

from importlib import import_module
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .api import *  # noqa: F403  # __all__ is there

__version__ = "0.3.0"
__date__ = "2026-11-23"  # of the version; in the changelog's heading when it is released
__author__ = "The EMCAS-FMU authors"
__copyright__ = f"Copyright (c) 2026 {__author__}"
__license__ = "MIT"


def __getattr__(name: str) -> Any:
    """Import a name of the interface when it is first used, so that commands that do not need it start faster."""
    if not name.startswith("_") and find_spec(f"{__name__}.{name}"):
        return import_module(f"{__name__}.{name}")
    if name == "__all__" or not name.startswith("_"):
        api = import_module(".api", __name__)
        if name == "__all__" or name in api.__all__:
            return getattr(api, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *__getattr__("__all__")})
