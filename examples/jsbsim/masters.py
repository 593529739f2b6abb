"""The fins moved by a single FMU four times as an SSP archive has it, under fmpy, libcosim or Ecos."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import nan
from pathlib import Path

import numpy as np

from emcas_fmu.errors import EmcasError
from emcas_fmu.ssp.archive import NOMINAL, SspError
from emcas_fmu.ssp.structure import Structure, read_variant
from emcas_fmu.ssp.write import write_ssp
from examples.ssp_hosts import hosts

from .actuators import Demand, Response
from .fmu import (
    FLAG,
    LINES,
    OUTPUTS,
    OWN_INPUTS,
    SHARED_INPUTS,
    VOLTAGE,
    flattened,
    line_of,
    on_line,
    require_bus,
    require_supply,
)
from .vehicle import AZIMUTHS, FINS, STATION, Array

MASTERS = {"fmpy": "fmpy", "libcosim": "libcosimpy", "ecos": "ecospy"}
"""Names here, and those of the Python packages."""
VARIANT = "rocket"
_INPUTS = (*((origin, f"fin{k}.{name}", unit, place + k - 1)
             for k in FINS for origin, name, unit, place in OWN_INPUTS),
           *((origin, f"fin{k}.{name}", unit, place)
             for k in FINS for origin, name, unit, place in SHARED_INPUTS))
_OUTPUTS = tuple((f"fin{k}.{name}", unit) for k in FINS for name, unit in OUTPUTS)
_FLAGS = tuple(f"fin{k}.{FLAG}" for k in FINS)


def write_archive(path: Path, fmu: Path) -> Path:
    """EMCAS.ssp of four times the single actuator `fmu`, with a variant whose parts weigh in their place.

    Raises EmcasError.
    """
    changes = path.with_suffix(".toml")
    changes.write_text(f"[every_fin.loads]\ngravity = true\n[every_fin.mounting]\nstation = '{STATION} m'\n",
                       encoding="utf-8")
    return write_ssp(path, fmu, fins=len(AZIMUTHS), layout="cross", variant_files={VARIANT: changes}).path


class InMaster:
    """Four fins of an archive, stepped by one of MASTERS with a fixed step."""

    def __init__(self, ssp: Path, master: str, step: float, variant: str = NOMINAL,
                 bus_voltage: float | None = None) -> None:
        """Start `variant` with a step [s] on a bus of `bus_voltage` [V], or on the supply that the variant starts with.

        Raises EmcasError where the master is unknown, absent or refuses, and naming the connection where the archive's
        fins have no connector for it, or one in another unit.
        """
        if master not in MASTERS:
            raise EmcasError(f"there is no master {master!r}; there is {', '.join(MASTERS)}")
        structure = _checked(ssp, variant)
        self._line = _line(structure)
        require_bus(ssp, self._line, bus_voltage)
        start = structure.values.get(("fin1", self._line), nan)
        self._supply = require_supply(ssp, self._line, float(start) if bus_voltage is None else bus_voltage)
        self._ssp, self._system = ssp, hosts.open(ssp, MASTERS[master], variant, step)

    def step(self, time: float, step: float, demand: Demand) -> Response:
        """One step of the master. Outputs are those of its end: nothing is needed before the first."""
        if abs(step - self._system.step_size) > 1e-12:
            raise EmcasError(f"{self._ssp}: was opened with steps of {self._system.step_size:g} s, not {step:g} s")
        flat = flattened(demand)
        for _, name, _, place in _INPUTS:
            self._system.set(name, float(flat[place]))
        self._system.set(self._line, self._supply)  # a master may not pass the variant's on
        self._system.step()
        reals = np.array([self._system.get(name) for name, _ in _OUTPUTS]).reshape(len(FINS), -1)
        flags = np.array([self._system.get(name) for name in _FLAGS], dtype=bool)
        power = float(reals[:, 2].sum())
        return Response(reals[:, 0], reals[:, 1], power, flags,
                        **on_line(self._line, self._supply, power))

    def close(self) -> None:
        """End the master's system."""
        self._system.close()


def _line(structure: Structure) -> str:
    return line_of({name for fin, name in structure.connectors if fin}) or VOLTAGE


def _checked(ssp: Path, variant: str) -> Structure:
    """The variant's structure, with all that is wired."""
    structure = read_variant(ssp, variant)
    connectors = {f"{fin}.{name}": connector for (fin, name), connector in structure.connectors.items() if fin}
    supply = _line(structure)
    wanted = [*((f"{origin} -> {name}", name, "input", unit) for origin, name, unit, _ in _INPUTS),
              *((f"source -> fin{k}.{supply}", f"fin{k}.{supply}", "input", LINES[supply][0][1]) for k in FINS),
              *((f"{name} -> rocket", name, "output", unit) for name, unit in _OUTPUTS),
              *((f"{name} -> figures", name, "output", "") for name in _FLAGS)]
    for what, name, kind, unit in wanted:
        connector = connectors.get(name)
        if connector is None or connector.kind != kind:
            raise SspError(f"{ssp}: connection {what}: the system has no {kind} {name}; `emcas ssp` writes one that "
                           "has")
        if connector.unit not in ("", unit):  # without a unit it is the FMU's, which the check compares
            raise SspError(f"{ssp}: connection {what}: {name} is in {connector.unit}, not {unit or 'no unit'}; "
                           "declare the unit of the FMU")
    return structure


@dataclass(frozen=True)
class Agreement:
    """Largest differences of a flight to that of another master."""

    fins: float
    """Of the fin angles [rad]."""
    attitude: float
    """Of roll, pitch and yaw [rad]."""
    identical: bool
    """Whether all columns are the same to the last bit."""


def agreement(flight: Mapping[str, Array], other: Mapping[str, Array]) -> Agreement:
    """Compare two flights of as many rows; columns of shape (rows,)."""
    def apart(names: list[str]) -> float:
        return float(max(np.abs(flight[n] - other[n]).max() for n in names))

    return Agreement(apart([f"fin{k}_rad" for k in FINS]), apart([f"{n}_rad" for n in ("roll", "pitch", "yaw")]),
                     all(np.array_equal(column, other[name]) for name, column in flight.items()))
