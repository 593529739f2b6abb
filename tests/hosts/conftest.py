"""The FMUs of both back ends, unpacked, and the host in C."""

from __future__ import annotations

import importlib.util
import platform
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from .host import compile_host, missing, run, tool

Host = Callable[..., str]
UNUSED = "no-such-folder"  # the native FMU must not need its resources


def unpack(fmu: Path, folder: Path) -> Path:
    """The folder an FMU was unpacked into."""
    with zipfile.ZipFile(fmu) as archive:
        archive.extractall(folder)
    return folder


@pytest.fixture(scope="session")
def native_fmu(shipped_unit: Callable[..., Path]) -> Path:
    """EMCAS.fmu of the native back end, for this platform."""
    return shipped_unit()


@pytest.fixture(scope="session")
def native(native_fmu: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The native FMU, unpacked."""
    return unpack(native_fmu, tmp_path_factory.mktemp("unpacked") / "native")


@pytest.fixture(scope="session")
def every_machine(shipped_unit: Callable[..., Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The FMU of FMI 3.0 with a library for every machine, unpacked."""
    if importlib.util.find_spec("ziglang") is None:
        missing("there is no ziglang (pip install ziglang)")
    return unpack(shipped_unit(fmi="3", everywhere=True), tmp_path_factory.mktemp("unpacked") / "every3")


@pytest.fixture(scope="session")
def every_platform(shipped_unit: Callable[..., Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The native FMU with a library for every platform, unpacked; where zig has built nothing yet it takes minutes."""
    if importlib.util.find_spec("ziglang") is None:
        missing("there is no ziglang (pip install ziglang)")
    return unpack(shipped_unit(everywhere=True), tmp_path_factory.mktemp("unpacked") / "every")


@pytest.fixture(scope="session")
def python(fmu: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The Python FMU, unpacked."""
    return unpack(fmu, tmp_path_factory.mktemp("unpacked") / "python")


@pytest.fixture(scope="session")
def linux() -> None:
    """Skips where the FMU's linux64 library cannot be loaded."""
    if (platform.system(), platform.machine()) != ("Linux", "x86_64"):
        missing(f"this is {platform.system()} {platform.machine()}, not Linux x86_64")


@pytest.fixture(scope="session")
def executable(native: Path, tmp_path_factory: pytest.TempPathFactory, linux: None) -> Path:
    """The host that loads the native FMU's library."""
    return compile_host([tool("gcc", "gcc")], native, tmp_path_factory.mktemp("loading") / "host")


def loaded(executable: Path, library: Path) -> Host:
    """Runs the host with an FMU's library loaded."""
    def call(*arguments: str, **options: Any) -> str:
        return run([executable, library, UNUSED, *arguments], **options)

    return call


def with_sources(unpacked: Path, folder: Path) -> Host:
    """Runs the host with an FMU's sources compiled in, under the address and undefined-behaviour sanitizers."""
    flags = ("-fsanitize=address,undefined", "-fno-sanitize-recover=all")
    made = compile_host([tool("gcc", "gcc")], unpacked, folder / "host", flags, static=True)

    def call(*arguments: str, **options: Any) -> str:
        return run([made, "-", UNUSED, *arguments], **options)

    return call


@pytest.fixture(scope="session")
def loading(executable: Path, native: Path) -> Host:
    """Runs the host with the FMU's library loaded."""
    return loaded(executable, native / "binaries/linux64/EMCAS.so")


@pytest.fixture(scope="session")
def linked(native: Path, tmp_path_factory: pytest.TempPathFactory, linux: None) -> Host:
    """Runs the host with the FMU's sources compiled in."""
    return with_sources(native, tmp_path_factory.mktemp("linked"))


@pytest.fixture(scope="session")
def unpacked3(native3: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The FMU of FMI 3.0, unpacked."""
    return unpack(native3, tmp_path_factory.mktemp("unpacked") / "native3")


@pytest.fixture(scope="session")
def loading3(unpacked3: Path, tmp_path_factory: pytest.TempPathFactory, linux: None) -> Host:
    """Runs the host with the library of FMI 3.0 loaded."""
    made = compile_host([tool("gcc", "gcc")], unpacked3, tmp_path_factory.mktemp("loading3") / "host")
    return loaded(made, unpacked3 / "binaries/x86_64-linux/EMCAS.so")


@pytest.fixture(scope="session")
def linked3(unpacked3: Path, tmp_path_factory: pytest.TempPathFactory, linux: None) -> Host:
    """Runs the host with the sources of FMI 3.0 compiled in."""
    return with_sources(unpacked3, tmp_path_factory.mktemp("linked3"))
