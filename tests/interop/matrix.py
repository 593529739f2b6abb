"""Run every FMU in every client in separate processes, and compare results and messages."""

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
# All lines of a traceback except the last; an empty line.
_NOISE = re.compile(r"Traceback \(most recent call last\):|\s.*|")
# sofirpy prints progress bars, and setuptools a warning at its import; both have nothing to do with the FMU.
_QUIET = {"TQDM_DISABLE": "1", "PYTHONWARNINGS": "ignore:pkg_resources is deprecated:UserWarning"}
FMUSIM = ("fmusim", "fmusim_preloaded")


@dataclass(frozen=True)
class Complaint:
    """A known message of clients about FMUs; see known_complaints.toml."""

    clients: Sequence[str]
    whose: str
    text: str
    meaning: str
    units: Sequence[str] = tuple(UNITS)
    fails: bool = False


@cache
def known() -> Sequence[Complaint]:
    """Return the list of known complaints."""
    entries = tomllib.loads((HERE / "known_complaints.toml").read_text(encoding="utf-8"))["complaint"]
    return [Complaint(**entry) for entry in entries]


def pairs() -> Iterator[tuple[str, str]]:
    """Yield names of FMUs and of clients that can run them here."""
    absent = set(() if shutil.which("fmusim") else FMUSIM)  # users build it themselves; it is in no registry
    if sys.version_info < (3, 11):
        absent.add("fmuloader")
    for name, unit in UNITS.items():
        useless = "fmusim_preloaded" if unit.sources else "rebuilt"
        yield from ((name, client) for client in CLIENTS if client not in absent | {useless})


@dataclass(frozen=True)
class Outcome:
    """A client's exit code, its messages without repetition, and the trajectory of outputs."""

    code: int
    messages: Sequence[str]
    outputs: Trajectory


def run(client: str, fmu: Path, task: Mapping[str, Any], folder: Path) -> Outcome:
    """Run an FMU in a client, in a separate process; skip the test if the client is not installed."""
    for name, package in CLIENTS[client].programs:
        tool(name, package)
    task_file, table = folder / f"{client}.json", folder / f"{client}.csv"
    task_file.write_text(json.dumps(task), encoding="utf-8")
    done = subprocess.run([sys.executable, "-m", "tests.interop.clients", client, fmu, task_file, table],
                          cwd=HERE.parents[1], env={**os.environ, **_QUIET}, capture_output=True, text=True,
                          timeout=300)
    if done.returncode == ABSENT:
        missing(f"{client} cannot be loaded (pip install {CLIENTS[client].package}): {done.stderr.strip()}")
    messages = dict.fromkeys(line for line in (done.stdout + done.stderr).splitlines() if not _NOISE.fullmatch(line))
    if done.returncode < 0:
        messages[f"ended by {signal.Signals(-done.returncode).name}"] = None
    outputs = trajectory(table.read_text(encoding="utf-8")) if table.is_file() else {}
    return Outcome(done.returncode, list(messages), outputs)


def problems(unit: str, client: str, outcome: Outcome) -> list[str]:
    """Return the differences from the list of known complaints."""
    listed = [c for c in known() if client in c.clients and unit in c.units]
    new = [line for line in outcome.messages if not any(re.fullmatch(c.text, line) for c in listed)]
    # A client that fails need not print its other messages.
    due = [c for c in listed if c.fails] or listed
    missing_texts = [c.text for c in due if not any(re.fullmatch(c.text, line) for line in outcome.messages)]
    texts = [*(f"printed, and not in known_complaints.toml: {line}" for line in new),
             *(f"in known_complaints.toml, and not printed: {text}" for text in missing_texts)]
    if (outcome.code != 0) != any(c.fails for c in listed):
        texts.append(f"ended with code {outcome.code}")
    if bool(outcome.outputs.get("time")) != (outcome.code == 0 and client not in CHECKS):
        texts.append(f"gave a trajectory of {len(outcome.outputs.get('time', ()))} steps")
    return texts


def from_reference(unit: Unit, outputs: Trajectory) -> float:
    """Return the largest difference [deg] of a fin's angle from the reference response."""
    reference = step().reference["fin_angle"][1:]
    return float(max(np.degrees(np.abs(np.array(outputs[name]) - reference).max()) for name in unit.angles))


def compared(unit: Unit, client: str, outputs: Trajectory, expected: Trajectory) -> tuple[Trajectory, Trajectory]:
    """Return the columns of two trajectories that can be compared."""
    names = expected if CLIENTS[client].whole else unit.angles
    return {n: outputs[n] for n in names}, {n: expected[n] for n in names}


def from_fmpy(unit: Unit, client: str, outputs: Trajectory, expected: Trajectory) -> float:
    """Return the largest difference of any output from fmpy's, relative to its largest value if that is above 1."""
    return difference(*compared(unit, client, outputs, expected))


class Runs:
    """FMUs and their runs in clients; each is built or run once."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._outcomes: dict[tuple[str, str], Outcome] = {}

    def fmu(self, unit: str) -> Path:
        """Return the FMU's path; build it on first use."""
        folder = self._folder / unit
        path = folder / "unit.fmu"
        if not path.is_file():
            folder.mkdir()
            UNITS[unit].build(folder)
        return path

    def outcome(self, unit: str, client: str) -> Outcome:
        """Return the outcome of an FMU in a client; run it on first use."""
        if (unit, client) not in self._outcomes:
            fmu = self.fmu(unit)
            self._outcomes[unit, client] = run(client, fmu, UNITS[unit].task(), fmu.parent)
        return self._outcomes[unit, client]
