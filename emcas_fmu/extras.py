"""The package's extras: heavy libraries that only some uses need."""

from __future__ import annotations

from importlib import import_module

from .errors import EmcasError


def require(extra: str, what: str, *modules: str) -> None:
    """Import the modules of an extra. Raises EmcasError, naming it, where one is not installed."""
    for module in modules:
        try:
            import_module(module)
        except ImportError as error:
            raise EmcasError(f"{what} the Python package {module}, which is not installed: "
                             f"pip install 'emcas-fmu[{extra}]'") from error
