"""Unpacked FMUs of both back ends, and programs of the host in C."""

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
    """Unpack an FMU, and return the folder."""
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
    """The native FMU with a library for every platform, unpacked; zig needs minutes if nothing is in its cache."""
    if importlib.util.find_spec("ziglang") is None:
        missing("there is no ziglang (pip install ziglang)")
    return unpack(shipped_unit(everywhere=True), tmp_path_factory.mktemp("unpacked") / "every")


@pytest.fixture(scope="session")
def python(fmu: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The Python FMU, unpacked."""
    return unpack(fmu, tmp_path_factory.mktemp("unpacked") / "python")


@pytest.fixture(scope="session")
def linux() -> None:
    """Skip the test if the FMU's linux64 library cannot be loaded here."""
    if (platform.system(), platform.machine()) != ("Linux", "x86_64"):
        missing(f"this is {platform.system()} {platform.machine()}, not Linux x86_64")


@pytest.fixture(scope="session")
def executable(native: Path, tmp_path_factory: pytest.TempPathFactory, linux: None) -> Path:
    """The program of the host, which loads the native FMU's library."""
    return compile_host([tool("gcc", "gcc")], native, tmp_path_factory.mktemp("loading") / "host")


def loaded(executable: Path, library: Path | str) -> Host:
    """Return a function that runs the host with an FMU's library."""
    def call(*arguments: str, **options: Any) -> str:
        return run([executable, library, UNUSED, *arguments], **options)

    return call


def with_sources(unpacked: Path, folder: Path) -> Host:
    """Return a function that runs the host with an FMU's sources, under address and undefined-behaviour sanitizers."""
    flags = ("-fsanitize=address,undefined", "-fno-sanitize-recover=all")
    return loaded(compile_host([tool("gcc", "gcc")], unpacked, folder / "host", flags, static=True), "-")


@pytest.fixture(scope="session")
def loading(executable: Path, native: Path) -> Host:
    """Function that runs the host with the FMU's library."""
    return loaded(executable, native / "binaries/linux64/EMCAS.so")


@pytest.fixture(scope="session")
def linked(native: Path, tmp_path_factory: pytest.TempPathFactory, linux: None) -> Host:
    """Function that runs the host with the FMU's sources."""
    return with_sources(native, tmp_path_factory.mktemp("linked"))


@pytest.fixture(scope="session")
def unpacked3(native3: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The FMU of FMI 3.0, unpacked."""
    return unpack(native3, tmp_path_factory.mktemp("unpacked") / "native3")


@pytest.fixture(scope="session")
def loading3(unpacked3: Path, tmp_path_factory: pytest.TempPathFactory, linux: None) -> Host:
    """Function that runs the host with the library of FMI 3.0."""
    program = compile_host([tool("gcc", "gcc")], unpacked3, tmp_path_factory.mktemp("loading3") / "host")
    return loaded(program, unpacked3 / "binaries/x86_64-linux/EMCAS.so")


@pytest.fixture(scope="session")
def linked3(unpacked3: Path, tmp_path_factory: pytest.TempPathFactory, linux: None) -> Host:
    """Function that runs the host with the sources of FMI 3.0."""
    return with_sources(unpacked3, tmp_path_factory.mktemp("linked3"))
