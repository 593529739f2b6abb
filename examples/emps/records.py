"""The two records of the EMPS drive, read from a folder."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import io, signal

from emcas_fmu.errors import EmcasError

Array = NDArray[Any]

VARIABLE = "EMCAS_RECORDS"
FITTED, UNSEEN = "DATA_EMPS.mat", "DATA_EMPS_PULSES.mat"
WHERE = ("Janot, Gautier, Brunot: Data Set and Reference Models of EMPS, among the benchmarks for nonlinear "
         "identification of nonlinearbenchmark.org")
SAMPLE_TIME = 1e-3  # s
NEWTON_PER_VOLT = 35.15065188248547  # the drive's gain in both records
_FILTER = signal.butter(4, 100.0, fs=1.0 / SAMPLE_TIME)  # the authors' filter, applied forwards and backwards


class NoRecordsError(EmcasError):
    """No folder of records is named, or the folder does not contain them."""


@dataclass(frozen=True)
class Record:
    """One record at 1 kHz: commanded and measured position [m], the drive's voltage, and the added part of it [V]."""

    name: str
    command: Array
    position: Array
    voltage: Array
    added: Array
    sha256: str

    def __len__(self) -> int:
        return len(self.position)

    @property
    def smooth_position(self) -> Array:
        """The position after the authors' filter [m]."""
        filtered: Array = signal.filtfilt(*_FILTER, self.position)
        return filtered

    @property
    def speed(self) -> Array:
        """The speed [m/s]: central differences of the filtered position."""
        return np.gradient(self.smooth_position, SAMPLE_TIME)


def folder_of(option: Path | None) -> Path:
    """Return the folder of the records: `option`, or the folder `emps` in it. Raises NoRecordsError."""
    if option is None:
        raise NoRecordsError(f"no records: name their folder by --records or {VARIABLE}; they are published: {WHERE}")
    folder = option / "emps" if (option / "emps").is_dir() else option
    if missing := [name for name in (FITTED, UNSEEN) if not (folder / name).is_file()]:
        raise NoRecordsError(f"{folder}: there is no {missing[0]}; both records belong there: {WHERE}")
    return folder


def load(path: Path) -> Record:
    """Return a record from a MATLAB file. Raises EmcasError, which names the file and its problem."""
    try:
        content = path.read_bytes()
        read = io.loadmat(BytesIO(content))
    except (OSError, ValueError, TypeError, NotImplementedError, io.matlab.MatReadError) as error:
        raise EmcasError(f"{path}: is not a MATLAB file that SciPy reads ({error}); copy it again") from error
    # In spite of their name, pulses_N are in V. They are a part of vir.
    names = {"qg": "command", "qm": "position", "vir": "voltage", "pulses_N": "added"}
    columns = {name: np.ravel(read[key]).astype(float) for key, name in names.items() if key in read}
    columns.setdefault("added", np.zeros_like(columns.get("position", np.empty(0))))
    if missing := [key for key, name in names.items() if name not in columns]:
        raise EmcasError(f"{path}: there is no {missing[0]}; a record has t, qg, qm and vir")
    time = np.ravel(read.get("t", np.empty(0)))
    if len({len(time), *map(len, columns.values())}) > 1 or len(time) < 1.0 / SAMPLE_TIME:
        lengths = ", ".join(f"{name} {len(column)}" for name, column in columns.items())
        raise EmcasError(f"{path}: t has {len(time)} rows, {lengths}; expected equal numbers, at least 1000")
    if not all(np.isfinite(column).all() for column in (time, *columns.values())):
        raise EmcasError(f"{path}: there is a value that is not finite; copy the file again")
    if np.max(np.abs(np.diff(time) / SAMPLE_TIME - 1.0)) > 0.01:  # 1e-4 in the published records
        raise EmcasError(f"{path}: t does not advance by 1 ms everywhere; the loops are simulated at 1 kHz")
    return Record(path.stem, sha256=hashlib.sha256(content).hexdigest(), **columns)
