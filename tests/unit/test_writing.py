"""Files are written completely or not at all, also after errors and interrupts, and only by `support/writing.py`."""

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
posix = pytest.mark.skipif(os.name != "posix", reason="needs a POSIX system")
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
    """Return the names in the current folder, including hidden ones."""
    return sorted(path.name for path in Path().iterdir())


def full(*_: object) -> None:
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def test_file_is_written_and_replaced() -> None:
    for text in ("old\n", "new °\r\n"):
        assert writing.write("x.txt", text) == len(text.encode())
        assert Path("x.txt").read_bytes() == text.encode()
    assert names() == ["x.txt"]


def test_old_file_remains_until_the_new_one_is_complete(monkeypatch: pytest.MonkeyPatch) -> None:
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
def test_permissions_are_those_of_a_plain_open() -> None:
    Path("plain").write_text("x")
    writing.write("new", "x")
    assert stat.S_IMODE(Path("new").stat().st_mode) == stat.S_IMODE(Path("plain").stat().st_mode) == 0o640
    Path("plain").chmod(0o604)
    writing.write("plain", "y")
    assert stat.S_IMODE(Path("plain").stat().st_mode) == 0o604


@posix
def test_file_behind_a_link_is_written() -> None:
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
def test_pipe_is_written() -> None:
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
def test_full_device_is_reported() -> None:
    with pytest.raises(EmcasError, match=r"^/dev/full: cannot be written: the disk is full"):
        writing.write("/dev/full", "x")
    with pytest.raises(EmcasError, match=r"^/dev/full: cannot be written: the disk is full"):
        writing.append(Path("/dev/full"), "x")
    assert stat.S_ISCHR(Path("/dev/full").stat().st_mode)


@pytest.mark.parametrize(("path", "message"), [
    ("none/x", "there is no such file or folder; make its folder first"), ("sub", "it is a folder; choose a file"),
    ("file/x", "a part of its path is a file, not a folder"), ("x" * 300, "the name is too long; choose a shorter")])
def test_refusal_names_file_and_remedy(path: str, message: str) -> None:
    Path("sub").mkdir()
    Path("file").touch()
    for write in (lambda: writing.write(path, "x"), lambda: writing.try_file(Path(path))):
        with pytest.raises(EmcasError) as refused:
            write()
        assert str(refused.value).startswith(f"{path}: cannot be written: {message}")
    assert names() == ["file", "sub"]


def test_name_may_be_as_long_as_the_system_allows() -> None:
    writing.write("x" * 255, "long")
    assert names() == ["x" * 255]


def test_write_protected_file_is_not_replaced(monkeypatch: pytest.MonkeyPatch) -> None:
    """Renaming would need only the folder's permission. The error is simulated, since root may write everything."""
    Path("x").write_text("old")
    original = os.open

    def denied(path: Path, flags: int, *more: int) -> int:
        if Path(path).name == "x":
            raise PermissionError(errno.EACCES, "Permission denied")
        return original(path, flags, *more)

    monkeypatch.setattr(os, "open", denied)
    with pytest.raises(EmcasError, match=r"^x: cannot be written: permission denied; choose"):
        writing.write("x", "new")
    assert Path("x").read_text() == "old"


def test_testing_a_path_changes_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
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


def test_files_of_a_folder_are_written_all_or_none(monkeypatch: pytest.MonkeyPatch) -> None:
    folder = Path("a/b")
    assert writing.write_folder(folder, {"one": "1", "two": b"2"}) == [folder / "one", folder / "two"]
    (folder / "three").mkdir()
    with pytest.raises(EmcasError, match="three: cannot be written: it is a folder"):
        writing.write_folder(folder, {"one": "new", "three": "new"})
    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(EmcasError, match="one: cannot be written: the disk is full"):
        writing.write_folder(folder, {"one": "new", "two": "new"})
    assert {path.name: path.read_text() for path in folder.iterdir() if path.is_file()} == {"one": "1", "two": "2"}


def test_ctrl_c_waits_until_all_files_are_replaced(monkeypatch: pytest.MonkeyPatch) -> None:
    move = writing._Beside.move

    def interrupted(file: writing._Beside) -> None:
        signal.raise_signal(signal.SIGINT)
        move(file)

    monkeypatch.setattr(writing._Beside, "move", interrupted)
    with pytest.raises(KeyboardInterrupt):
        writing.write_folder(Path("a"), {"one": "1", "two": "2"})
    assert sorted(path.name for path in Path("a").iterdir()) == ["one", "two"]
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_ctrl_c_before_replacing_keeps_the_old_files(monkeypatch: pytest.MonkeyPatch) -> None:
    writing.write_folder(Path("a"), {"one": "1", "two": "2"})
    monkeypatch.setattr(writing._Beside, "finish", lambda _: signal.raise_signal(signal.SIGINT))
    with pytest.raises(KeyboardInterrupt):
        writing.write_folder(Path("a"), {"one": "new", "two": "new"})
    assert {path.name: path.read_text() for path in Path("a").iterdir()} == {"one": "1", "two": "2"}


def test_failed_append_changes_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    journal = Path("journal")
    writing.append(journal, "one\n")
    writing.append(journal, "two\n")
    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(EmcasError, match="journal: cannot be written: the disk is full"):
        writing.append(journal, "three\n")
    assert journal.read_text() == "one\ntwo\n"


def run(code: str, shell: str = "{}") -> subprocess.CompletedProcess[str]:
    """Run Python code in a shell command, in which `{}` stands for Python with this code."""
    Path("code.py").write_text(f"from emcas_fmu.support.writing import write\n{code}\n")
    return subprocess.run(["sh", "-c", shell.format(f"'{sys.executable}' code.py")], capture_output=True, text=True,
                          timeout=100, check=False)


@posix
def test_limit_of_file_size_keeps_the_old_file() -> None:
    Path("x").write_text("old")
    done = run("write('x', 'y' * 100_000)", "ulimit -f 20; {}")  # blocks of 512 or 1024 bytes
    assert "x: cannot be written: it would exceed the largest size of a file; choose another path" in done.stderr
    assert Path("x").read_text() == "old"
    assert names() == ["code.py", "x"]


@linux
def test_standard_output_may_be_redirected() -> None:
    done = run("print('before'); write('/dev/stdout', 'text\\n'); print('after')", "{} > out.txt")
    assert done.stderr == ""
    assert Path("out.txt").read_text() == "before\ntext\nafter\n"
    assert run("write('/dev/stdout', 'text')", "{} | cat").stdout == "text"


WRITERS = {"write_text", "write_bytes", "savefig", "savetxt", "savez", "savez_compressed", "to_csv", "to_json",
           "to_parquet", "to_excel", "tofile", "write_table", "NamedTemporaryFile", "TemporaryFile", "mkstemp",
           "rename", "imsave", "dump", "symlink_to", "hardlink_to", "fdopen"}
ALLOWED = {
    ("support/writing.py", "TemporaryFile"): "tries a folder", ("support/writing.py", "fdopen"): "standard output",
    ("support/writing.py", "open"): "the only place that opens files for writing",
    ("support/files.py", "TemporaryFile"): "tries a folder of the cache",
    ("runtime/compiler.py", "write_text"): "sources in a temporary folder of the compiler's",
    ("plotting/plots.py", "savefig"): "to a string, and to a file of `whole`",
    ("bench/writers.py", "savetxt"): "to a file of `whole`", ("reference/files.py", "savetxt"): "to memory",
    ("studies/campaign/store.py", "write_table"): "to memory",
    ("commands/group.py", "open"): "/dev/null, in place of a standard output that cannot be written",
}


def writes(call: ast.Call) -> str:
    """Return the name of the function if a call may write a file, or an empty text."""
    name = call.func.attr if isinstance(call.func, ast.Attribute) else getattr(call.func, "id", "")
    owner = getattr(getattr(call.func, "value", None), "id", "")
    arguments = [*call.args, *(keyword.value for keyword in call.keywords)]
    texts = [each.value for each in arguments if isinstance(each, ast.Constant) and isinstance(each.value, str)]
    if name == "open":  # of builtins, Path or os; a text of only these letters is a mode
        modes = [text for text in texts if set(text) <= set("rwxabt+")]
        return name if owner == "os" or set("".join(modes)) & set("wxa+") else ""
    if name == "ZipFile":
        first = call.args[0].id if call.args and isinstance(call.args[0], ast.Name) else ""
        return name if {"w", "x", "a"} & set(texts) and first != "file" else ""
    return name if name in WRITERS or (owner == "shutil" and name not in ("which", "disk_usage", "rmtree")) else ""


def test_no_other_module_writes_files() -> None:
    writers = {(path.relative_to(PACKAGE).as_posix(), name)
               for path in PACKAGE.rglob("*.py")
               for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
               if isinstance(node, ast.Call) and (name := writes(node))}
    assert writers == set(ALLOWED)


@pytest.mark.parametrize(("code", "name"), [
    ("path.open('w', encoding='utf-8')", "open"), ("open(path, mode='a')", "open"), ("path.open('xb')", "open"),
    ("os.open(path, os.O_WRONLY)", "open"), ("path.open(encoding='utf-8')", ""), ("open(path)", ""),
    ("figure.savefig(path)", "savefig"), ("zipfile.ZipFile(path, 'w')", "ZipFile"), ("zipfile.ZipFile(path)", ""),
    ("path.write_text(text)", "write_text"), ("values.copy()", ""), ("batch.move(a)", ""),
    ("shutil.copy(a, b)", "copy")])
def test_calls_that_write_are_found(code: str, name: str) -> None:
    (call,) = [node for node in ast.walk(ast.parse(code)) if isinstance(node, ast.Call)]
    assert writes(call) == name
