"""Import of libraries that only some functions need: those of the package's extras, and others."""

from __future__ import annotations

from importlib import import_module

from ..errors import EmcasError


def absent(extra: str, what: str, *modules: str) -> str:
    """Return the message of the error that :func:`require` raises; "" if it raises none."""
    try:
        require(extra, what, *modules)
    except EmcasError as error:
        return str(error)
    return ""


def require(extra: str, what: str, *modules: str) -> None:
    """Import modules of an `extra`, or with "" of other packages. Raises EmcasError, "`what` ...", if that fails."""
    for module in modules:
        try:
            import_module(module)
        except ModuleNotFoundError as error:
            install = f"'emcas-fmu[{extra}]'" if extra else module
            raise EmcasError(f"{what} the Python package {module}, which is not installed: "
                             f"pip install {install}") from error
        except (ImportError, MemoryError, OSError) as error:
            reason = " ".join(str(error).split()) or "there is not enough memory"
            raise EmcasError(f"{what} the Python package {module}, which is installed but cannot be loaded: {reason}; "
                             "free some memory, or install it again") from error
