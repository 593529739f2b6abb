"""Where the project's data files are."""

from __future__ import annotations

import os
import tempfile
import zipfile
from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path
from typing import Any

from platformdirs import user_cache_path

_EPOCH = (1980, 1, 1, 0, 0, 0)  # the earliest date a ZIP archive can hold


def models_directory() -> Path:
    """Return the folder of parameter sets: inside the package when installed, beside it in a checkout.

    Raises FileNotFoundError naming the file looked for and both places.
    """
    package = Path(__file__).resolve().parent
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

    Raises OSError where neither can be written.
    """
    mine = Path(tempfile.gettempdir()) / f"emcas-{os.getuid() if hasattr(os, 'getuid') else 'cache'}"
    try:
        return _writable(user_cache_path("emcas"))
    except OSError:
        folder = _writable(mine)
        if hasattr(os, "getuid") and folder.stat().st_uid != os.getuid():  # somebody else was here first
            raise
        return folder


def write_zip(contents: Mapping[str, bytes], target: Path, order: Callable[[str], Any], executable: str = "") -> None:
    """Write files to a ZIP archive, whole or not at all, with the same bytes for the same contents.

    They stand in the `order` of a sort key of their names; those whose names begin with `executable` may be run.
    Raises OSError.
    """
    partial = target.with_name(f".{target.name}.{os.getpid()}.part")
    try:
        with zipfile.ZipFile(partial, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as archive:
            for name in sorted(contents, key=order):
                info = zipfile.ZipInfo(name, _EPOCH)
                info.compress_type = zipfile.ZIP_DEFLATED
                info.create_system = 3
                info.external_attr = (0o755 if executable and name.startswith(executable) else 0o644) << 16
                archive.writestr(info, contents[name])
        partial.replace(target)
    finally:
        partial.unlink(missing_ok=True)


def _writable(folder: Path) -> Path:
    folder.mkdir(parents=True, exist_ok=True, mode=0o700)
    with tempfile.TemporaryFile(dir=folder):
        return folder
