"""libcosim as the host, through libcosimpy, with its SSP reader and its fixed-step algorithm.

libcosim applies the first parameter set of each component, and no parameter set of the system.
"""

from __future__ import annotations

from collections import defaultdict
from pathlib import Path

from libcosimpy.CosimEnums import CosimExecutionState, CosimVariableType
from libcosimpy.CosimExecution import CosimExecution
from libcosimpy.CosimLogging import CosimLogLevel, log_output_level
from libcosimpy.CosimManipulator import CosimManipulator
from libcosimpy.CosimObserver import CosimObserver

from emcas_fmu.parameters import Scalar
from emcas_fmu.ssp.archive import SspError
from emcas_fmu.ssp.structure import SystemStructure

from .hosts import End, System

_ACCESS: dict[CosimVariableType, tuple[str, type[Scalar]]] = {
    CosimVariableType.BOOLEAN: ("boolean", bool), CosimVariableType.INTEGER: ("integer", int)}


class Running(System):
    """An override manipulator sets inputs between steps; a last-value observer reads outputs."""

    def __init__(self, structure: SystemStructure, step: float, path: Path) -> None:
        super().__init__(structure, step)
        nanoseconds = round(step * 1e9)
        if nanoseconds < 1:
            raise SspError(f"step {step} s: libcosim needs at least 1 ns")
        log_output_level(CosimLogLevel.ERROR)
        try:
            execution = CosimExecution.from_ssp_file(str(path), nanoseconds)
        except AssertionError as error:
            raise SspError(f"{error} (its log says why)") from error
        self._execution = execution
        self._observer, self._manipulator = CosimObserver.create_last_value(), CosimManipulator.create_override()
        if not execution.add_observer(self._observer) or not execution.add_manipulator(self._manipulator):
            raise SspError("observer and manipulator cannot be added")
        self._index = {slave.name.decode(): slave.index for slave in execution.slave_infos()}
        self._variables = {(name, v.name.decode()): (v.reference, CosimVariableType(v.type))
                           for name, index in self._index.items() for v in execution.slave_variables(index)}
        self._withheld = {name: "libcosim has no enumerations; read another output, or use fmpy"
                          for name, end in self._outputs.items() if end not in self._variables}

    def _advance(self, pending: dict[End, Scalar]) -> None:
        values_of: dict[tuple[str, CosimVariableType], dict[int, Scalar]] = defaultdict(dict)
        for end, value in pending.items():
            reference, kind = self._variables[end]
            values_of[end[0], kind][reference] = value
        for (name, kind), values in values_of.items():
            word, convert = _ACCESS.get(kind, ("real", float))
            getattr(self._manipulator, f"slave_{word}_values")(self._index[name], list(values),
                                                               [convert(v) for v in values.values()])
        self._execution.step()  # before version 0.0.6 its result means nothing: the status is read instead
        if self._execution.status().state == CosimExecutionState.ERROR.value:
            raise SspError(f"libcosim: step from {self.time:.9g} s failed (its log says why)")

    def _read(self, component: str, variable: str) -> Scalar:
        reference, kind = self._variables[component, variable]
        word, convert = _ACCESS.get(kind, ("real", float))
        return convert(getattr(self._observer, f"last_{word}_values")(self._index[component], [reference])[0])

    def _free(self) -> None:
        del self._execution
