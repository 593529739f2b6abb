"""Read ZIP archives of other people, FMUs and SSPs: without trust, and no larger than memory allows."""

from __future__ import annotations

import re
import zipfile
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path

from ..errors import EmcasError, unreadable

# What an archive may hold. An FMU of ours for five platforms, with its references, is 50 files of 2 MB, packed to a
# third; other people's with tables and documentation are up to a hundred times that.
MOST_ENTRIES = 10_000
MOST_BYTES = 1 << 30  # unpacked
MOST_RATIO = 50  # of unpacked to packed; of text it is up to 20
SMALL = 16 << 20  # bytes for which no ratio is asked
MOST_XML = 32 << 20  # bytes of all documents, which take ten times as many when they are parsed
MOST_FOLDERS = 16  # inside each other
_XML = (".xml", ".ssd", ".ssv", ".ssm", ".ssb")
_ENCRYPTED = 0x1
_METHODS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
# A name that leads out of the folder it is unpacked to, or that a system takes for something else.
_UNSOUND = re.compile(r"/|.*[\\:\x00-\x1f\x7f]|(.*/)?\.\.(/|$)", re.DOTALL)


@contextmanager
def reading(source: Path | bytes, name: str, what: str, error: type[EmcasError] = EmcasError,
            ) -> Iterator[zipfile.ZipFile]:
    """Open an archive, from a file or its bytes, whose entries are sound by name, size, number and method.

    `name` is the file's and `what` the kind it is to be, such as an FMU. Raises `error` where it is no archive, is not
    sound, or what is read of it is damaged; EmcasError where the file cannot be opened.
    """
    try:
        archive = zipfile.ZipFile(source if isinstance(source, Path) else BytesIO(source))
    except (zipfile.BadZipFile, UnicodeDecodeError, NotImplementedError) as cause:
        raise error(f"{name}: is not {what}: it is not a ZIP archive ({cause})") from cause
    except OSError as cause:
        raise EmcasError(unreadable(name, cause)) from cause
    with archive:
        if problem := _problem(archive, len(source) if isinstance(source, bytes) else source.stat().st_size):
            raise error(f"{name}: is not unpacked: {problem}; have {what} made again")
        try:
            yield archive
        except (zipfile.BadZipFile, zlib.error, EOFError, RuntimeError, OSError) as damage:
            raise error(f"{name}: cannot be unpacked ({damage}); copy or build it again") from damage


def _problem(archive: zipfile.ZipFile, size: int) -> str:
    """Return what is wrong with the entries of an archive of a `size` in bytes; empty where nothing is."""
    entries = archive.infolist()
    total = sum(entry.file_size for entry in entries)
    if len(entries) > MOST_ENTRIES:
        return f"it has {len(entries)} entries, and {MOST_ENTRIES} may be"
    if total > MOST_BYTES:
        return f"its entries are {_mb(total)} unpacked, and {_mb(MOST_BYTES)} may be"
    if total > max(SMALL, MOST_RATIO * size):
        return f"its entries are {_mb(total)} unpacked, {total / size:.0f} times its size, and {MOST_RATIO} may be"
    documents = sum(entry.file_size for entry in entries if entry.filename.lower().endswith(_XML))
    if documents > MOST_XML:
        return f"its XML documents are {_mb(documents)}, and {_mb(MOST_XML)} may be"
    tests: tuple[tuple[Callable[[zipfile.ZipInfo], object], str], ...] = (
        # ZipInfo has cut the name at a zero byte, and turned what Windows' separators were into slashes there.
        (lambda e: _UNSOUND.match(e.orig_filename), "has a name that is no path inside the archive"),
        (lambda e: e.filename.count("/") > MOST_FOLDERS, f"is in more than {MOST_FOLDERS} folders inside each other"),
        (lambda e: e.flag_bits & _ENCRYPTED, "is encrypted"),
        (lambda e: e.compress_type not in _METHODS, "is packed by a method other than deflate"))
    return next((f"entry {e.filename!r:.200} {said}" for e in entries for test, said in tests if test(e)), "")


def _mb(size: int) -> str:
    return f"{size / (1 << 20):.0f} MB"
