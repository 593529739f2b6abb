"""Writing of files: each is written beside its path, flushed to the disk, and moved to the path.

If writing is interrupted, or the disk is full, the path still has the whole old file, or already the whole new one. No
other module of the package opens a file for writing.
"""

from __future__ import annotations

import os
import secrets
import stat
import sys
import zipfile
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from tempfile import TemporaryFile
from typing import IO, Any, BinaryIO

from ..errors import EmcasError, writing
from .progress import uninterrupted

PARTIAL = ".partial"
"""Suffix of a file while it is written; such a file remains only if the process is killed."""

_BLOCK = 4096  # bytes; a file occupies one block or more
_SHOWN = 40  # most characters of a file's name in the name of its partial file, which must not be too long
_EPOCH = (1980, 1, 1, 0, 0, 0)  # the earliest date in a ZIP archive


def write(path: Path | str, content: str | bytes) -> int:
    """Write a file, whole or not at all, and return its size [bytes]; text is in UTF-8, with its line ends unchanged.

    Raises EmcasError if it cannot be written.
    """
    with whole(path) as file:
        return file.write(_bytes(content))


def write_folder(folder: Path, contents: Mapping[str, str | bytes]) -> list[Path]:
    """Write files that belong together into a folder, which is created if necessary; return their paths.

    When all files are on the disk they are moved to their paths one by one; Ctrl-C is delayed meanwhile. Raises
    EmcasError if a file cannot be written.
    """
    with writing(folder):
        folder.mkdir(parents=True, exist_ok=True)
    paths = [folder / name for name in contents]
    with _beside(paths) as files:
        for path, content, file in zip(paths, contents.values(), files, strict=True):
            with writing(path):
                file.write(_bytes(content))
    return paths


@contextmanager
def whole(path: Path | str) -> Iterator[BinaryIO]:
    """Yield a file to write to; it is moved to `path` when the block ends, and removed if the block raises.

    Raises EmcasError if the file cannot be written.
    """
    with _beside([Path(path)]) as (file,), writing(path):
        yield file


def append(path: Path, text: str) -> None:
    """Append text to a file, all of it or nothing. Raises EmcasError if it cannot be written."""
    with writing(path), path.open("ab", buffering=0) as file:
        regular = stat.S_ISREG(os.fstat(file.fileno()).st_mode)
        before = file.tell() if regular else 0
        try:
            left = memoryview(text.encode())
            while left:
                left = left[file.write(left):]
            if regular:
                os.fsync(file.fileno())
        except BaseException:
            if regular:
                file.truncate(before)
            raise


def write_zip(contents: Mapping[str, bytes], target: Path, order: Callable[[str], Any], executable: str = "") -> None:
    """Write files to a ZIP archive; equal contents result in equal bytes.

    `order(name)` is the sort key of the files; files whose names begin with `executable` are made executable. Raises
    EmcasError if the archive cannot be written.
    """
    with whole(target) as file, zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as archive:
        for name in sorted(contents, key=order):
            info = zipfile.ZipInfo(name, _EPOCH)
            info.compress_type = zipfile.ZIP_DEFLATED
            info.create_system = 3
            info.external_attr = (0o755 if executable and name.startswith(executable) else 0o644) << 16
            archive.writestr(info, contents[name])


def check_target(path: Path, ending: str, error: type[EmcasError]) -> None:
    """Raise `error` if the path has another ending, is a folder, or its folder does not exist."""
    if path.suffix != ending:
        raise error(f"{path}: the output must end in {ending}")
    if path.is_dir() or not path.parent.is_dir():
        raise error(f"{path}: {'is a folder' if path.is_dir() else f'there is no folder {path.parent}'}")


def try_file(path: Path) -> None:
    """Raise EmcasError if a file could not be written; change nothing."""
    with writing(path):
        file = _Beside(path)
        try:
            if file.partial:
                _try_block(file.opened)
        finally:
            file.discard()


def try_folder(folder: Path, made: Path | None = None) -> None:
    """Raise EmcasError if a folder could not be written to; the message names `made` instead if it is to be created."""
    with writing(made or folder), TemporaryFile(dir=folder) as file:
        _try_block(file)


def _bytes(content: str | bytes) -> bytes:
    return content if isinstance(content, bytes) else content.encode()


def _try_block(file: IO[bytes]) -> None:
    """Write one block to a file, to see whether the disk is full. Raises OSError."""
    file.write(bytes(_BLOCK))
    file.flush()
    os.fsync(file.fileno())


class _Beside:
    """A file that is written beside its path, or directly if it is a terminal, pipe or device. Raises OSError."""

    def __init__(self, path: Path) -> None:
        self.partial: Path | None = None
        self.target = Path(os.path.realpath(path))  # the target of a link is replaced, not the link
        try:
            self._replaced: os.stat_result | None = path.stat()
        except FileNotFoundError:
            self._replaced = None
        if self._replaced and (stream := _standard_stream(self._replaced)):
            self.opened: BinaryIO = os.fdopen(stream, "wb")
        elif self._replaced and not stat.S_ISREG(self._replaced.st_mode):
            self.opened = path.open("wb")
        else:
            if self._replaced:
                os.close(os.open(self.target, os.O_WRONLY))  # a file that may not be written is not replaced either
            partial = self.target.with_name(f".{self.target.name[:_SHOWN]}.{secrets.token_hex(6)}{PARTIAL}")
            self.opened = partial.open("xb")  # has the rights of any new file in this folder
            self.partial = partial

    def finish(self) -> None:
        """Flush the file to the disk and close it. Raises OSError."""
        self.opened.flush()
        if self.partial:
            if self._replaced:
                _keep_rights(self.partial, self._replaced)
            os.fsync(self.opened.fileno())
        self.opened.close()

    def move(self) -> None:
        """Move the file to its path. Raises OSError."""
        if self.partial:
            self.partial.replace(self.target)
            self.partial = None

    def discard(self) -> None:
        """Close the file, and remove it if it has not been moved."""
        with suppress(OSError):
            self.opened.close()
        if self.partial:
            with suppress(OSError):
                self.partial.unlink()


@contextmanager
def _beside(paths: Iterable[Path]) -> Iterator[list[BinaryIO]]:
    """Yield files to write to, which are all moved to their paths when the block ends."""
    files: dict[Path, _Beside] = {}
    try:
        for path in paths:
            with writing(path):
                files[path] = _Beside(path)
        yield [file.opened for file in files.values()]
        for path, file in files.items():
            with writing(path):
                file.finish()
        with uninterrupted():
            for path, file in files.items():
                with writing(path):
                    file.move()
    finally:
        for file in files.values():
            file.discard()


def _standard_stream(file: os.stat_result) -> int | None:
    """Return a new descriptor of standard output or error if `file` is one of them, such as /dev/stdout, else None.

    The shell may have redirected that stream to a file: the stream would not follow to a file that replaces it.
    """
    for stream, number in ((sys.stdout, 1), (sys.stderr, 2)):
        with suppress(OSError):
            if os.path.samestat(file, os.fstat(number)):
                if stream is not None:
                    stream.flush()
                return os.dup(number)
    return None


def _keep_rights(partial: Path, replaced: os.stat_result) -> None:
    """Set the rights of a file, and its owner if that is allowed, to those of the file that it replaces."""
    if hasattr(os, "chown"):
        with suppress(OSError):
            os.chown(partial, replaced.st_uid, replaced.st_gid)
    partial.chmod(stat.S_IMODE(replaced.st_mode))
