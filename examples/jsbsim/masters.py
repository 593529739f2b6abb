"""Actuators of the fins from an SSP archive of four single FMUs, run by fmpy, libcosim or Ecos."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import nan
from pathlib import Path

import numpy as np

from emcas_fmu.errors import EmcasError
from emcas_fmu.ssp.archive import NOMINAL, SspError
from emcas_fmu.ssp.structure import SystemStructure, read_variant
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
"""Python packages of the masters, by the masters' names."""
VARIANT = "rocket"
_INPUTS = (*((origin, f"fin{k}.{name}", unit, index + k - 1)
             for k in FINS for origin, name, unit, index in OWN_INPUTS),
           *((origin, f"fin{k}.{name}", unit, index)
             for k in FINS for origin, name, unit, index in SHARED_INPUTS))
_OUTPUTS = tuple((f"fin{k}.{name}", unit) for k in FINS for name, unit in OUTPUTS)
_FLAGS = tuple(f"fin{k}.{FLAG}" for k in FINS)


def write_archive(path: Path, fmu: Path) -> Path:
    """Write an archive of four times the single actuator `fmu`, with a VARIANT for the rocket, and return its path.

    In the variant the actuators' parts have weight, and the hinges their position. Raises EmcasError if the FMU cannot
    be used.
    """
    changes = path.with_suffix(".toml")
    changes.write_text(f"[every_fin.loads]\ngravity = true\n[every_fin.mounting]\nstation = '{STATION} m'\n",
                       encoding="utf-8")
    return write_ssp(path, fmu, fins=len(AZIMUTHS), layout="cross", variant_files={VARIANT: changes}).path


class InMaster:
    """Four fins of an archive, stepped by one of MASTERS with a fixed step."""

    def __init__(self, ssp: Path, master: str, step: float, variant: str = NOMINAL,
                 bus_voltage: float | None = None) -> None:
        """Start `variant` with a `step` [s], and with `bus_voltage` [V] or the variant's start value of the supply.

        Raises EmcasError if the master is unknown, not installed or refuses; and, with the connection's name, if the
        archive's fins lack a connector or have one in another unit.
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
        """Return the outputs at the end of a step of the master. Raises EmcasError if `step` [s] has changed."""
        if abs(step - self._system.step_size) > 1e-12:
            raise EmcasError(f"{self._ssp}: was opened with steps of {self._system.step_size:g} s, not {step:g} s")
        flat = flattened(demand)
        for _, name, _, index in _INPUTS:
            self._system.set(name, float(flat[index]))
        self._system.set(self._line, self._supply)  # a master may ignore the variant's start value
        self._system.step()
        reals = np.array([self._system.get(name) for name, _ in _OUTPUTS]).reshape(len(FINS), -1)
        flags = np.array([self._system.get(name) for name in _FLAGS], dtype=bool)
        power = float(reals[:, 2].sum())
        return Response(reals[:, 0], reals[:, 1], power, flags,
                        **on_line(self._line, self._supply, power))

    def close(self) -> None:
        """End the master's system."""
        self._system.close()


def _line(structure: SystemStructure) -> str:
    return line_of({name for fin, name in structure.connectors if fin}) or VOLTAGE


def _checked(ssp: Path, variant: str) -> SystemStructure:
    """Return the variant's structure. Raises SspError if a connector is missing or has another unit."""
    structure = read_variant(ssp, variant)
    connectors = {f"{fin}.{name}": connector for (fin, name), connector in structure.connectors.items() if fin}
    supply = _line(structure)
    required = [*((f"{origin} -> {name}", name, "input", unit) for origin, name, unit, _ in _INPUTS),
                *((f"source -> fin{k}.{supply}", f"fin{k}.{supply}", "input", LINES[supply][0][1]) for k in FINS),
                *((f"{name} -> rocket", name, "output", unit) for name, unit in _OUTPUTS),
                *((f"{name} -> figures", name, "output", "") for name in _FLAGS)]
    for connection, name, kind, unit in required:
        connector = connectors.get(name)
        if connector is None or connector.kind != kind:
            raise SspError(f"{ssp}: connection {connection}: the system has no {kind} {name}; write an archive with "
                           "`emcas ssp`")
        if connector.unit not in ("", unit):  # a connector without a unit has the FMU's, which `check` compares
            raise SspError(f"{ssp}: connection {connection}: {name} is in {connector.unit}, not {unit or 'no unit'}; "
                           "declare the unit of the FMU")
    return structure


@dataclass(frozen=True)
class Agreement:
    """Largest differences of fin angles [rad] and attitude [rad] between the flights in two masters.

    `identical` says whether all columns are equal to the last bit.
    """

    fins: float
    attitude: float
    identical: bool


def agreement(flight: Mapping[str, Array], other: Mapping[str, Array]) -> Agreement:
    """Return the agreement of two flights with equal numbers of rows."""
    def difference(names: list[str]) -> float:
        return float(max(np.abs(flight[n] - other[n]).max() for n in names))

    return Agreement(difference([f"fin{k}_rad" for k in FINS]),
                     difference([f"{n}_rad" for n in ("roll", "pitch", "yaw")]),
                     all(np.array_equal(column, other[name]) for name, column in flight.items()))
