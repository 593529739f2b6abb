"""Every FMU in every client: runs in separate processes, and what is to be said of them."""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from emcas_fmu.parameters.toml import tomllib
from tests.hosts.host import Trajectory, difference, missing, tool, trajectory

from .clients import ABSENT, CHECKS, CLIENTS
from .units import UNITS, Unit, step

HERE = Path(__file__).parent
# All of a traceback but its last line; an empty line.
_NOISE = re.compile(r"Traceback \(most recent call last\):|\s.*|")
# Of sofirpy's, and not of an FMU: progress bars, and a warning at its import that newer versions of setuptools give.
_QUIET = {"TQDM_DISABLE": "1", "PYTHONWARNINGS": "ignore:pkg_resources is deprecated:UserWarning"}
FMUSIM = ("fmusim", "fmusim_preloaded")


@dataclass(frozen=True)
class Complaint:
    """What clients are known to say of FMUs; see known_complaints.toml."""

    clients: Sequence[str]
    whose: str
    text: str
    meaning: str
    units: Sequence[str] = tuple(UNITS)
    fails: bool = False


@cache
def known() -> Sequence[Complaint]:
    """The list of known complaints."""
    entries = tomllib.loads((HERE / "known_complaints.toml").read_text(encoding="utf-8"))["complaint"]
    return [Complaint(**entry) for entry in entries]


def pairs() -> Iterator[tuple[str, str]]:
    """FMUs and the clients that are available for them here."""
    absent = set(() if shutil.which("fmusim") else FMUSIM)  # in no registry: where somebody has built it
    if sys.version_info < (3, 11):
        absent.add("fmuloader")
    for name, unit in UNITS.items():
        useless = "fmusim_preloaded" if unit.sources else "rebuilt"
        yield from ((name, client) for client in CLIENTS if client not in absent | {useless})


@dataclass(frozen=True)
class Outcome:
    """What a client made of an FMU: its exit code, what it said, each text once, and the trajectory."""

    code: int
    said: Sequence[str]
    found: Trajectory


def run(client: str, fmu: Path, task: Mapping[str, Any], folder: Path) -> Outcome:
    """Run an FMU in a client, in a separate process; skip where the client is not installed."""
    for name, package in CLIENTS[client].programs:
        tool(name, package)
    given, table = folder / f"{client}.json", folder / f"{client}.csv"
    given.write_text(json.dumps(task), encoding="utf-8")
    done = subprocess.run([sys.executable, "-m", "tests.interop.clients", client, fmu, given, table],
                          cwd=HERE.parents[1], env={**os.environ, **_QUIET}, capture_output=True, text=True,
                          timeout=300)
    if done.returncode == ABSENT:
        missing(f"{client} cannot be loaded (pip install {CLIENTS[client].package}): {done.stderr.strip()}")
    said = dict.fromkeys(line for line in (done.stdout + done.stderr).splitlines() if not _NOISE.fullmatch(line))
    if done.returncode < 0:
        said[f"ended by {signal.Signals(-done.returncode).name}"] = None
    found = trajectory(table.read_text(encoding="utf-8")) if table.is_file() else {}
    return Outcome(done.returncode, list(said), found)


def problems(unit: str, client: str, outcome: Outcome) -> list[str]:
    """What is not as the list of known complaints has it."""
    listed = [c for c in known() if client in c.clients and unit in c.units]
    new = [line for line in outcome.said if not any(re.fullmatch(c.text, line) for c in listed)]
    # Where the client ends early it need not come to all it would say.
    due = [c for c in listed if c.fails] or listed
    gone = [c.text for c in due if not any(re.fullmatch(c.text, line) for line in outcome.said)]
    found = [*(f"said, and not in known_complaints.toml: {line}" for line in new),
             *(f"in known_complaints.toml, and not said: {text}" for text in gone)]
    if (outcome.code != 0) != any(c.fails for c in listed):
        found.append(f"ended with code {outcome.code}")
    if bool(outcome.found.get("time")) != (outcome.code == 0 and client not in CHECKS):
        found.append(f"gave a trajectory of {len(outcome.found.get('time', ()))} steps")
    return found


def from_reference(unit: Unit, found: Trajectory) -> float:
    """The largest difference [deg] of a fin's angle to the reference response."""
    wanted = step().reference["fin_angle"][1:]
    return float(max(np.degrees(np.abs(np.array(found[name]) - wanted).max()) for name in unit.angles))


def compared(unit: Unit, client: str, found: Trajectory, expected: Trajectory) -> tuple[Trajectory, Trajectory]:
    """Those columns of two trajectories that can be compared."""
    names = expected if CLIENTS[client].whole else unit.angles
    return {n: found[n] for n in names}, {n: expected[n] for n in names}


def from_fmpy(unit: Unit, client: str, found: Trajectory, expected: Trajectory) -> float:
    """The largest difference of any output to fmpy's run, over its magnitude where that is above 1."""
    return difference(*compared(unit, client, found, expected))


class Runs:
    """FMUs and their runs in clients, each made once."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._outcomes: dict[tuple[str, str], Outcome] = {}

    def fmu(self, unit: str) -> Path:
        """The FMU, built on first use."""
        folder = self._folder / unit
        built = folder / "unit.fmu"
        if not built.is_file():
            folder.mkdir()
            UNITS[unit].build(folder)
        return built

    def outcome(self, unit: str, client: str) -> Outcome:
        """What a client made of it."""
        if (unit, client) not in self._outcomes:
            fmu = self.fmu(unit)
            self._outcomes[unit, client] = run(client, fmu, UNITS[unit].task(), fmu.parent)
        return self._outcomes[unit, client]
