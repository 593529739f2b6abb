"""Ecos as the host, through ecospy, with its SSP reader and its fixed-step algorithm.

Ecos applies the components' parameter sets with the one name that is passed at initialization; without it, none.
"""

from __future__ import annotations

import zipfile
from math import isclose
from pathlib import Path

from ecospy import EcosSimulation

from emcas_fmu.parameters import Scalar
from emcas_fmu.ssp.archive import SspError
from emcas_fmu.ssp.structure import SystemStructure

from .hosts import End, System

_ACCESS: dict[str, tuple[str, type[Scalar]]] = {"Boolean": ("bool", bool), "Integer": ("integer", int)}


class Running(System):
    """Inputs are set between steps; outputs are read after them."""

    def __init__(self, structure: SystemStructure, step: float, path: Path) -> None:
        super().__init__(structure, step)
        self._kinds = {end: connector.type for end, connector in structure.connectors.items()}
        self._withheld = {name: "Ecos has no enumerations; read another output, or use fmpy"
                          for name, end in self._outputs.items() if self._kinds.get(end) == "Enumeration"}
        names = sorted({name for component, name in structure.sets if component})
        if len(names) > 1:
            raise SspError(f"the components' parameter sets are named {', '.join(names)}; Ecos applies those of one "
                           "name only: give them the same name, or use fmpy")
        unpacked = path.with_suffix("")  # Ecos would unpack the archive itself, and not remove the files
        with zipfile.ZipFile(path) as archive:
            archive.extractall(unpacked)
        try:
            self._simulation = EcosSimulation(ssp_path=str(unpacked), step_size=step)
            started = self._simulation.init(parameter_set=names[0] if names else None)
        except Exception as error:  # ecospy raises no more specific type
            raise SspError(f"the system cannot be started: {error}") from error
        if not started:
            self.close()
            raise SspError("the system cannot be initialized (its log says why)")

    def _advance(self, pending: dict[End, Scalar]) -> None:
        for end, value in pending.items():
            kind, convert = _ACCESS.get(self._kinds[end], ("real", float))
            getattr(self._simulation, f"set_{kind}")("::".join(end), convert(value))
        before = self._simulation.get_time()
        reached = self._simulation.step()
        if not isclose(reached, before + self.step_size, abs_tol=0.5 * self.step_size):
            raise SspError(f"Ecos: step from {self.time:.9g} s failed (its log says why)")

    def _read(self, component: str, variable: str) -> Scalar:
        kind, convert = _ACCESS.get(self._kinds[component, variable], ("real", float))
        return convert(getattr(self._simulation, f"get_{kind}")(f"{component}::{variable}"))

    def _free(self) -> None:
        self._simulation.terminate()
        self._simulation.free()
