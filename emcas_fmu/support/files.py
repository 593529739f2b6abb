"""Paths of the package's data files and of its cache."""

from __future__ import annotations

import os
import stat
import tempfile
from functools import cache
from itertools import takewhile
from pathlib import Path

from platformdirs import user_cache_path

from ..errors import in_words
from .progress import announce

_LIBRARY = 2_000_000  # bytes: a compiled library is smaller


def models_directory() -> Path:
    """Return the folder of parameter sets, inside or beside the package. Raises FileNotFoundError if there is none."""
    package = Path(__file__).resolve().parents[1]
    folders = (package / "models", package.parent / "models")
    for folder in folders:
        if (folder / "emcas.toml").is_file():
            return folder
    raise FileNotFoundError("the default parameter file emcas.toml is missing: "
                            f"looked in {folders[0]} and {folders[1]}; install the package again")


def named_sets() -> dict[str, Path]:
    """Return the files of the shipped parameter sets, other than the default one, by name."""
    return {path.stem: path for path in sorted((models_directory() / "sets").glob("*.toml"))}


def described_sets() -> dict[str, str]:
    """Return the descriptions of the shipped sets, the first comment in each file, by the sets' names."""
    lines = {name: path.read_text(encoding="utf-8").splitlines() for name, path in named_sets().items()}
    return {name: " ".join(line[2:] for line in takewhile(lambda line: line.startswith("# "), each))
            for name, each in lines.items()}


def as_given(file: Path | str) -> str:
    """Return the name with which a user chooses a file: the name of a shipped set, otherwise the path unchanged."""
    return next((name for name, path in named_sets().items() if path == Path(file)), str(file))


@cache
def cache_directory() -> Path:
    """Return a folder for compiled libraries: the user's cache or else, with a warning, a private temporary folder.

    Files in it are executed: a folder that others may write to or replace is not used. Raises OSError if neither folder
    can be used.
    """
    mine = Path(tempfile.gettempdir()) / f"emcas-{os.getuid() if hasattr(os, 'getuid') else 'cache'}"
    try:
        return _private(user_cache_path("emcas"))
    except OSError as error:
        folder = _private(mine)
        announce(f"{in_words(error)}; {folder} is used instead")
        return folder


def _private(folder: Path) -> Path:
    """Return the resolved path of a folder, created if necessary.

    Raises OSError if it cannot be created, if others may write to it or replace it, or if the disk is full.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        folder = folder.resolve()  # its path may contain another user's link
        if hasattr(os, "getuid"):  # other systems give each user a private folder
            _refuse_shared(folder)
        with tempfile.TemporaryFile(dir=folder) as probe:
            probe.write(bytes(_LIBRARY))
    except OSError as error:
        if error.errno is None:
            raise
        raise OSError(error.errno, error.strerror, str(folder)) from error
    return folder


def _refuse_shared(folder: Path) -> None:
    """Raise OSError for a folder that another user may write to or replace; otherwise remove other users' rights."""
    user, mode = os.getuid(), folder.stat().st_mode
    # In a container the administrator may have another number than 0: that of the root folder's owner.
    trusted = {user, 0, Path(folder.anchor).stat().st_uid}
    reason = ""
    if folder.stat().st_uid != user:
        reason = "it belongs to another user"
    elif mode & (stat.S_IWGRP | stat.S_IWOTH):
        reason = f"others may write to it (mode {stat.S_IMODE(mode):04o}); remove this folder"
    for parent in folder.parents:
        status = parent.stat()
        if status.st_uid not in trusted:
            reason = reason or f"{parent} belongs to another user"
        elif status.st_mode & stat.S_IWOTH and not status.st_mode & stat.S_ISVTX:
            reason = reason or f"anybody may replace it, since {parent} has mode {stat.S_IMODE(status.st_mode):04o}"
    if reason:
        raise OSError(f"{folder}: not used for compiled libraries: {reason}")
    folder.chmod(0o700)
