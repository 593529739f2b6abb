"""Libraries that only some functions need: the package's extras, and others."""

from __future__ import annotations

from importlib import import_module

from ..errors import EmcasError


def absent(extra: str, what: str, *modules: str) -> str:
    """Return a message with what to install if a module of an extra is missing; empty if none is."""
    try:
        require(extra, what, *modules)
    except EmcasError as error:
        return str(error)
    return ""


def require(extra: str, what: str, *modules: str) -> None:
    """Import the modules of an extra, or packages by their names if `extra` is empty.

    Raises EmcasError with what to install if one is missing, and with the reason if one cannot be loaded.
    """
    for module in modules:
        try:
            import_module(module)
        except ModuleNotFoundError as error:
            install = f"'emcas-fmu[{extra}]'" if extra else module
            raise EmcasError(f"{what} the Python package {module}, which is not installed: "
                             f"pip install {install}") from error
        except (ImportError, MemoryError, OSError) as error:
            reason = " ".join(str(error).split()) or "there is not enough memory"
            raise EmcasError(f"{what} the Python package {module}, which is there and cannot be loaded: {reason}; free "
                             "some memory, or install it again") from error
