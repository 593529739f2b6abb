"""The host in C and the FMU for other machines: Windows in Wine, Linux on arm64 in QEMU, and on 32-bit ARM in QEMU.

On 32-bit ARM, for which the FMU has no library, its sources are compiled into the host.
"""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from emcas_fmu.runtime.compiler import PLATFORMS

from .conftest import UNUSED, Host
from .expected import MISUSE, MISUSE3, STATES
from .host import compile_host, missing, run, table, tool, trajectory

pytestmark = [pytest.mark.fmu, pytest.mark.slow]
WINE = "/usr/lib/wine"  # Debian's folder of Wine's programs that are not in the search path
ARM_LIBRARIES = Path("/usr/aarch64-linux-gnu")  # Debian's C library for arm64


def with_library(unpacked: Path, host: Path, target: str, platform: str, runner: list[str | Path],
                 environment: dict[str, str]) -> Host:
    """Build the host for zig's `target`; return a function that runs it with the FMU's library for a platform."""
    program = compile_host([sys.executable, "-m", "ziglang", "cc", "-target", target], unpacked, host)
    (machine,) = PLATFORMS[platform].targets
    folder = next(f for f in (unpacked / "binaries" / name for name in (platform, machine)) if f.is_dir())
    library = folder / f"EMCAS{PLATFORMS[platform].suffix}"

    def call(*arguments: str) -> str:
        return run([*runner, program, library, UNUSED, *arguments], environment=environment)

    return call


def wine(unpacked: Path, folder: Path) -> Iterator[Host]:
    """Yield the host for Windows, then end Wine's services."""
    program, server = tool("wine64", "wine64", WINE), tool("wineserver64", "wine64", WINE)
    # Its own prefix and home, no display, and no dialog about Mono and Gecko.
    environment = {"WINEPREFIX": str(folder / "prefix"), "HOME": str(folder), "WINEDEBUG": "-all", "DISPLAY": "",
                   "WINEDLLOVERRIDES": "mscoree,mshtml="}
    try:
        yield with_library(unpacked, folder / "host" / "host.exe", "x86_64-windows-gnu", "win64", [program],
                           environment)
    finally:
        # The services run for seconds after the last program; the command fails harmlessly if they have ended.
        subprocess.run([server, "-k"], env=environment, check=False, timeout=60)


def qemu(unpacked: Path, folder: Path) -> Iterator[Host]:
    """Yield the host for Linux on arm64, with Debian's C library."""
    if not ARM_LIBRARIES.is_dir():
        missing(f"there is no {ARM_LIBRARIES} (Debian: apt-get install libc6-arm64-cross)")
    # The host calls mallinfo2, which glibc has since 2.33.
    yield with_library(unpacked, folder / "host", "aarch64-linux-gnu.2.33", "aarch64-linux",
                  [tool("qemu-aarch64", "qemu-user"), "-L", ARM_LIBRARIES], {})


def arm(unpacked: Path, folder: Path) -> Iterator[Host]:
    """Yield the host for Linux on 32-bit ARM with the FMU's sources, for a processor with fused multiply-add."""
    compiler = [tool("arm-linux-gnueabihf-gcc", "gcc-arm-linux-gnueabihf"), "-static"]
    flags = ("-O2", "-mfpu=vfpv4", "-ffp-contract=off")
    emulator = tool("qemu-arm", "qemu-user")
    program = compile_host(compiler, unpacked, folder / "host", flags, static=True)

    def call(*arguments: str) -> str:
        return run([emulator, program, "-", UNUSED, *arguments])

    yield call


@pytest.fixture(scope="module", params=["2", "3"])
def fmi(request: pytest.FixtureRequest) -> str:
    """A version of FMI."""
    return str(request.param)


@pytest.fixture(scope="module", params=[wine, qemu, arm], ids=["win64", "aarch64-linux", "arm"])
def machine(request: pytest.FixtureRequest, fmi: str, tmp_path_factory: pytest.TempPathFactory, linux: None
            ) -> Iterator[Host]:
    """Function that runs the host for another machine."""
    fixtures = ("native", "unpacked3") if request.param is arm else ("every_platform", "every_machine")
    unpacked = request.getfixturevalue(fixtures[fmi == "3"])
    yield from request.param(unpacked, tmp_path_factory.mktemp("machine"))


@pytest.mark.parametrize("encoder", ["0", "1"])
def test_results_have_the_bits_of_linux(machine: Host, loading: Host, encoder: str) -> None:
    """The model calls only functions of the C library that are exact."""
    assert trajectory(loading("plain", encoder)) == trajectory(machine("plain", encoder))


def test_instances_stepped_in_turns_equal_instances_alone(machine: Host) -> None:
    assert table(machine("four")) == {"equal": "4", "distinct": "4"}


def test_instances_in_threads_equal_instances_alone(machine: Host) -> None:
    assert table(machine("threads")) == {"equal": "8"}


def test_restored_states_continue_and_damaged_ones_are_refused(machine: Host) -> None:
    results = table(machine("states"))
    assert results == {**STATES, "damaged": results["damaged"], "refused": results["damaged"]}


def test_wrong_calls_are_errors_with_a_message(machine: Host, fmi: str) -> None:
    results = table(machine("misuse"))
    assert abs(float(results.pop("angle")) - 0.1) < 0.01  # as in test_c_host.py
    assert results == (MISUSE if fmi == "2" else MISUSE3)
