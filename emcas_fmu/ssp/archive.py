"""SSP archives as files: read with checks, written with the same bytes for the same contents."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from ..errors import unreadable
from ..support.archives import reading
from ..support.writing import write_zip
from .schema import DEFAULT, SspError


class Archive:
    """The files of an SSP by name, unpacked on demand.

    Raises SspError if the file is not a readable and sound archive.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        with reading(path, str(path), "an SSP", SspError) as archive:
            self.names = tuple(name for name in archive.namelist() if not name.endswith("/"))

    def read(self, name: str) -> bytes:
        """Return the contents of a file. Raises SspError if it is missing or damaged."""
        if name not in self.names:
            raise SspError(f"{name}: is not in {self.path.name}")
        with reading(self.path, f"{self.path.name}/{name}", "an SSP", SspError) as archive:
            return archive.read(name)

    @property
    def structures(self) -> tuple[str, ...]:
        """The SSD files at the root, the default one first; the others are variants."""
        files = (n for n in self.names if "/" not in n and n.endswith(".ssd"))
        return tuple(sorted(files, key=lambda name: (name != DEFAULT, name)))

    def contents(self) -> dict[str, bytes]:
        """Return all files by name. Raises SspError as `read` does."""
        return {name: self.read(name) for name in self.names}


def file_content(path: Path) -> bytes:
    """Return the contents of a file. Raises SspError if it cannot be read."""
    try:
        return path.read_bytes()
    except OSError as error:
        raise SspError(unreadable(path, error)) from error


def write_archive(contents: Mapping[str, bytes], target: Path) -> None:
    """Write files to a ZIP archive. Raises EmcasError if it cannot be written."""
    write_zip(contents, target, lambda name: (name != DEFAULT, "/" in name, name))
