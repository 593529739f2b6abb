"""Records of a servo that swings a pendulum, in the format of Rhoban/bam, and their simulation."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from math import isfinite, pi
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from emcas_fmu.api import EmcasError, ParameterSet, load_parameters
from emcas_fmu.runtime.compiled import parameter_row
from emcas_fmu.simulation import respond_all

Array = NDArray[np.float64]

SET, MODEL = "xl330", "servo"
FOLDER = "EMCAS_RECORDS"  # environment variable with the folder of the records
WHERE = ("the records are part of Rhoban/bam, \"Better Actuator Models\" (ICRA 2025, Apache-2.0), "
         "https://github.com/Rhoban/bam: name their files or folder by --records, or the folder by the environment "
         f"variable {FOLDER}")
DIVISOR = 256.0  # ratio of the firmware's gain to the PWM counts per count of error in the records
TILT = 0.0253  # rad, angle at which the pendulum hangs below the encoder's zero; identified with the set, +-0.003
STEP = 1e-3  # s, of the simulation
TILT_NAME, LATENCY = "attitude.pitch", "command.latency"  # the tilt is an input of the simulation
_COLUMNS = ("timestamp", "goal_position", "torque_enable", "position")


class NoRecordsError(EmcasError):
    """No records are named, or a named folder contains none."""


@dataclass(frozen=True)
class Record:
    """One run: gain in the firmware's units, pendulum [kg, m], and goal, enable and position [rad] at times [s]."""

    path: Path
    sha256: str
    gain: float
    mass: float
    length: float
    trajectory: str
    time: Array
    goal: Array
    enabled: NDArray[np.bool_]
    position: Array


def read(path: Path) -> Record:
    """Return a record from a JSON file. Raises EmcasError with file, entry and remedy."""
    try:
        content = path.read_bytes()
        contents = json.loads(content)
    except (OSError, ValueError) as error:
        raise EmcasError(f"{path}: is not a record: {error}") from error
    if not isinstance(contents, dict) or not isinstance(contents.get("entries"), list):
        raise EmcasError(f"{path}: is not a record: it has no list `entries`")
    gain, mass, length = (_number(path, "", contents, name) for name in ("kp", "mass", "length"))
    if min(mass, length) <= 0.0:
        raise EmcasError(f"{path}: mass {mass:g} kg and length {length:g} m of the pendulum must be above 0")
    rows = [[_number(path, f"entry {k}: ", entry, name) for name in _COLUMNS]
            for k, entry in enumerate(contents["entries"])]
    if len(rows) < 2:
        raise EmcasError(f"{path}: has {len(rows)} entries; a run has at least two")
    time, goal, enabled, position = np.array(rows).T
    if (back := np.flatnonzero(np.diff(time) <= 0.0)).size:
        raise EmcasError(f"{path}: entry {back[0] + 1}: timestamp {time[back[0] + 1]:.6g} is not after the one before; "
                         "sort the entries, or leave out those that repeat")
    return Record(path, hashlib.sha256(content).hexdigest(), gain, mass, length, str(contents.get("trajectory", "")),
                  time - time[0], goal, enabled != 0.0, position)


def _number(path: Path, where: str, entry: Any, name: str) -> float:
    if not isinstance(entry, dict) or name not in entry:
        raise EmcasError(f"{path}: {where}there is no {name}; use records in the format of bam: {WHERE}")
    try:
        value = float(entry[name])
    except (TypeError, ValueError) as error:
        raise EmcasError(f"{path}: {where}{name} is {entry[name]!r}; it must be a number") from error
    if not isfinite(value):
        raise EmcasError(f"{path}: {where}{name} is {value}; leave this entry out")
    return value


def files(named: Iterable[Path] | None) -> list[Path]:
    """Return the files of the `named` records, by default of the folder in the environment variable FOLDER.

    For a folder these are all its records, or those in its folder xl330. Raises NoRecordsError if there is none.
    """
    chosen = list(named or (Path(folder) for folder in [os.environ.get(FOLDER, "")] if folder))
    if not chosen:
        raise NoRecordsError(f"there are no records: {WHERE}")
    found: list[Path] = []
    for name in chosen:
        path = name / SET if (name / SET).is_dir() else name
        inside = sorted(path.glob("*.json")) if path.is_dir() else [path] if path.is_file() else []
        if not inside:
            raise NoRecordsError(f"{path}: there is no record; {WHERE}")
        found += inside
    return found


def of_bench(record: Record, base: ParameterSet) -> ParameterSet:
    """Return the servo's parameters for a record: its gain, the pendulum as fin, the first angle as start angle."""
    return base.with_values({
        "controller.kp": record.gain / DIVISOR, "mass.fin": record.mass, "center_of_mass.fin.x": 0.0,
        "center_of_mass.fin.z": record.length, "inertia.fin": record.mass * record.length**2, "loads.gravity": True,
        "command.limit": pi, "fin.stop_angle": pi, "fin.start_angle": float(record.position[0])})


def simulated(record: Record, base: ParameterSet, changes: Mapping[str, Array | float]) -> Array:
    """Return the simulated position [rad] at the stamps of a record: an array [..., stamps].

    `changes` are values [SI] of parameters that override `base`, and of the bench's tilt: numbers, or arrays [...] with
    a value for each simulation. A simulation that does not reach its end is nan. The inputs are goal and enable, held
    between stamps. It starts at the first position, at rest.
    """
    bench = of_bench(record, base)
    values = {TILT_NAME: TILT, **changes}
    shape = np.broadcast_shapes(*(np.shape(each) for each in values.values()))
    names = [v.name for v in bench.actuator.parameters]
    sets = np.tile(parameter_row(bench.values, MODEL), (*shape, 1))
    for name in values.keys() - {TILT_NAME}:
        sets[..., names.index(name)] = values[name]
    sets = sets.reshape(-1, len(names))
    count = int(np.ceil(record.time[-1] / STEP)) + 1
    grid = np.arange(count) * STEP
    at = np.searchsorted(record.time, grid + 1e-9, side="right") - 1
    driven = {"fin_command": record.goal[at], "enable": record.enabled[at].astype(float),
              TILT_NAME: np.tile(np.ravel(np.broadcast_to(values[TILT_NAME], shape))[:, None], (1, count))}
    inputs = [driven.get(v.name, np.full(count, float(v.initial(bench.values)))) for v in bench.actuator.inputs]
    angle = respond_all(sets, inputs, STEP, ("fin_angle",), model=MODEL).columns["fin_angle"]
    before = np.minimum(np.searchsorted(grid, record.time, side="right") - 1, count - 2)
    share = record.time / STEP - before
    position: Array = angle[:, before] * (1.0 - share) + angle[:, before + 1] * share
    return position.reshape(*shape, -1)


def error(record: Record, position: Array) -> Array:
    """Return the mean absolute error [mrad] of simulated positions [..., stamps] [rad]: an array [...]."""
    mean: Array = 1e3 * np.mean(np.abs(position - record.position), axis=-1)
    return mean


def value(base: ParameterSet, name: str) -> float:
    """Return the value [SI] of a parameter, or of the tilt, that `simulated` uses without changes."""
    return TILT if name == TILT_NAME else float(base.values[name])


def shipped(overriding: Sequence[Path] = ()) -> ParameterSet:
    """Return the shipped set of the servo, overridden by parameter files."""
    return load_parameters([SET, *overriding], model=MODEL)
