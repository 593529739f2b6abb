"""Where the project's data files are."""

from __future__ import annotations

import os
import stat
import tempfile
from functools import cache
from pathlib import Path

from platformdirs import user_cache_path

from ..errors import in_words
from .progress import warn

_LIBRARY = 2_000_000  # bytes: a compiled library is smaller


def models_directory() -> Path:
    """Return the folder of parameter sets: inside the package when installed, beside it in a checkout.

    Raises FileNotFoundError naming the file looked for and both places.
    """
    package = Path(__file__).resolve().parents[1]
    folders = (package / "models", package.parent / "models")
    for folder in folders:
        if (folder / "emcas.toml").is_file():
            return folder
    raise FileNotFoundError("the default parameter file emcas.toml is missing: "
                            f"looked in {folders[0]} and {folders[1]}")


def named_sets() -> dict[str, Path]:
    """Return the files of the parameter sets that are shipped beside the default one, by name."""
    return {path.stem: path for path in sorted((models_directory() / "sets").glob("*.toml"))}


def as_given(file: Path | str) -> str:
    """Return what names a file: its path as it was given, or the name of a shipped set."""
    return next((name for name, path in named_sets().items() if path == Path(file)), str(file))


@cache
def cache_directory() -> Path:
    """Return a folder for what is compiled: the user's cache, or one of the user's own among the temporary ones.

    What is there is executed: a folder in which others may write is not used, nor one that can be replaced. That is
    announced. Raises OSError where neither can be used.
    """
    mine = Path(tempfile.gettempdir()) / f"emcas-{os.getuid() if hasattr(os, 'getuid') else 'cache'}"
    try:
        return _private(user_cache_path("emcas"))
    except OSError as error:
        folder = _private(mine)
        warn(f"{in_words(error)}; {folder} is used instead")
        return folder


def _private(folder: Path) -> Path:
    """Return a folder, made if need be, that is the user's alone and has room. Raises OSError naming it."""
    try:
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        folder = folder.resolve()  # a link on the way to it may be another's
        if hasattr(os, "getuid"):  # elsewhere the folders are each user's by themselves
            _refuse_shared(folder)
        with tempfile.TemporaryFile(dir=folder) as probe:
            probe.write(bytes(_LIBRARY))
    except OSError as error:
        if error.errno is None:
            raise
        raise OSError(error.errno, error.strerror, str(folder)) from error
    return folder


def _refuse_shared(folder: Path) -> None:
    """Raise OSError for a folder that another user may write to, or replace; close it to others' reading."""
    user, mode = os.getuid(), folder.stat().st_mode
    # Where not all users of the system are known, as in a container, the root folder's owner is its administrator.
    trusted = {user, 0, Path(folder.anchor).stat().st_uid}
    reason = ""
    if folder.stat().st_uid != user:
        reason = "it belongs to another user"
    elif mode & (stat.S_IWGRP | stat.S_IWOTH):
        reason = f"others may write to it (mode {stat.S_IMODE(mode):04o}), remove it"
    for parent in folder.parents:
        found = parent.stat()
        if found.st_uid not in trusted:
            reason = reason or f"{parent} belongs to another user"
        elif found.st_mode & stat.S_IWOTH and not found.st_mode & stat.S_ISVTX:
            reason = reason or f"anybody may replace it, since {parent} has mode {stat.S_IMODE(found.st_mode):04o}"
    if reason:
        raise OSError(f"{folder}: not used for what is compiled: {reason}")
    folder.chmod(0o700)
