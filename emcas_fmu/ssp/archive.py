"""SSP archives as files: read without trust, written with the same bytes for the same contents."""

from __future__ import annotations

import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path

from ..errors import EmcasError, unreadable
from ..writing import write_zip
from .schema import DEFAULT, SspError


class Archive:
    """The files of an SSP by name, unpacked on demand.

    Raises SspError if the file is no archive, EmcasError if it cannot be opened at all.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        try:
            with zipfile.ZipFile(path) as archive:
                self.names = tuple(name for name in archive.namelist() if not name.endswith("/"))
        except zipfile.BadZipFile as error:
            raise SspError(f"{path}: is not a ZIP archive, so not an SSP") from error
        except OSError as error:
            raise EmcasError(unreadable(path, error)) from error

    def read(self, name: str) -> bytes:
        """Return the contents of a file. Raises SspError if it is not there or damaged."""
        if name not in self.names:
            raise SspError(f"{name}: is not in {self.path.name}")
        try:
            with zipfile.ZipFile(self.path) as archive:
                return archive.read(name)
        # What zipfile says of damage, of encryption and of compression it does not know.
        except (zipfile.BadZipFile, zlib.error, EOFError, RuntimeError, OSError) as error:
            raise SspError(f"{name}: cannot be unpacked from {self.path.name}: {error}") from error

    @property
    def structures(self) -> tuple[str, ...]:
        """The SSD files at the root, the default one first; the others are variants."""
        files = (n for n in self.names if "/" not in n and n.endswith(".ssd"))
        return tuple(sorted(files, key=lambda name: (name != DEFAULT, name)))

    def contents(self) -> dict[str, bytes]:
        """Return all files by name. Raises SspError as `read` does."""
        return {name: self.read(name) for name in self.names}


def file_content(path: Path) -> bytes:
    """Return what is in a file. Raises SspError if it cannot be read."""
    try:
        return path.read_bytes()
    except OSError as error:
        raise SspError(unreadable(path, error)) from error


def write_archive(contents: Mapping[str, bytes], target: Path) -> None:
    """Write files to a ZIP archive. Raises EmcasError if that cannot be done."""
    write_zip(contents, target, lambda name: (name != DEFAULT, "/" in name, name))
