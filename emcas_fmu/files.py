"""Where the project's data files are."""

from __future__ import annotations

import os
import tempfile
from functools import cache
from pathlib import Path

from platformdirs import user_cache_path


def models_directory() -> Path:
    """The folder of parameter sets: inside the package when installed, beside it in a checkout.

    Raises FileNotFoundError naming the file looked for and both places.
    """
    package = Path(__file__).resolve().parent
    folders = (package / "models", package.parent / "models")
    for folder in folders:
        if (folder / "emcas.toml").is_file():
            return folder
    raise FileNotFoundError("the default parameter file emcas.toml is missing: "
                            f"looked in {folders[0]} and {folders[1]}")


@cache
def cache_directory() -> Path:
    """A folder for what is compiled: the user's cache, or one of the user's own among the temporary ones.

    Raises OSError where neither can be written.
    """
    mine = Path(tempfile.gettempdir()) / f"emcas-{os.getuid() if hasattr(os, 'getuid') else 'cache'}"
    try:
        return _writable(user_cache_path("emcas"))
    except OSError:
        found = _writable(mine)
        if hasattr(os, "getuid") and found.stat().st_uid != os.getuid():  # somebody else was here first
            raise
        return found


def _writable(folder: Path) -> Path:
    folder.mkdir(parents=True, exist_ok=True, mode=0o700)
    with tempfile.TemporaryFile(dir=folder):
        return folder
