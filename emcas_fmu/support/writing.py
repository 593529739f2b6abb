"""The one way to write a file: beside its place, flushed to the disk, and moved there.

Whoever stops this, and however full the disk is, the place holds the whole new file or what it held before. Nothing
else in the package opens a file for writing.
"""

from __future__ import annotations

import os
import secrets
import signal
import stat
import sys
import threading
import zipfile
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from tempfile import TemporaryFile
from types import FrameType
from typing import IO, Any, BinaryIO

from ..errors import EmcasError, writing

PARTIAL = ".partial"
"""How a file's name ends while it is written; only a process that was killed leaves one."""

_BLOCK = 4096  # bytes, of which a file occupies one or more
_SHOWN = 40  # letters of a name: what is beside a file is not too long a name where the file's own is not
_EPOCH = (1980, 1, 1, 0, 0, 0)  # the earliest date a ZIP archive can hold


def write(path: Path | str, content: str | bytes) -> int:
    """Write a file, whole or not at all, and return its size [bytes]; text in UTF-8, its lines as they are.

    Raises EmcasError, with the remedy.
    """
    with whole(path) as file:
        return file.write(_bytes(content))


def write_folder(folder: Path, contents: Mapping[str, str | bytes]) -> list[Path]:
    """Write files that belong together, and return their paths; the folder is made if there is none.

    None is moved to its place before all are on the disk, and Ctrl-C waits while they are moved, in their order. Raises
    EmcasError, with the remedy.
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
    """Give a file to write to, which is at its place when the block ends, and nowhere where it raises.

    Raises EmcasError, with the remedy.
    """
    with _beside([Path(path)]) as (file,), writing(path):
        yield file


def append(path: Path, text: str) -> None:
    """Write at the end of a file, all of the text or nothing, as a journal and a summary of several steps need it.

    Raises EmcasError, with the remedy.
    """
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
    """Write files to a ZIP archive with the same bytes for the same contents.

    They stand in the `order` of a sort key of their names; those whose names begin with `executable` may be run.
    Raises EmcasError, with the remedy.
    """
    with whole(target) as file, zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as archive:
        for name in sorted(contents, key=order):
            info = zipfile.ZipInfo(name, _EPOCH)
            info.compress_type = zipfile.ZIP_DEFLATED
            info.create_system = 3
            info.external_attr = (0o755 if executable and name.startswith(executable) else 0o644) << 16
            archive.writestr(info, contents[name])


def check_target(path: Path, ending: str, error: type[EmcasError]) -> None:
    """Raise `error` where a file of this ending cannot be made: by its name, or for want of its folder."""
    if path.suffix != ending:
        raise error(f"{path}: the output must end in {ending}")
    if path.is_dir() or not path.parent.is_dir():
        raise error(f"{path}: {'is a folder' if path.is_dir() else f'there is no folder {path.parent}'}")


def try_file(path: Path) -> None:
    """Raise EmcasError, with the remedy, where a file could not be written; leave everything as it was."""
    with writing(path):
        file = _Beside(path)
        try:
            if file.partial:
                _try_block(file.opened)
        finally:
            file.discard()


def try_folder(folder: Path, made: Path | None = None) -> None:
    """Raise EmcasError, with the remedy, where nothing could be written to a folder, or to one `made` in it later."""
    with writing(made or folder), TemporaryFile(dir=folder) as file:
        _try_block(file)


def _bytes(content: str | bytes) -> bytes:
    return content if isinstance(content, bytes) else content.encode()


def _try_block(file: IO[bytes]) -> None:
    """Write as much as any file needs: a disk that has no room for it is full."""
    file.write(bytes(_BLOCK))
    file.flush()
    os.fsync(file.fileno())


class _Beside:
    """A file that is written beside its place; a terminal, pipe or device is written to as it is.

    Raises OSError where the place cannot be written.
    """

    def __init__(self, path: Path) -> None:
        self.partial: Path | None = None
        self.place = Path(os.path.realpath(path))  # the file that a link names is replaced, not the link
        try:
            self._found: os.stat_result | None = path.stat()
        except FileNotFoundError:
            self._found = None
        if self._found and (own := _own_stream(self._found)):
            self.opened: BinaryIO = os.fdopen(own, "wb")
        elif self._found and not stat.S_ISREG(self._found.st_mode):
            self.opened = path.open("wb")
        else:
            if self._found:
                os.close(os.open(self.place, os.O_WRONLY))  # what may not be written to is not replaced, either
            partial = self.place.with_name(f".{self.place.name[:_SHOWN]}.{secrets.token_hex(6)}{PARTIAL}")
            self.opened = partial.open("xb")  # with the rights that any new file gets here
            self.partial = partial

    def finish(self) -> None:
        """Have all of it on the disk. Raises OSError."""
        self.opened.flush()
        if self.partial:
            if self._found:
                _keep_rights(self.partial, self._found)
            os.fsync(self.opened.fileno())
        self.opened.close()

    def move(self) -> None:
        """Put it where it belongs. Raises OSError."""
        if self.partial:
            self.partial.replace(self.place)
            self.partial = None

    def discard(self) -> None:
        """Leave nothing of what is not at its place."""
        with suppress(OSError):
            self.opened.close()
        if self.partial:
            with suppress(OSError):
                self.partial.unlink()


@contextmanager
def _beside(paths: Iterable[Path]) -> Iterator[list[BinaryIO]]:
    """Give files to write to, which are all moved to their places when the block ends."""
    files: dict[Path, _Beside] = {}
    try:
        for path in paths:
            with writing(path):
                files[path] = _Beside(path)
        yield [file.opened for file in files.values()]
        for path, file in files.items():
            with writing(path):
                file.finish()
        with _uninterrupted():
            for path, file in files.items():
                with writing(path):
                    file.move()
    finally:
        for file in files.values():
            file.discard()


def _own_stream(found: os.stat_result) -> int | None:
    """Return a descriptor of standard output or error where that is this file, as /dev/stdout; it has to be closed.

    Another file in its place would not be the one that the shell has opened.
    """
    for stream, number in ((sys.stdout, 1), (sys.stderr, 2)):
        with suppress(OSError):
            if os.path.samestat(found, os.fstat(number)):
                if stream is not None:
                    stream.flush()
                return os.dup(number)
    return None


def _keep_rights(partial: Path, found: os.stat_result) -> None:
    """Give a file the owner, where that may be, and the rights of the one that it replaces."""
    if hasattr(os, "chown"):
        with suppress(OSError):
            os.chown(partial, found.st_uid, found.st_gid)
    partial.chmod(stat.S_IMODE(found.st_mode))


@contextmanager
def _uninterrupted() -> Iterator[None]:
    """Let Ctrl-C wait until the block ends."""
    handler = signal.getsignal(signal.SIGINT)
    if threading.current_thread() is not threading.main_thread() or handler is None:
        yield
        return
    came = []

    def wait(number: int, frame: FrameType | None) -> None:
        came.append(number)

    signal.signal(signal.SIGINT, wait)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, handler)
        if came:
            signal.raise_signal(signal.SIGINT)
