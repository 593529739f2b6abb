"""The Windows library in a Windows host, through Wine."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from .conftest import UNUSED, Host
from .expected import MISUSE, STATES
from .host import compile_host, difference, run, table, tool, trajectory

pytestmark = [pytest.mark.fmu, pytest.mark.slow]
WINE = "/usr/lib/wine"  # where Debian puts its programs that have no wrapper


@pytest.fixture(scope="module")
def windows(every_platform: Path, tmp_path_factory: pytest.TempPathFactory, linux: None) -> Iterator[Host]:
    """Runs the host for Windows with the FMU's win64 library."""
    wine, server = tool("wine64", "wine64", WINE), tool("wineserver64", "wine64", WINE)
    folder = tmp_path_factory.mktemp("wine")
    made = compile_host([sys.executable, "-m", "ziglang", "cc", "-target", "x86_64-windows-gnu"], every_platform,
                        folder / "host" / "host.exe")
    # A prefix and home of its own, no display, and no offers to install Mono and Gecko.
    environment = {"WINEPREFIX": str(folder / "prefix"), "HOME": str(folder), "WINEDEBUG": "-all", "DISPLAY": "",
                   "WINEDLLOVERRIDES": "mscoree,mshtml="}


    def call(*arguments: str) -> str:
        library = every_platform / "binaries/win64/EMCAS.dll"
        return run([wine, made, library, UNUSED, *arguments], environment=environment)

    try:
        yield call
    finally:
        # Its services outlive the last program by seconds; fails harmlessly if they are gone.
        subprocess.run([server, "-k"], env=environment, check=False, timeout=60)


def test_same_numbers_as_on_linux(windows: Host, loading: Host) -> None:
    """Without the encoder, whose counts could make a step of a last bit. The C libraries' functions differ by one unit
    in the last place of an angle (1e-16 rad); ratio and loop gains make at most some 1e3 V of a radian: 1e-12."""
    assert difference(trajectory(loading("plain", "0")), trajectory(windows("plain", "0"))) < 1e-12


def test_instances_in_turns(windows: Host) -> None:
    assert table(windows("four")) == {"equal": "4", "distinct": "4"}


def test_instances_in_threads(windows: Host) -> None:
    assert table(windows("threads")) == {"equal": "8"}


def test_states(windows: Host) -> None:
    found = table(windows("states"))
    assert found == {**STATES, "damaged": found["damaged"], "refused": found["damaged"]}


def test_misuse(windows: Host) -> None:
    found = table(windows("misuse"))
    assert abs(float(found.pop("angle")) - 0.1) < 0.01  # as on Linux
    assert found == MISUSE
