"""The cache of compiled kernels is used only if no other user can change it."""

from __future__ import annotations

import errno
import logging
import os
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from emcas_fmu.parameters import load_parameters
from emcas_fmu.runtime import compiler, library
from emcas_fmu.simulation import simulate
from emcas_fmu.support import files
from emcas_fmu.support.progress import LOG

pytestmark = pytest.mark.skipif(not hasattr(os, "getuid"), reason="folders have modes and owners")
SMALL = "second-order"


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture) -> Iterator[Path]:
    """The path of the user's cache, which does not exist yet, with its own temporary folder."""
    (tmp_path / "temporary").mkdir()
    folder = tmp_path / "home" / "cache" / "emcas"
    folder.parent.mkdir(parents=True)
    zig_cache = files.cache_directory()  # takes a minute to fill
    monkeypatch.setattr(compiler, "cache_directory", lambda: zig_cache)
    monkeypatch.setattr(files, "user_cache_path", lambda _: folder)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "temporary"))
    caplog.set_level(logging.WARNING, LOG.name)  # commands that ran in this process have lowered it
    for cached in (files.cache_directory, library._library):
        cached.cache_clear()
    yield folder
    monkeypatch.undo()
    for cached in (files.cache_directory, library._library):
        cached.cache_clear()


def _warnings(caplog: pytest.LogCaptureFixture) -> list[str]:
    """Return the warnings without the messages about compiling."""
    return [record.getMessage() for record in caplog.records if record.levelno >= logging.WARNING]


def _shared(folder: Path) -> None:
    folder.mkdir()
    folder.chmod(0o777)


def _give_away(folder: Path) -> None:
    if os.getuid() != 0:
        pytest.skip("only root may change the owner")
    folder.mkdir(exist_ok=True)
    os.chown(folder, 12345, -1)


def _linked(folder: Path) -> None:
    """Make a link to a folder to which everybody may write."""
    _shared(folder.parents[2] / "elsewhere")
    folder.symlink_to(folder.parents[2] / "elsewhere")


@pytest.mark.parametrize(("spoil", "message"), [
    (_shared, "others may write to it (mode 0777)"), (_give_away, "it belongs to another user"), (_linked, "mode 0777"),
    (lambda folder: folder.parent.chmod(0o777), "anybody may replace it, since"),
    (lambda folder: folder.parents[1].chmod(0o777), "anybody may replace it, since"),
    (lambda folder: _give_away(folder.parent), "belongs to another user"),
    (lambda folder: folder.touch(), "cannot be written"),
], ids=["shared", "another's", "link", "in a shared folder", "deep in a shared folder", "in another's folder", "file"])
def test_unsafe_cache_is_not_used_with_one_warning(cache: Path, caplog: pytest.LogCaptureFixture,
                                                   spoil: Callable[[Path], None], message: str) -> None:
    spoil(cache)
    for _ in range(3):
        assert files.cache_directory() == cache.parents[2] / "temporary" / f"emcas-{os.getuid()}"
    (line,) = _warnings(caplog)
    assert message in line
    assert str(cache.parents[2]) in line
    assert "\n" not in line


def test_library_of_another_user_is_not_loaded(cache: Path) -> None:
    """Anybody can give a library the right name, which contains only the hash of its content."""
    _shared(cache)
    assert library.available(SMALL)
    (kernel,) = files.cache_directory().glob("kernel_*")
    kernel.rename(cache / kernel.name)
    library._library.cache_clear()
    assert Path(library.loaded(SMALL)._name).parent == kernel.parent != cache


@pytest.mark.parametrize("mode", [0o700, 0o755])
def test_private_cache_is_used_and_closed_to_others(cache: Path, caplog: pytest.LogCaptureFixture, mode: int) -> None:
    cache.mkdir()
    cache.chmod(mode)
    cache.parent.chmod(0o1777)  # like /tmp: only the owner may replace a folder in it
    assert files.cache_directory() == cache
    assert cache.stat().st_mode & 0o777 == 0o700
    assert not _warnings(caplog)


def test_without_a_safe_folder_python_computes_with_one_warning(cache: Path, caplog: pytest.LogCaptureFixture,
                                                                monkeypatch: pytest.MonkeyPatch) -> None:
    _shared(cache)
    _shared(cache.parents[2] / "temporary" / f"emcas-{os.getuid()}")
    monkeypatch.setattr(library, "worth", lambda *_: True)
    values = load_parameters(model=SMALL).values
    for _ in range(2):
        assert simulate(values, 0.01, model=SMALL)["fin_angle"].size == 11
    (line,) = _warnings(caplog)
    assert line.startswith("no compiled kernel, Python is used instead: ")
    assert "others may write to it" in line


def _full(*_: object, **__: object) -> Any:
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def test_full_disk_gives_one_warning_and_another_folder(cache: Path, caplog: pytest.LogCaptureFixture,
                                                        monkeypatch: pytest.MonkeyPatch) -> None:
    make = tempfile.TemporaryFile

    def on_a_full_disk(dir: Path) -> Any:
        file = make(dir=dir)
        if dir == cache:
            monkeypatch.setattr(file, "write", _full, raising=False)
        return file

    monkeypatch.setattr(tempfile, "TemporaryFile", on_a_full_disk)
    values = load_parameters(model=SMALL).values
    for _ in range(2):
        simulate(values, 0.01, kernel="compiled", model=SMALL)
        library._library.cache_clear()
    (line,) = _warnings(caplog)
    assert line.startswith(f"{cache}: cannot be written: the disk is full; free some space or choose ")


def test_disk_that_fills_up_stops_at_the_first_compiler(cache: Path, caplog: pytest.LogCaptureFixture,
                                                        monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "fsync", _full)
    tried = []

    def compiled(self: compiler.Compiler, *_: object) -> bytes:
        tried.append(self)
        return b"library"

    monkeypatch.setattr(compiler.Compiler, "library", compiled)
    assert not library.available(SMALL)
    assert not library.available(SMALL)
    assert len(tried) == 1
    (line,) = _warnings(caplog)
    assert line.startswith(f"no compiled kernel, Python is used instead: {cache}{os.sep}kernel_{SMALL}_")
    assert line.endswith(": cannot be written: the disk is full; free some space or choose another path")
    assert not list(cache.iterdir())  # no part of a library


def _compile(folder: Path, script: str) -> None:
    """Compile for this machine with a shell script as compiler."""
    program, local = folder / "cc", compiler.local_platform()
    program.write_text(f'#!/bin/sh\ncase "$*" in *--version*) echo 1.0; exit 0;; esac\n{script}\n')
    program.chmod(0o755)
    assert local is not None
    compiler.system(str(program)).library({"x.c": ""}, "x.c", local, "x")


def test_compiler_messages_about_a_full_disk_become_one_line(cache: Path) -> None:
    """Zig prints a line for each of 700 files before it stops."""
    text = "for k in 1 2 3; do echo warning: not kept: NoSpaceLeft >&2; done; echo error: failed >&2; exit 1"
    with pytest.raises(compiler.CompilerError) as raised:
        _compile(cache.parent, text)
    assert str(raised.value).count("\n") == 0
    assert "the disk is full; free some space in " in str(raised.value)


@pytest.mark.parametrize("script", [
    "true", 'while [ $# -gt 0 ]; do [ "$1" = -o ] && : > "$2"; shift; done',
    'while [ $# -gt 0 ]; do [ "$1" = -o ] && printf garbage > "$2"; shift; done'], ids=["none", "empty", "garbage"])
def test_library_that_cannot_be_loaded_is_refused(cache: Path, script: str) -> None:
    with pytest.raises(compiler.CompilerError, match="made no library that this machine can load"):
        _compile(cache.parent, script)
