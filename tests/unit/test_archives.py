"""Unsound archives of other people are refused with one line, before they are unpacked."""

from __future__ import annotations

import struct
import tracemalloc
import zipfile
from collections.abc import Callable
from io import BytesIO
from pathlib import Path

import pytest

from emcas_fmu import EmcasError
from emcas_fmu.ssp.archive import SspError, parse, read_archive
from emcas_fmu.ssp.check import check
from emcas_fmu.ssp.structure import read_interface
from emcas_fmu.support.archives import MOST_ENTRIES, MOST_FOLDERS, MOST_RATIO, SMALL, reading
from tests.commands import emcas

DESCRIPTION = """<fmiModelDescription fmiVersion="2.0" modelName="m" guid="g"><CoSimulation modelIdentifier="{}"/>
<ModelVariables><ScalarVariable name="x" valueReference="0"><Real/></ScalarVariable></ModelVariables>
<ModelStructure/></fmiModelDescription>"""
MB = 1 << 20


def _zip(*entries: tuple[str, bytes]) -> bytes:
    file = BytesIO()
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in entries:
            archive.writestr(name, content)
    return file.getvalue()


def _patched(at: int, value: int) -> bytes:
    """Return an archive of one entry with a changed word of its headers, by the offset in the central header."""
    content = bytearray(_zip(("modelDescription.xml", b"<x/>")))
    begin = content.index(b"PK\x01\x02")
    content[begin + at:begin + at + 2] = content[at - 2:at] = struct.pack("<H", value)
    return bytes(content)


UNSOUND: dict[str, tuple[Callable[[], bytes], str]] = {
    "absolute path": (lambda: _zip(("/etc/x", b"")), "not a path inside"),
    "drive": (lambda: _zip(("C:x", b"")), "not a path inside"),
    "backslash": (lambda: _zip(("a\\b", b"")), "not a path inside"),
    "parent": (lambda: _zip(("a/../../b", b"")), "not a path inside"),
    "newline": (lambda: _zip(("a\nb", b"")), "not a path inside"),
    "zero byte": (lambda: _zip(("aQb", b"")).replace(b"aQb", b"a\0b"), "not a path inside"),
    "encrypted": (lambda: _patched(8, 0x1), "is encrypted"), "method": (lambda: _patched(10, 97), "stored nor packed"),
    "folders": (lambda: _zip(("a/" * (MOST_FOLDERS + 1) + "b", b"")), "folders inside each other"),
    "entries": (lambda: _zip(*((str(i), b"") for i in range(MOST_ENTRIES + 1))), f"more than {MOST_ENTRIES}"),
    "ratio": (lambda: _zip(("x.bin", bytes(64 * MB))), f"more than {MOST_RATIO} times"),
    "documents": (lambda: _zip(("x.bin", bytes(range(256)) * 4096), ("x.xml", bytes(33 * MB))), "more than"),
    "text": (lambda: b"hello", "is not a ZIP archive"), "empty": (lambda: b"", "is not a ZIP archive"),
}


def check_refused(path: Path, message: str) -> None:
    done = emcas("validate", path)
    assert done.exit_code == 2, done.output
    assert message in done.stderr
    assert done.stderr.count("\n") == 1


@pytest.mark.parametrize("case", UNSOUND)
def test_unsound_archive_is_refused(case: str, tmp_path: Path) -> None:
    """As an FMU, as an SSP, and as an FMU inside an SSP."""
    make, message = UNSOUND[case]
    content, path = make(), tmp_path / "other.fmu"
    path.write_bytes(content)
    check_refused(path, message)
    with pytest.raises(SspError, match=message):
        read_archive(path)
    with pytest.raises(SspError, match=message):
        read_interface(content, "resources/other.fmu")


def test_sound_archive_is_read() -> None:
    """Zeros up to the size from which the ratio counts, empty files and folders, names with umlauts and dots."""
    entries = (("zeros.bin", bytes(SMALL - 1)), ("folder/", b""), ("Ärmel/..x", b""), ("a/b..", b"1"))
    with reading(_zip(*entries), "x.fmu", "an FMU") as archive:
        assert {name: archive.read(name) for name in archive.namelist()} == dict(entries)


@pytest.mark.slow
def test_archive_bomb_is_not_unpacked(tmp_path: Path) -> None:
    """200 MB of zeros in 0.2 MB, as the structure of an SSP and as the description of an FMU."""
    bomb = _zip(("modelDescription.xml", bytes(200 * MB)))
    structure = _zip(("SystemStructure.ssd", bytes(200 * MB)))
    (tmp_path / "bomb.ssp").write_bytes(structure)
    tracemalloc.start()
    try:
        report = check(tmp_path / "bomb.ssp")
        with pytest.raises(SspError, match="200 MB unpacked"):
            read_interface(bomb, "resources/EMCAS.fmu")
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert "200 MB unpacked" in str(report.errors[0])
    assert peak < 20 * MB  # the archives are 0.2 MB each; the reader's tables 0.1 MB


@pytest.mark.parametrize("identifier", ["../../x", "/tmp/x", "a.b", "a b", "", "é", "1a"])
def test_model_identifier_outside_the_archive_is_refused(identifier: str, tmp_path: Path) -> None:
    path = tmp_path / "other.fmu"
    path.write_bytes(_zip(("modelDescription.xml", DESCRIPTION.format(identifier).encode()),
                          ("binaries/linux64/x.so", b""), ("binaries/win64/x.dll", b"")))
    check_refused(path, "modelIdentifier")


def test_doctype_is_refused() -> None:
    with pytest.raises(SspError, match="has a DOCTYPE"):
        parse(b'<!DOCTYPE a [<!ENTITY e "x">]><a><b>&e;</b></a>', "SystemStructure.ssd")


def test_folder_and_missing_file_are_refused(tmp_path: Path) -> None:
    for path in (tmp_path, tmp_path / "absent.ssp"):
        with pytest.raises(EmcasError, match="cannot be read"), reading(path, str(path), "an SSP", SspError):
            pass
