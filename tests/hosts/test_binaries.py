"""The FMU's libraries for every platform, read without running them: format, exports, imports, signature."""

from __future__ import annotations

import hashlib
import re
import struct
import subprocess
import tempfile
from pathlib import Path

import lief
import pytest

from emcas_fmu.runtime.compiler import PLATFORMS

from .host import FMI_HEADERS, HERE, tool

pytestmark = [pytest.mark.fmu, pytest.mark.slow]
lief.logging.disable()  # it prints messages about empty optional tables

FORMATS = {
    "x86_64-linux": (lief.ELF.Binary, lief.ELF.ARCH.X86_64),
    "aarch64-linux": (lief.ELF.Binary, lief.ELF.ARCH.AARCH64),
    "x86_64-windows": (lief.PE.Binary, lief.PE.Header.MACHINE_TYPES.AMD64),
    "x86_64-darwin": (lief.MachO.Binary, lief.MachO.Header.CPU_TYPE.X86_64),
    "aarch64-darwin": (lief.MachO.Binary, lief.MachO.Header.CPU_TYPE.ARM64),
}
LINUX = ["x86_64-linux", "aarch64-linux"]
DARWIN = ["x86_64-darwin", "aarch64-darwin"]
# The C host calls every function that FMI 2.0 requires of a co-simulation FMU.
FUNCTIONS = set(re.findall(r"X\((\w+)\)", (HERE / "fmu.h").read_text(encoding="utf-8"))) - {"name"}
# Hosts look up all functions of FMI 3.0.
FUNCTIONS_3 = set(re.findall(r"FMI3_Export\s+\w+\s+(fmi3\w+);",
                             (FMI_HEADERS / "fmi3Functions.h").read_text(encoding="utf-8")))
LINKER = {"__mh_dylib_header", "___dso_handle"}  # zig's linker adds them to every dylib
SYSTEM = re.compile(r"lib[cm]\.so\.6|kernel32\.dll|api-ms-win-crt-[a-z]+-l1-1-0\.dll|/usr/lib/libSystem\.B\.dylib",
                    re.IGNORECASE)
# Functions of C99 that compute, compare, copy, format and allocate. None opens a file, reads the clock or ends the
# process.
C = {"floor",
     "calloc", "free", "memcmp", "memcpy", "memmove", "memset", "strcmp", "strlen", "strncat", "vsnprintf"}
# Substitutes that compilers and C libraries call, and functions for loading and starting a library.
FURTHER = {
    "linux": {"bcmp"},
    "darwin": {"bzero", "__bzero", "__memcpy_chk", "__strncat_chk", "dyld_stub_binder"},
    # mingw-w64's start-up code: thread-local storage, relocation, handlers at the DLL's end; and its printf.
    "windows": {"DeleteCriticalSection", "EnterCriticalSection", "GetLastError", "InitializeCriticalSection",
                "LeaveCriticalSection", "Sleep", "TlsGetValue", "VirtualProtect", "VirtualQuery",
                "_execute_onexit_table", "_exit", "_initialize_onexit_table", "_initterm", "_initterm_e",
                "_register_onexit_function", "abort", "__acrt_iob_func", "__stdio_common_vfprintf",
                "__stdio_common_vsprintf", "fwrite"},
}
Binary = lief.ELF.Binary | lief.PE.Binary | lief.MachO.Binary


@pytest.fixture(params=sorted(FORMATS))
def machine(request: pytest.FixtureRequest) -> str:
    """A platform tuple of FMI 3.0."""
    return str(request.param)


@pytest.fixture(params=["2", "3"])
def fmi(request: pytest.FixtureRequest) -> str:
    """A version of FMI."""
    return str(request.param)


@pytest.fixture
def path(request: pytest.FixtureRequest, machine: str, fmi: str) -> Path:
    """The file with the machine's library."""
    (platform,) = [p for p in PLATFORMS.values() if machine in p.targets]
    unpacked: Path = request.getfixturevalue("every_platform" if fmi == "2" else "every_machine")
    (file,) = (unpacked / "binaries" / (platform.name if fmi == "2" else machine)).iterdir()
    assert file.name == "EMCAS" + platform.suffix
    return file


@pytest.fixture
def binary(path: Path, machine: str, fmi: str) -> Binary:
    """The machine's library; in FMI 2.0 a part of the universal library for macOS."""
    _, cpu = FORMATS[machine]
    if isinstance(cpu, lief.MachO.Header.CPU_TYPE):
        parts = lief.MachO.parse(str(path))
        assert parts is not None
        assert len(parts) == (2 if fmi == "2" else 1)
        part = parts.take(cpu)
        assert part is not None
        return part
    parsed = lief.parse(str(path))
    assert isinstance(parsed, Binary)
    return parsed


def exports(binary: Binary) -> set[str]:
    """Return exported names, without the underscore of C functions in Mach-O."""
    if isinstance(binary, lief.PE.Binary):
        table = binary.get_export()
        assert table is not None
        return {str(e.name) for e in table.entries}
    if isinstance(binary, lief.MachO.Binary):
        return {str(s.name).removeprefix("_") for s in binary.symbols if s.has_export_info and s.name not in LINKER}
    return {str(s.name) for s in binary.exported_symbols}


def imports(binary: Binary) -> set[str]:
    """Return imported names, without the underscore of C functions in Mach-O."""
    if isinstance(binary, lief.PE.Binary):
        return {str(e.name) for i in binary.imports for e in i.entries}
    underscore = "_" if isinstance(binary, lief.MachO.Binary) else ""
    return {str(s.name).removeprefix(underscore) for s in binary.imported_symbols}


def libraries(binary: Binary) -> set[str]:
    """Return the libraries on which this one depends."""
    if isinstance(binary, lief.PE.Binary):
        assert not binary.has_delay_imports
        return {str(i.name) for i in binary.imports}
    if isinstance(binary, lief.ELF.Binary):
        return {str(name) for name in binary.libraries}
    return {str(d.name) for d in binary.libraries if d.command != lief.MachO.LoadCommand.TYPE.ID_DYLIB}


def test_fmu_has_a_library_for_every_platform(every_platform: Path, every_machine: Path) -> None:
    assert {f.name for f in (every_platform / "binaries").iterdir()} == {*PLATFORMS, "aarch64-darwin"}
    assert {f.name for f in (every_machine / "binaries").iterdir()} == set(FORMATS)
    assert {machine for p in PLATFORMS.values() for machine in p.targets} == set(FORMATS)


def test_library_for_apple_silicon_is_a_part_of_the_universal_one(every_platform: Path) -> None:
    alone, universal = ((every_platform / f"binaries/{folder}/EMCAS.dylib").read_bytes()
                        for folder in ("aarch64-darwin", "darwin64"))
    assert lief.MachO.parse(list(alone)) is not None
    assert alone in universal


def test_format_and_machine(binary: Binary, machine: str) -> None:
    kind, cpu = FORMATS[machine]
    assert isinstance(binary, kind)
    if isinstance(binary, lief.ELF.Binary):
        assert (binary.header.machine_type, binary.header.file_type) == (cpu, lief.ELF.Header.FILE_TYPE.DYN)
    elif isinstance(binary, lief.PE.Binary):
        assert binary.header.machine == cpu
        assert binary.header.has_characteristic(lief.PE.Header.CHARACTERISTICS.DLL)
    else:
        assert (binary.header.cpu_type, binary.header.file_type) == (cpu, lief.MachO.Header.FILE_TYPE.DYLIB)


def test_exports_are_the_functions_of_fmi(binary: Binary, fmi: str) -> None:
    assert (len(FUNCTIONS), len(FUNCTIONS_3)) == (34, 75)
    assert exports(binary) == ({f"fmi2{name}" for name in FUNCTIONS} if fmi == "2" else FUNCTIONS_3)


def test_only_system_libraries_are_needed(binary: Binary) -> None:
    names = libraries(binary)
    assert names
    assert {name for name in names if not SYSTEM.fullmatch(name)} == set()


def test_only_functions_of_c_are_imported(binary: Binary, machine: str) -> None:
    names = imports(binary)
    assert "calloc" in names  # the import table was read
    assert names <= C | FURTHER[machine.partition("-")[2]]


def test_library_contains_no_path_of_the_build_machine(path: Path) -> None:
    content = path.read_bytes()
    for text in (f"{tempfile.gettempdir()}/", f"{Path.home()}/", str(HERE.parents[1]), "emcas_cc_"):
        assert text.encode() not in content, text


@pytest.mark.parametrize("machine", LINUX)
def test_library_needs_at_most_glibc_2_17(binary: Binary) -> None:
    assert isinstance(binary, lief.ELF.Binary)
    versions = {str(a.name) for r in binary.symbols_version_requirement for a in r.get_auxiliary_symbols()}
    numbers = [tuple(map(int, name.removeprefix("GLIBC_").split("."))) for name in versions]
    assert numbers
    assert max(numbers) <= (2, 17), versions


@pytest.mark.parametrize("machine", LINUX)
def test_stack_is_not_executable(binary: Binary) -> None:
    """A hardened kernel or a new glibc refuses to load a library that requires an executable stack."""
    assert isinstance(binary, lief.ELF.Binary)
    (stack,) = [s for s in binary.segments if s.type == lief.ELF.Segment.TYPE.GNU_STACK]
    assert not stack.has(lief.ELF.Segment.FLAGS.X)


@pytest.mark.parametrize("machine", DARWIN)
def test_macos_11_can_load_the_library(binary: Binary) -> None:
    """The minimum version is macOS 11 or earlier, and the install name is relative to the host's search path."""
    assert isinstance(binary, lief.MachO.Binary)
    version = binary.build_version
    assert version is not None
    assert version.platform == lief.MachO.BuildVersion.PLATFORMS.MACOS
    assert tuple(version.minos) <= (11, 0, 0)
    (name,) = [d.name for d in binary.libraries if d.command == lief.MachO.LoadCommand.TYPE.ID_DYLIB]
    assert name == "@rpath/EMCAS.dylib"


@pytest.mark.parametrize("machine", ["aarch64-darwin"])
def test_code_signature_has_the_hashes_of_all_pages(binary: Binary, path: Path) -> None:
    """On Apple processors the kernel kills a process that runs a page with another SHA-256 than in the signature.

    The signature is ad hoc (without a signer). Its layout follows Apple's cs_blobs.h: one blob, the code directory.
    """
    assert isinstance(binary, lief.MachO.Binary)
    whole = path.read_bytes()[binary.fat_offset:binary.fat_offset + binary.original_size]
    signature = binary.code_signature
    assert signature is not None
    blob = bytes(signature.content)
    superblob, _, count, slot, offset = struct.unpack_from(">5I", blob)
    assert (superblob, count, slot) == (0xFADE0CC0, 1, 0)
    magic, _, _, flags, hashes, _, specials, pages, limit, size, kind, _, page = struct.unpack_from(
        ">9I4B", blob, offset)
    assert (magic, flags & 2, specials, size, kind) == (0xFADE0C02, 2, 0, 32, 2)  # ad hoc; SHA-256
    assert limit == signature.data_offset  # the signature is at the end
    parts = [whole[k:min(k + (1 << page), limit)] for k in range(0, limit, 1 << page)]
    assert len(parts) == pages
    first = offset + hashes
    assert [hashlib.sha256(p).digest() for p in parts] == [blob[k:k + 32] for k in range(first, first + 32 * pages, 32)]


@pytest.mark.parametrize("machine", ["aarch64-darwin"])
@pytest.mark.parametrize("fmi", ["2"])  # FMI 3.0 has a folder for each processor
def test_llvm_builds_the_same_universal_library(path: Path, tmp_path: Path) -> None:
    """LLVM's lipo extracts both parts and joins them to the same bytes."""
    lipo = tool("llvm-lipo-14", "llvm-14")
    for cpu in ("x86_64", "arm64"):
        subprocess.run([lipo, path, "-thin", cpu, "-output", tmp_path / cpu], check=True)
    # The alignment for x86-64 is that processor's page of 4 KiB, which lipo itself does not choose.
    subprocess.run([lipo, "-create", tmp_path / "x86_64", tmp_path / "arm64", "-segalign", "x86_64", "4000", "-output",
                    tmp_path / "again"], check=True)
    assert path.read_bytes() == (tmp_path / "again").read_bytes()
