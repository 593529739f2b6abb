"""fmpy as the host: its SSP reader and its FMUs, stepped in turn; fmpy's simulate_ssp cannot be used in a loop."""

from __future__ import annotations

import shutil
from contextlib import suppress
from pathlib import Path

import fmpy
from fmpy.ssp.simulation import free_fmu, get_value, instantiate_fmu, set_value
from fmpy.ssp.ssd import Parameter, ParameterSet, find_components, read_ssd

from emcas_fmu.parameters import Scalar
from emcas_fmu.ssp.archive import SspError
from emcas_fmu.ssp.structure import SystemStructure

from .hosts import End, System


class Running(System):
    """In each step all outputs are written to the connected inputs, then every component steps."""

    def __init__(self, structure: SystemStructure, step: float, path: Path) -> None:
        super().__init__(structure, step)
        # fmpy applies only parameters that are passed by hierarchical names.
        parameters = [Parameter(name=f"{component}.{name}", value=value)
                      for (component, name), value in structure.values.items() if component]
        self._components = {}
        self._folder = fmpy.extract(str(path))
        try:
            for component in find_components(read_ssd(str(path)).system):
                self._components[component.name] = component
                component.fmu = None
                instantiate_fmu(component, self._folder, 0.0, None, ParameterSet(parameters=parameters))
        except Exception as error:
            self.close()
            raise SspError(f"the system cannot be started: {error}") from error

    def _advance(self, pending: dict[End, Scalar]) -> None:
        try:
            # Before the step: after it, outputs that depend directly on an input would be those of the next step.
            wired = {end: get_value(self._components[start], output) for (start, output), end in self._inner}
            for (name, variable), value in (pending | wired).items():
                set_value(self._components[name], variable, value)
            for component in self._components.values():
                component.fmu.doStep(self.time, self.step_size)
        except Exception as error:
            raise SspError(f"fmpy: step from {self.time:.9g} s: {error}") from error

    def _read(self, component: str, variable: str) -> Scalar:
        value: Scalar = get_value(self._components[component], variable)
        return value

    def _free(self) -> None:
        for component in self._components.values():
            with suppress(Exception):  # fails for an FMU that has refused or is not instantiated
                free_fmu(component)
        shutil.rmtree(self._folder, ignore_errors=True)
