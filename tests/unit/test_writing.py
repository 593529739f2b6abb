"""A file is written whole or not at all, wherever it is, whoever stops it."""

from __future__ import annotations

import ast
import errno
import os
import signal
import stat
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import pytest

import emcas_fmu
from emcas_fmu.errors import EmcasError
from emcas_fmu.support import writing

PACKAGE = Path(emcas_fmu.__file__).parent
posix = pytest.mark.skipif(os.name != "posix", reason="of POSIX systems")
linux = pytest.mark.skipif(sys.platform != "linux", reason="needs /dev/full")


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def umask() -> Iterator[None]:
    before = os.umask(0o027)
    yield
    os.umask(before)


def names() -> list[str]:
    """Return what is in the present folder, hidden or not."""
    return sorted(path.name for path in Path().iterdir())


def full(*_: object) -> None:
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


# One file -------------------------------------------------------------------------------------------------


def test_a_file_is_written_and_replaced() -> None:
    for text in ("old\n", "new °\r\n"):
        assert writing.write("x.txt", text) == len(text.encode())
        assert Path("x.txt").read_bytes() == text.encode()
    assert names() == ["x.txt"]


def test_what_is_there_stays_until_all_of_it_is_on_the_disk(monkeypatch: pytest.MonkeyPatch) -> None:
    Path("x.txt").write_text("old")
    with suppress(ValueError), writing.whole("x.txt") as file:
        file.write(b"half")
        file.flush()
        assert Path("x.txt").read_text() == "old"
        raise ValueError
    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(EmcasError, match=r"^x\.txt: cannot be written: the disk is full; free some space or"):
        writing.write("x.txt", "new")
    with pytest.raises(EmcasError, match="the disk is full"):
        writing.write("y.txt", "new")
    assert names() == ["x.txt"]
    assert Path("x.txt").read_text() == "old"


@posix
@pytest.mark.usefixtures("umask")
def test_rights_are_those_of_a_plain_open() -> None:
    Path("plain").write_text("x")
    writing.write("new", "x")
    assert stat.S_IMODE(Path("new").stat().st_mode) == stat.S_IMODE(Path("plain").stat().st_mode) == 0o640
    Path("plain").chmod(0o604)
    writing.write("plain", "y")
    assert stat.S_IMODE(Path("plain").stat().st_mode) == 0o604


@posix
def test_a_link_stays_a_link() -> None:
    Path("sub").mkdir()
    Path("sub/real").write_text("old")
    Path("link").symlink_to("sub/real")
    Path("dangling").symlink_to("sub/later")
    for link in ("link", "dangling"):
        writing.write(link, "new")
        assert Path(link).is_symlink()
        assert Path(link).read_text() == "new"
    assert sorted(path.name for path in Path("sub").iterdir()) == ["later", "real"]
    Path("loop").symlink_to("loop")
    with pytest.raises(EmcasError, match="loop: cannot be written"):
        writing.write("loop", "new")
    assert Path("loop").is_symlink()


@posix
def test_a_pipe_is_written_to() -> None:
    os.mkfifo("pipe")
    read: list[bytes] = []
    reader = threading.Thread(target=lambda: read.append(Path("pipe").read_bytes()))
    reader.start()
    writing.write("pipe", "through")
    reader.join(10.0)
    assert read == [b"through"]
    assert stat.S_ISFIFO(Path("pipe").stat().st_mode)
    writing.write(os.devnull, "gone")


@linux
def test_devices_that_are_full_are_said() -> None:
    with pytest.raises(EmcasError, match=r"^/dev/full: cannot be written: the disk is full"):
        writing.write("/dev/full", "x")
    with pytest.raises(EmcasError, match=r"^/dev/full: cannot be written: the disk is full"):
        writing.append(Path("/dev/full"), "x")
    assert stat.S_ISCHR(Path("/dev/full").stat().st_mode)


@pytest.mark.parametrize(("path", "said"), [
    ("none/x", "there is no such file or folder; make its folder first"), ("sub", "it is a folder; choose a file"),
    ("file/x", "a part of its path is a file, not a folder"), ("x" * 300, "the name is too long; choose a shorter")])
def test_refusals_name_file_and_remedy(path: str, said: str) -> None:
    Path("sub").mkdir()
    Path("file").touch()
    for write in (lambda: writing.write(path, "x"), lambda: writing.try_file(Path(path))):
        with pytest.raises(EmcasError) as refused:
            write()
        assert str(refused.value).startswith(f"{path}: cannot be written: {said}")
    assert names() == ["file", "sub"]


def test_a_name_may_be_as_long_as_the_system_allows() -> None:
    writing.write("x" * 255, "long")
    assert names() == ["x" * 255]


def test_a_file_that_may_not_be_written_is_not_replaced(monkeypatch: pytest.MonkeyPatch) -> None:
    """Renaming asks for the rights of the folder alone; who runs this may be somebody who may write everything."""
    Path("x").write_text("old")
    given = os.open

    def denied(path: Path, flags: int, *more: int) -> int:
        if Path(path).name == "x":
            raise PermissionError(errno.EACCES, "Permission denied")
        return given(path, flags, *more)

    monkeypatch.setattr(os, "open", denied)
    with pytest.raises(EmcasError, match=r"^x: cannot be written: permission denied; choose"):
        writing.write("x", "new")
    assert Path("x").read_text() == "old"


def test_trying_leaves_everything_as_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    Path("x").write_text("old")
    before = Path("x").stat().st_mtime_ns
    for path in ("x", "y"):
        writing.try_file(Path(path))
    writing.try_folder(Path())
    assert names() == ["x"]
    assert Path("x").stat().st_mtime_ns == before
    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(EmcasError, match="the disk is full"):
        writing.try_file(Path("x"))
    with pytest.raises(EmcasError, match="the disk is full"):
        writing.try_folder(Path())
    assert names() == ["x"]


# Files that belong together, and those that grow ----------------------------------------------------------


def test_files_that_belong_together_are_written_all_or_none(monkeypatch: pytest.MonkeyPatch) -> None:
    folder = Path("a/b")
    assert writing.write_folder(folder, {"one": "1", "two": b"2"}) == [folder / "one", folder / "two"]
    (folder / "three").mkdir()
    with pytest.raises(EmcasError, match="three: cannot be written: it is a folder"):
        writing.write_folder(folder, {"one": "new", "three": "new"})
    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(EmcasError, match="one: cannot be written: the disk is full"):
        writing.write_folder(folder, {"one": "new", "two": "new"})
    assert {path.name: path.read_text() for path in folder.iterdir() if path.is_file()} == {"one": "1", "two": "2"}


def test_ctrl_c_waits_until_all_are_at_their_places(monkeypatch: pytest.MonkeyPatch) -> None:
    move = writing._Beside.move

    def interrupted(file: writing._Beside) -> None:
        signal.raise_signal(signal.SIGINT)
        move(file)

    monkeypatch.setattr(writing._Beside, "move", interrupted)
    with pytest.raises(KeyboardInterrupt):
        writing.write_folder(Path("a"), {"one": "1", "two": "2"})
    assert sorted(path.name for path in Path("a").iterdir()) == ["one", "two"]
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_ctrl_c_before_that_leaves_what_was_there(monkeypatch: pytest.MonkeyPatch) -> None:
    writing.write_folder(Path("a"), {"one": "1", "two": "2"})
    monkeypatch.setattr(writing._Beside, "finish", lambda _: signal.raise_signal(signal.SIGINT))
    with pytest.raises(KeyboardInterrupt):
        writing.write_folder(Path("a"), {"one": "new", "two": "new"})
    assert {path.name: path.read_text() for path in Path("a").iterdir()} == {"one": "1", "two": "2"}


def test_what_grows_is_as_it_was_where_the_rest_has_no_room(monkeypatch: pytest.MonkeyPatch) -> None:
    journal = Path("journal")
    writing.append(journal, "one\n")
    writing.append(journal, "two\n")
    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(EmcasError, match="journal: cannot be written: the disk is full"):
        writing.append(journal, "three\n")
    assert journal.read_text() == "one\ntwo\n"


# Real limits and streams, in programs of their own --------------------------------------------------------


def run(code: str, shell: str = "{}") -> subprocess.CompletedProcess[str]:
    """Run Python code, `{}` in a command of the shell."""
    Path("code.py").write_text(f"from emcas_fmu.support.writing import write\n{code}\n")
    return subprocess.run(["sh", "-c", shell.format(f"'{sys.executable}' code.py")], capture_output=True, text=True,
                          timeout=100, check=False)


@posix
def test_a_limit_of_the_system_is_met_half_way() -> None:
    Path("x").write_text("old")
    done = run("write('x', 'y' * 100_000)", "ulimit -f 20; {}")  # of 512 or 1024 bytes
    assert "x: cannot be written: it would exceed the largest size of a file; choose another path" in done.stderr
    assert Path("x").read_text() == "old"
    assert names() == ["code.py", "x"]


@linux
def test_standard_output_is_the_shells() -> None:
    done = run("print('before'); write('/dev/stdout', 'text\\n'); print('after')", "{} > out.txt")
    assert done.stderr == ""
    assert Path("out.txt").read_text() == "before\ntext\nafter\n"
    assert run("write('/dev/stdout', 'text')", "{} | cat").stdout == "text"


# Nothing else writes --------------------------------------------------------------------------------------

WRITERS = {"write_text", "write_bytes", "savefig", "savetxt", "savez", "savez_compressed", "to_csv", "to_json",
           "to_parquet", "to_excel", "tofile", "write_table", "NamedTemporaryFile", "TemporaryFile", "mkstemp",
           "rename", "imsave", "dump", "symlink_to", "hardlink_to", "fdopen"}
ALLOWED = {
    ("support/writing.py", "TemporaryFile"): "tries a folder",
    ("support/writing.py", "fdopen"): "standard output",
    ("support/writing.py", "open"): "here it is done",
    ("support/files.py", "TemporaryFile"): "tries a folder of the cache",
    ("runtime/compiler.py", "write_text"): "sources in a temporary folder of the compiler's",
    ("figures/plots.py", "savefig"): "to a string, and to a file that `whole` gives",
    ("bench/writers.py", "savetxt"): "to a file that `whole` gives",
    ("reference/files.py", "savetxt"): "to memory",
    ("studies/campaign/store.py", "write_table"): "to memory",
    ("commands/group.py", "open"): "/dev/null, in place of a standard output that cannot be written",
}


def writes(call: ast.Call) -> str:
    """Return by which name a call may write a file; empty where it does not."""
    name = call.func.attr if isinstance(call.func, ast.Attribute) else getattr(call.func, "id", "")
    of = getattr(getattr(call.func, "value", None), "id", "")
    given = [*call.args, *(keyword.value for keyword in call.keywords)]
    texts = [each.value for each in given if isinstance(each, ast.Constant) and isinstance(each.value, str)]
    if name == "open":  # of a file, of a path or of os; a mode is text that has nothing else
        modes = [text for text in texts if set(text) <= set("rwxabt+")]
        return name if of == "os" or set("".join(modes)) & set("wxa+") else ""
    if name == "ZipFile":
        first = call.args[0].id if call.args and isinstance(call.args[0], ast.Name) else ""
        return name if {"w", "x", "a"} & set(texts) and first != "file" else ""
    return name if name in WRITERS or (of == "shutil" and name not in ("which", "disk_usage", "rmtree")) else ""


def test_no_other_module_writes_files() -> None:
    found = {(path.relative_to(PACKAGE).as_posix(), name)
             for path in PACKAGE.rglob("*.py")
             for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
             if isinstance(node, ast.Call) and (name := writes(node))}
    assert found == set(ALLOWED)


@pytest.mark.parametrize(("code", "name"), [
    ("path.open('w', encoding='utf-8')", "open"), ("open(path, mode='a')", "open"), ("path.open('xb')", "open"),
    ("os.open(path, os.O_WRONLY)", "open"), ("path.open(encoding='utf-8')", ""), ("open(path)", ""),
    ("figure.savefig(path)", "savefig"), ("zipfile.ZipFile(path, 'w')", "ZipFile"), ("zipfile.ZipFile(path)", ""),
    ("path.write_text(text)", "write_text"), ("values.copy()", ""), ("batch.move(a)", ""),
    ("shutil.copy(a, b)", "copy")])
def test_the_search_finds_what_writes(code: str, name: str) -> None:
    (call,) = [node for node in ast.walk(ast.parse(code)) if isinstance(node, ast.Call)]
    assert writes(call) == name
