"""C compilers: zig, from the package ziglang, for every platform, or a system compiler for this one."""

from __future__ import annotations

import importlib.util
import os
import platform
import re
import shlex
import shutil
import struct
import subprocess
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory, gettempdir
from typing import Any

from ..errors import EmcasError
from ..support.files import cache_directory

# No contraction: a fused multiply-add rounds once where the Python source rounds twice. No speculative operation that
# may raise a floating-point exception: hosts may trap these. No reading of two numbers at once that were written one by
# one: the processor would wait until both are in the cache.
FLAGS = ("-std=c11", "-pedantic", "-Wall", "-Wextra", "-Werror", "-O2", "-ffp-contract=off", "-ftrapping-math",
         "-fno-math-errno", "-fno-tree-slp-vectorize", "-fomit-frame-pointer", "-fvisibility=hidden", "-g0")
_ZIG_FLAGS = ("-fno-sanitize=undefined", "-ffp-exception-behavior=maytrap", "-s")
# Longest time [s] of a compilation. The first one by zig also builds its C library, in a minute on a slow machine.
_PATIENCE = 600
_NO_SPACE = re.compile("No space left|NoSpaceLeft|disk quota", re.IGNORECASE)
_PAGE = 14  # Pages of Apple's processors have 2 to the power of this number of bytes.
_MACHINES = {"amd64": "x86_64", "arm64": "aarch64"}


class CompilerError(EmcasError):
    """There is no compiler, or it failed; the message says what to do."""


@dataclass(frozen=True)
class Platform:
    """A platform: its folder in an FMI 2.0 FMU, the suffix of its libraries, and the flags for linking.

    In `link`, {} is the library's file name. `targets` maps FMI 3.0's platform tuple of each machine to zig's name.
    """

    name: str
    suffix: str
    targets: Mapping[str, str]
    link: tuple[str, ...]


_LINUX = ("-shared", "-fPIC", "-Wl,--build-id=none", "-lm")
# Names are those of FMI 2.0's folders; it has none for Linux on arm64.
PLATFORMS = {p.name: p for p in (
    Platform("linux64", ".so", {"x86_64-linux": "x86_64-linux-gnu.2.17"}, _LINUX),
    Platform("win64", ".dll", {"x86_64-windows": "x86_64-windows-gnu"}, ("-shared",)),
    Platform("darwin64", ".dylib", {"x86_64-darwin": "x86_64-macos.11.0", "aarch64-darwin": "aarch64-macos.11.0"},
             ("-dynamiclib", "-Wl,-install_name,@rpath/{}")),
    Platform("aarch64-linux", ".so", {"aarch64-linux": "aarch64-linux-gnu.2.17"}, _LINUX),
)}

# For a browser, which has no floating-point traps; without the first flag clang would warn about this. The C library
# musl needs no function of the page.
WEB = Platform("wasm", ".wasm", {"wasm32-wasi": "wasm32-wasi"}, (
    "-Wno-unsupported-floating-point-opt", "-mexec-model=reactor", "-Wl,--export-dynamic", "-Wl,--export=__heap_base"))


def _local_tuple() -> str:
    """Return FMI 3.0's platform tuple of this machine."""
    machine = platform.machine().lower()
    return f"{_MACHINES.get(machine, machine)}-{platform.system().lower()}"


def local_platform() -> Platform | None:
    """Return the platform of this machine; None if it is unknown."""
    return next((p for p in PLATFORMS.values() if _local_tuple() in p.targets), None)


def universal(libraries: Sequence[bytes]) -> bytes:
    """Return one Mach-O file of libraries for several machines; a single library is returned unchanged.

    Each library is contained whole, so that its signature stays valid. The layout is that of Apple's mach-o/fat.h:
    big-endian magic and count, then for each library its CPU type and subtype (as in its header), offset, size and
    alignment as a power of two.
    """
    if len(libraries) == 1:
        return libraries[0]
    page, entries, body = 1 << _PAGE, b"", b""
    for library in libraries:
        body += bytes(-len(body) % page)
        machine = struct.unpack_from("<2I", library, 4)
        entries += struct.pack(">5I", *machine, page + len(body), len(library), _PAGE)
        body += library
    return (struct.pack(">2I", 0xCAFEBABE, len(libraries)) + entries).ljust(page, b"\0") + body


@dataclass(frozen=True)
class Compiler:
    """A command that compiles C, its version, and whether it is zig."""

    command: tuple[str, ...]
    version: str
    zig: bool

    def library(self, sources: Mapping[str, str], main: str, target: Platform, name: str,
                flags: Sequence[str] = ()) -> bytes:
        """Return the shared library `name` of a platform, for all its machines in one file; see :meth:`libraries`."""
        return universal(list(self.libraries(sources, main, target, name, flags).values()))

    def libraries(self, sources: Mapping[str, str], main: str, target: Platform, name: str,
                  flags: Sequence[str] = ()) -> dict[str, bytes]:
        """Return the shared library `name` for each machine of a platform, by FMI 3.0's platform tuple.

        `sources` maps file names to text: the source file `main` and its headers. A system compiler builds for this
        machine only. `flags` follow FLAGS. A compiler makes the same bytes from the same sources. Raises CompilerError
        with the compiler's message.
        """
        machines = target.targets if self.zig else {_local_tuple(): ""}
        with TemporaryDirectory(prefix="emcas_cc_") as temporary:
            folder = Path(temporary)
            for file, text in sources.items():
                (folder / file).write_text(text, encoding="utf-8", newline="\n")
            return {machine: self._library(folder, main, target, name, triple, flags)
                    for machine, triple in machines.items()}

    def _library(self, folder: Path, main: str, target: Platform, name: str, triple: str,
                 further: Sequence[str]) -> bytes:
        output = f"{name}{target.suffix}"
        flags = [*FLAGS, *further, *(("-target", triple, *_ZIG_FLAGS) if self.zig else ("-s",))]
        command = [*self.command, *flags, main, "-o", output, *(f.format(output) for f in target.link)]
        # If its default cache, in the home folder, cannot be written, zig waits for ever.
        environment = {**os.environ, "ZIG_GLOBAL_CACHE_DIR": str(_cache_folder(folder) / "zig"),
                       "ZIG_LOCAL_CACHE_DIR": str(folder / "z"),
                       "SOURCE_DATE_EPOCH": "315532800", "ZERO_AR_DATE": "1"}
        done = _run(command, cwd=folder, env=environment)
        if done.returncode != 0:
            raise CompilerError(f"{' '.join(self.command)} cannot compile {main} for {triple or target.name}: "
                                f"{_reason(done.stderr or done.stdout)}")
        if not self.zig:  # zig also builds for other machines
            self._require_loadable(folder / output)
        return (folder / output).read_bytes()

    def _require_loadable(self, library: Path) -> None:
        """Raise CompilerError if a library cannot be loaded on this machine; it is loaded in another process."""
        loading = [sys.executable, "-I", "-S", "-c", "import ctypes, sys; ctypes.CDLL(sys.argv[1])", str(library)]
        done = _run(loading)
        if done.returncode != 0:
            why = "it wrote no file" if not library.is_file() else _reason(done.stderr).rpartition(": ")[2]
            raise CompilerError(f"{' '.join(self.command)} made no library that this machine can load ({why}); choose "
                                "another compiler, or install zig:  pip install 'emcas-fmu[native]'")


def _run(command: Sequence[str], **options: Any) -> subprocess.CompletedProcess[str]:
    """Run a command and return its output as text. Raises CompilerError if it does not finish."""
    try:
        return subprocess.run(command, capture_output=True, text=True, check=False, timeout=_PATIENCE, **options)
    except subprocess.TimeoutExpired as error:
        raise CompilerError(f"{' '.join(command)}: not finished within {_PATIENCE} s") from error


def _cache_folder(otherwise: Path) -> Path:
    """Return the folder of compiled libraries; `otherwise` if that folder cannot be used."""
    try:
        return cache_directory()
    except OSError:
        return otherwise


def _reason(output: str) -> str:
    """Return the line of a compiler's output with the reason for its failure, or the remedy for a full disk."""
    if _NO_SPACE.search(output):
        return (f"the disk is full; free some space in {_cache_folder(Path(gettempdir()))} and {gettempdir()}, or set "
                "TMPDIR to another folder")
    lines = [line.strip() for line in output.splitlines() if line.strip()]
    return next((line for line in lines if "error" in line and "warning" not in line), lines[-1] if lines else "")


@cache
def zig() -> Compiler | None:
    """Return the compiler of the package ziglang; None if it is not installed or does not run."""
    if importlib.util.find_spec("ziglang") is None:
        return None
    command = (sys.executable, "-m", "ziglang", "cc")
    done = _run([*command[:-1], "version"])
    return Compiler(command, f"zig {done.stdout.strip()}", True) if done.returncode == 0 else None


@cache
def system(name: str) -> Compiler:
    """Return a system compiler by name or command line. Raises CompilerError if it does not run."""
    try:
        program, *options = shlex.split(name) or [""]
    except ValueError as error:
        raise CompilerError(f"{name}: is no command line ({error})") from error
    path = shutil.which(program)
    if path is None:
        raise CompilerError(f"{name}: there is no such program")
    done = _run([path, "--version"])
    if done.returncode != 0:
        raise CompilerError(f"{name}: does not answer to --version, so it is not a known C compiler")
    return Compiler((path, *options), done.stdout.splitlines()[0] if done.stdout else name, False)


def find(cc: str | None = None) -> Compiler:
    """Return the system compiler `cc`, or zig by default. Raises CompilerError if there is none."""
    if cc is not None:
        try:
            return system(cc)
        except CompilerError as error:
            raise CompilerError(f"cc {error}") from error
    compiler = zig()
    if compiler is None:
        raise CompilerError("no C compiler for native FMUs: install one with  pip install 'emcas-fmu[native]'  "
                            "or name a system compiler as cc (this platform only)")
    return compiler


def local_compilers() -> Iterator[Compiler]:
    """Yield the compilers that run and build for this machine: $CC, then zig, cc, gcc, clang."""
    chosen = os.environ.get("CC")
    yield from _working([chosen] if chosen else [])
    if compiler := zig():
        yield compiler
    yield from _working(["cc", "gcc", "clang"])


def _working(names: Iterable[str]) -> Iterator[Compiler]:
    for name in names:
        try:
            yield system(name)
        except (CompilerError, OSError, ValueError):
            continue
