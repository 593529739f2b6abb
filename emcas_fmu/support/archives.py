"""Reading of FMUs and SSPs from unknown sources: names, sizes and compression in the ZIP archive are checked first."""

from __future__ import annotations

import re
import zipfile
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path

from ..errors import EmcasError, unreadable

# Limits of an archive. An FMU of this package for five platforms, with references, has 50 files with 2 MB in all,
# compressed to a third; FMUs of others, with tables and documentation, are up to a hundred times larger.
MOST_ENTRIES = 10_000
MOST_BYTES = 1 << 30  # of all entries, unpacked
MOST_RATIO = 50  # of the entries' unpacked size to the archive's; text reaches 20
SMALL = 16 << 20  # bytes of all entries, unpacked, up to which any ratio is allowed
MOST_XML = 32 << 20  # bytes of all XML documents; a parsed document needs ten times its size in memory
MOST_FOLDERS = 16  # inside each other
_XML = (".xml", ".ssd", ".ssv", ".ssm", ".ssb")
_ENCRYPTED = 0x1
_METHODS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
# Names that lead out of the folder where an archive is unpacked, or that an operating system interprets differently.
_UNSOUND = re.compile(r"/|.*[\\:\x00-\x1f\x7f]|(.*/)?\.\.(/|$)", re.DOTALL)


@contextmanager
def reading(source: Path | bytes, name: str, what: str, error: type[EmcasError] = EmcasError,
            ) -> Iterator[zipfile.ZipFile]:
    """Open an archive, from a file or its bytes, after a check of names, sizes, number and compression of its entries.

    `name` is the file's name and `what` the expected kind, such as "an FMU", for messages. Raises `error` if the file
    is not a ZIP archive, fails a check, or is damaged where it is read; EmcasError if it cannot be opened.
    """
    try:
        archive = zipfile.ZipFile(source if isinstance(source, Path) else BytesIO(source))
    except (zipfile.BadZipFile, UnicodeDecodeError, NotImplementedError) as cause:
        raise error(f"{name}: is not {what}: it is not a ZIP archive ({cause})") from cause
    except OSError as cause:
        raise EmcasError(unreadable(name, cause)) from cause
    with archive:
        if problem := _problem(archive, len(source) if isinstance(source, bytes) else source.stat().st_size):
            raise error(f"{name}: is not unpacked: {problem}; create {what} again")
        try:
            yield archive
        except (zipfile.BadZipFile, zlib.error, EOFError, RuntimeError, OSError) as damage:
            raise error(f"{name}: cannot be unpacked ({damage}); copy or build it again") from damage


def _problem(archive: zipfile.ZipFile, size: int) -> str:
    """Return the problem of an archive's entries, "" if there is none; `size` is the size of the archive [bytes]."""
    entries = archive.infolist()
    total = sum(entry.file_size for entry in entries)
    if len(entries) > MOST_ENTRIES:
        return f"it has {len(entries)} entries, more than {MOST_ENTRIES}"
    if total > MOST_BYTES:
        return f"its entries are {_mb(total)} unpacked, more than {_mb(MOST_BYTES)}"
    if total > max(SMALL, MOST_RATIO * size):
        return (f"its entries are {_mb(total)} unpacked, {total / size:.0f} times the archive's size, more than "
                f"{MOST_RATIO} times")
    documents = sum(entry.file_size for entry in entries if entry.filename.lower().endswith(_XML))
    if documents > MOST_XML:
        return f"its XML documents are {_mb(documents)}, more than {_mb(MOST_XML)}"
    tests: tuple[tuple[Callable[[zipfile.ZipInfo], object], str], ...] = (
        # ZipInfo.filename is cut at a zero byte, and on Windows its backslashes are replaced.
        (lambda e: _UNSOUND.match(e.orig_filename), "has a name that is not a path inside the archive"),
        (lambda e: e.filename.count("/") > MOST_FOLDERS, f"is in more than {MOST_FOLDERS} folders inside each other"),
        (lambda e: e.flag_bits & _ENCRYPTED, "is encrypted"),
        (lambda e: e.compress_type not in _METHODS, "is neither stored nor packed by deflate"))
    return next((f"entry {e.filename!r:.200} {said}" for e in entries for test, said in tests if test(e)), "")


def _mb(size: int) -> str:
    return f"{size / (1 << 20):.0f} MB"
