"""The libraries of every platform, also those that cannot run here: format, machine, exports, imports."""

from __future__ import annotations

import re
import tempfile
from pathlib import Path

import lief
import pytest

from emcas_fmu.compiler import PLATFORMS

from .host import HERE

pytestmark = [pytest.mark.fmu, pytest.mark.slow]
lief.logging.disable()  # it prints what it makes of empty optional tables

FORMATS = {
    "linux64": (lief.ELF.Binary, lief.ELF.ARCH.X86_64),
    "aarch64-linux": (lief.ELF.Binary, lief.ELF.ARCH.AARCH64),
    "win64": (lief.PE.Binary, lief.PE.Header.MACHINE_TYPES.AMD64),
    "darwin64": (lief.MachO.Binary, lief.MachO.Header.CPU_TYPE.X86_64),
    "aarch64-darwin": (lief.MachO.Binary, lief.MachO.Header.CPU_TYPE.ARM64),
}
# What the C host calls is what FMI 2.0 asks of a co-simulation FMU.
FUNCTIONS = set(re.findall(r"X\((\w+)\)", (HERE / "fmu.h").read_text(encoding="utf-8"))) - {"name"}
LINKER = {"__mh_dylib_header", "___dso_handle"}  # zig's linker adds them to every dylib
SYSTEM = re.compile(r"lib[cm]\.so\.6|kernel32\.dll|ucrtbase\.dll|api-ms-win-crt-[a-z]+-l1-1-0\.dll|"
                    r"/usr/lib/libSystem\.B\.dylib", re.IGNORECASE)
Binary = lief.ELF.Binary | lief.PE.Binary | lief.MachO.Binary


@pytest.fixture(params=sorted(FORMATS))
def platform(request: pytest.FixtureRequest) -> str:
    found: str = request.param
    return found


@pytest.fixture
def path(every_platform: Path, platform: str) -> Path:
    (found,) = (every_platform / "binaries" / platform).iterdir()
    assert found.name == "EMCAS" + PLATFORMS[platform].suffix
    return found


@pytest.fixture
def binary(path: Path) -> Binary:
    found = lief.parse(str(path))
    assert isinstance(found, Binary)
    return found


def exported(binary: Binary) -> set[str]:
    """Names a loader finds, without the underscore Mach-O puts before those of C."""
    if isinstance(binary, lief.PE.Binary):
        table = binary.get_export()
        assert table is not None
        return {str(e.name) for e in table.entries}
    if isinstance(binary, lief.MachO.Binary):
        return {str(s.name).removeprefix("_") for s in binary.symbols if s.has_export_info and s.name not in LINKER}
    return {str(s.name) for s in binary.exported_symbols}


def libraries(binary: Binary) -> set[str]:
    """What the loader has to load besides."""
    if isinstance(binary, lief.PE.Binary):
        return {str(i.name) for i in binary.imports}
    if isinstance(binary, lief.ELF.Binary):
        return {str(name) for name in binary.libraries}
    return {str(d.name) for d in binary.libraries if d.command != lief.MachO.LoadCommand.TYPE.ID_DYLIB}


def test_every_platform_is_looked_at(every_platform: Path) -> None:
    assert {f.name for f in (every_platform / "binaries").iterdir()} == set(FORMATS) == set(PLATFORMS)


def test_format_and_machine(binary: Binary, platform: str) -> None:
    kind, machine = FORMATS[platform]
    assert isinstance(binary, kind)
    if isinstance(binary, lief.ELF.Binary):
        assert (binary.header.machine_type, binary.header.file_type) == (machine, lief.ELF.Header.FILE_TYPE.DYN)
    elif isinstance(binary, lief.PE.Binary):
        assert binary.header.machine == machine
        assert binary.header.has_characteristic(lief.PE.Header.CHARACTERISTICS.DLL)
    else:
        assert (binary.header.cpu_type, binary.header.file_type) == (machine, lief.MachO.Header.FILE_TYPE.DYLIB)


def test_exports_are_the_functions_of_fmi(binary: Binary) -> None:
    assert len(FUNCTIONS) == 34
    assert exported(binary) == {f"fmi2{name}" for name in FUNCTIONS}


def test_needs_only_the_system_libraries(binary: Binary) -> None:
    found = libraries(binary)
    assert found
    assert {name for name in found if not SYSTEM.fullmatch(name)} == set()


def test_no_trace_of_the_machine_it_was_built_on(path: Path) -> None:
    content = path.read_bytes()
    for trace in (f"{tempfile.gettempdir()}/", f"{Path.home()}/", str(HERE.parents[1]), "emcas_cc_"):
        assert trace.encode() not in content, trace


@pytest.mark.parametrize("platform", ["linux64", "aarch64-linux"])
def test_old_enough_for_glibc_2_17(binary: Binary) -> None:
    assert isinstance(binary, lief.ELF.Binary)
    versions = {str(a.name) for r in binary.symbols_version_requirement for a in r.get_auxiliary_symbols()}
    numbers = [tuple(map(int, name.removeprefix("GLIBC_").split("."))) for name in versions]
    assert numbers
    assert max(numbers) <= (2, 17), versions


@pytest.mark.parametrize("platform", ["linux64", "aarch64-linux"])
def test_stack_is_not_executable(binary: Binary) -> None:
    """Hosts with a hardened kernel or a new glibc refuse to load a library that asks for an executable stack."""
    assert isinstance(binary, lief.ELF.Binary)
    (stack,) = [s for s in binary.segments if s.type == lief.ELF.Segment.TYPE.GNU_STACK]
    assert not stack.has(lief.ELF.Segment.FLAGS.X)


@pytest.mark.parametrize("platform", ["darwin64", "aarch64-darwin"])
def test_macos_11_will_load_it(binary: Binary, platform: str) -> None:
    """Built for macOS 11 or before; Apple's processors kill a process that loads code without a signature."""
    assert isinstance(binary, lief.MachO.Binary)
    built = binary.build_version
    assert built is not None
    assert built.platform == lief.MachO.BuildVersion.PLATFORMS.MACOS
    assert tuple(built.minos) <= (11, 0, 0)
    assert binary.has_code_signature or platform == "darwin64"
