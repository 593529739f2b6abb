"""Libraries for other machines in hosts for these: Windows through Wine, Linux on arm64 through QEMU; on 32-bit ARM the
sources, compiled into the host."""

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
WINE = "/usr/lib/wine"  # where Debian puts its programs that have no wrapper
ARM_LIBRARIES = Path("/usr/aarch64-linux-gnu")  # and its C library for arm64


def calling(unpacked: Path, host: Path, target: str, platform: str, runner: list[str | Path],
            environment: dict[str, str]) -> Host:
    """Runs the host, built for zig's `target`, with the FMU's library for a platform."""
    made = compile_host([sys.executable, "-m", "ziglang", "cc", "-target", target], unpacked, host)
    (machine,) = PLATFORMS[platform].targets
    folder = next(f for f in (unpacked / "binaries" / name for name in (platform, machine)) if f.is_dir())
    library = folder / f"EMCAS{PLATFORMS[platform].suffix}"

    def call(*arguments: str) -> str:
        return run([*runner, made, library, UNUSED, *arguments], environment=environment)

    return call


def wine(unpacked: Path, folder: Path) -> Iterator[Host]:
    """The host for Windows; ends Wine's services in the end."""
    program, server = tool("wine64", "wine64", WINE), tool("wineserver64", "wine64", WINE)
    # A prefix and home of its own, no display, and no offers to install Mono and Gecko.
    environment = {"WINEPREFIX": str(folder / "prefix"), "HOME": str(folder), "WINEDEBUG": "-all", "DISPLAY": "",
                   "WINEDLLOVERRIDES": "mscoree,mshtml="}
    try:
        yield calling(unpacked, folder / "host" / "host.exe", "x86_64-windows-gnu", "win64", [program], environment)
    finally:
        # Its services outlive the last program by seconds; fails harmlessly if they are gone.
        subprocess.run([server, "-k"], env=environment, check=False, timeout=60)


def qemu(unpacked: Path, folder: Path) -> Iterator[Host]:
    """The host for Linux on arm64, with Debian's C library for it."""
    if not ARM_LIBRARIES.is_dir():
        missing(f"there is no {ARM_LIBRARIES} (Debian: apt-get install libc6-arm64-cross)")
    # The host asks how much memory is taken, which the C library tells since 2.33.
    yield calling(unpacked, folder / "host", "aarch64-linux-gnu.2.33", "aarch64-linux",
                  [tool("qemu-aarch64", "qemu-user"), "-L", ARM_LIBRARIES], {})


def arm(unpacked: Path, folder: Path) -> Iterator[Host]:
    """The host for Linux on 32-bit ARM with the FMU's sources, for a processor that has fused multiply-add."""
    compiler = [tool("arm-linux-gnueabihf-gcc", "gcc-arm-linux-gnueabihf"), "-static"]
    flags = ("-O2", "-mfpu=vfpv4", "-ffp-contract=off")
    emulator = tool("qemu-arm", "qemu-user")
    made = compile_host(compiler, unpacked, folder / "host", flags, static=True)

    def call(*arguments: str) -> str:
        return run([emulator, made, "-", UNUSED, *arguments])

    yield call


@pytest.fixture(scope="module", params=["2", "3"])
def fmi(request: pytest.FixtureRequest) -> str:
    """A version of FMI."""
    found: str = request.param
    return found


@pytest.fixture(scope="module", params=[wine, qemu, arm], ids=["win64", "aarch64-linux", "arm"])
def machine(request: pytest.FixtureRequest, fmi: str, tmp_path_factory: pytest.TempPathFactory, linux: None
            ) -> Iterator[Host]:
    """Runs the host for another machine with the FMU's library or sources for that."""
    built = ("native", "unpacked3") if request.param is arm else ("every_platform", "every_machine")
    unpacked = request.getfixturevalue(built[fmi == "3"])
    yield from request.param(unpacked, tmp_path_factory.mktemp("machine"))


@pytest.mark.parametrize("encoder", ["0", "1"])
def test_same_numbers_as_on_linux(machine: Host, loading: Host, encoder: str) -> None:
    """To the bit: no function of the C library does more than is exact."""
    assert trajectory(loading("plain", encoder)) == trajectory(machine("plain", encoder))


def test_instances_in_turns(machine: Host) -> None:
    assert table(machine("four")) == {"equal": "4", "distinct": "4"}


def test_instances_in_threads(machine: Host) -> None:
    assert table(machine("threads")) == {"equal": "8"}


def test_states(machine: Host) -> None:
    found = table(machine("states"))
    assert found == {**STATES, "damaged": found["damaged"], "refused": found["damaged"]}


def test_misuse(machine: Host, fmi: str) -> None:
    found = table(machine("misuse"))
    assert abs(float(found.pop("angle")) - 0.1) < 0.01  # as on Linux
    assert found == (MISUSE if fmi == "2" else MISUSE3)
