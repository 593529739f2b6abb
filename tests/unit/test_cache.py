"""The folder that what is compiled is kept in, and loaded from: the user's alone, or not used."""

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
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture) -> Iterator[Path]:
    """The user's cache, which is not there yet, two folders deep; the temporary folder is beside it."""
    (tmp_path / "temporary").mkdir()
    folder = tmp_path / "home" / "cache" / "emcas"
    folder.parent.mkdir(parents=True)
    with_zig_s_own = files.cache_directory()  # which takes a minute to make
    monkeypatch.setattr(compiler, "cache_directory", lambda: with_zig_s_own)
    monkeypatch.setattr(files, "user_cache_path", lambda _: folder)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "temporary"))
    caplog.set_level(logging.WARNING, LOG.name)  # a command that ran in this process has it announce compiling, too
    for cached in (files.cache_directory, library._library):
        cached.cache_clear()
    yield folder
    monkeypatch.undo()
    for cached in (files.cache_directory, library._library):
        cached.cache_clear()


def _said(caplog: pytest.LogCaptureFixture) -> list[str]:
    """Return the warnings; that something is compiled is announced, too, once a command has run."""
    return [record.getMessage() for record in caplog.records if record.levelno >= logging.WARNING]


def _shared(folder: Path) -> None:
    folder.mkdir()
    folder.chmod(0o777)


def _others(folder: Path) -> None:
    if os.getuid() != 0:
        pytest.skip("only root gives folders away")
    folder.mkdir()
    os.chown(folder, 12345, -1)


def _in_another_s(folder: Path) -> None:
    if os.getuid() != 0:
        pytest.skip("only root gives folders away")
    os.chown(folder.parent, 12345, -1)


def _linked(folder: Path) -> None:
    """A link to what anybody may write to."""
    _shared(folder.parents[2] / "elsewhere")
    folder.symlink_to(folder.parents[2] / "elsewhere")


@pytest.mark.parametrize(("spoil", "said"), [
    (_shared, "others may write to it (mode 0777)"), (_others, "it belongs to another user"), (_linked, "mode 0777"),
    (lambda folder: folder.parent.chmod(0o777), "anybody may replace it, since"),
    (lambda folder: folder.parents[1].chmod(0o777), "anybody may replace it, since"),
    (_in_another_s, "belongs to another user"), (lambda folder: folder.touch(), "cannot be written"),
], ids=["shared", "another's", "link", "in a shared one", "far in a shared one", "in another's", "a file"])
def test_a_cache_that_others_may_change_is_not_used_and_that_is_said_once(
        place: Path, caplog: pytest.LogCaptureFixture, spoil: Callable[[Path], None], said: str) -> None:
    spoil(place)
    for _ in range(3):
        assert files.cache_directory() == place.parents[2] / "temporary" / f"emcas-{os.getuid()}"
    (line,) = _said(caplog)
    assert said in line
    assert str(place.parents[2]) in line
    assert "\n" not in line


def test_a_library_that_somebody_put_there_is_not_loaded(place: Path) -> None:
    """Whoever writes it can give it the name that it must have, with the hash of what is in it."""
    _shared(place)
    assert library.available(SMALL)
    (kept,) = files.cache_directory().glob("kernel_*")
    kept.rename(place / kept.name)
    library._library.cache_clear()
    assert Path(library.loaded(SMALL)._name).parent == kept.parent != place


@pytest.mark.parametrize("mode", [0o700, 0o755])
def test_the_user_s_own_cache_is_used_and_closed_to_others(place: Path, caplog: pytest.LogCaptureFixture,
                                                           mode: int) -> None:
    place.mkdir()
    place.chmod(mode)
    place.parent.chmod(0o1777)  # as /tmp: nobody but the owner may replace what is in it
    assert files.cache_directory() == place
    assert place.stat().st_mode & 0o777 == 0o700
    assert not _said(caplog)


def test_without_a_folder_python_computes_and_says_so_once(place: Path, caplog: pytest.LogCaptureFixture,
                                                          monkeypatch: pytest.MonkeyPatch) -> None:
    _shared(place)
    _shared(place.parents[2] / "temporary" / f"emcas-{os.getuid()}")
    monkeypatch.setattr(library, "worth", lambda *_: True)
    values = load_parameters(model=SMALL).values
    for _ in range(2):
        assert simulate(values, 0.01, model=SMALL)["fin_angle"].size == 11
    (line,) = _said(caplog)
    assert line.startswith("no compiled kernel, Python is used instead: ")
    assert "others may write to it" in line


def _full(*_: object, **__: object) -> Any:
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def test_a_full_disk_is_said_once_and_another_folder_used(place: Path, caplog: pytest.LogCaptureFixture,
                                                         monkeypatch: pytest.MonkeyPatch) -> None:
    make = tempfile.TemporaryFile

    def on_a_full_disk(dir: Path) -> Any:
        made = make(dir=dir)
        if dir == place:
            monkeypatch.setattr(made, "write", _full, raising=False)
        return made

    monkeypatch.setattr(tempfile, "TemporaryFile", on_a_full_disk)
    values = load_parameters(model=SMALL).values
    for _ in range(2):
        simulate(values, 0.01, kernel="compiled", model=SMALL)
        library._library.cache_clear()
    (line,) = _said(caplog)
    assert line.startswith(f"{place}: cannot be written: the disk is full; free some space or choose ")


def test_a_disk_that_fills_up_is_said_once_by_the_first_compiler(place: Path, caplog: pytest.LogCaptureFixture,
                                                                monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "fsync", _full)
    tried = []

    def made(self: compiler.Compiler, *_: object) -> bytes:
        tried.append(self)
        return b"library"

    monkeypatch.setattr(compiler.Compiler, "library", made)
    assert not library.available(SMALL)
    assert not library.available(SMALL)
    assert len(tried) == 1
    (line,) = _said(caplog)
    assert line.startswith(f"no compiled kernel, Python is used instead: {place}{os.sep}kernel_{SMALL}_")
    assert line.endswith(": cannot be written: the disk is full; free some space or choose another path")
    assert not list(place.iterdir())  # no half of a library


def _script(folder: Path, does: str) -> str:
    program = folder / "cc"
    program.write_text(f'#!/bin/sh\ncase "$*" in *--version*) echo 1.0; exit 0;; esac\n{does}\n')
    program.chmod(0o755)
    return str(program)


def test_what_a_compiler_says_of_a_full_disk_is_one_line(place: Path) -> None:
    """Zig says for each of 700 files that it is not kept, before it gives up."""
    text = "for k in 1 2 3; do echo warning: not kept: NoSpaceLeft >&2; done; echo error: failed >&2; exit 1"
    made = compiler.system(_script(place.parent, text))
    local = compiler.local_platform()
    assert local is not None
    with pytest.raises(compiler.CompilerError) as raised:
        made.library({"x.c": ""}, "x.c", local, "x")
    assert str(raised.value).count("\n") == 0
    assert "the disk is full; free some space in " in str(raised.value)


@pytest.mark.parametrize("does", [
    "true", 'while [ $# -gt 0 ]; do [ "$1" = -o ] && : > "$2"; shift; done',
    'while [ $# -gt 0 ]; do [ "$1" = -o ] && printf garbage > "$2"; shift; done'], ids=["none", "empty", "garbage"])
def test_a_library_that_cannot_be_loaded_is_refused(place: Path, does: str) -> None:
    made, local = compiler.system(_script(place.parent, does)), compiler.local_platform()
    assert local is not None
    with pytest.raises(compiler.CompilerError, match="made no library that this machine can load"):
        made.library({"x.c": ""}, "x.c", local, "x")
