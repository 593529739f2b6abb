"""An actuator that a rig of the thesis moves step by step."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from emcas_fmu.actuators import NONLINEAR, get
from emcas_fmu.runtime import codegen, compiled, library
from emcas_fmu.simulation import Array


class SteppedUnit:
    """An actuator that is advanced by steps of `step` [s], so that inputs may depend on its outputs.

    It is compiled if possible. `inputs` are the first inputs by name, SI; the others have their start values. Raises
    ParameterError.
    """

    def __init__(self, values: Mapping[str, Any], step: float, model: str = NONLINEAR,
                 inputs: Mapping[str, float] | None = None) -> None:
        self._actuator = actuator = get(model)
        self._core: Any
        if library.available(model):
            self._core = compiled.CompiledCore(values, model)  # which checks the parameters itself
        else:
            self._core = codegen.core(values, model)
        self._step = step
        self._row = [v.initial(values) for v in actuator.inputs]
        self._inputs = {v.name: i for i, v in enumerate(actuator.inputs)}
        self._names = tuple(v.name for v in actuator.outputs)
        self._set(inputs or {})
        self._rows: list[tuple[Any, ...]] = [self._core.outputs(self._acting)]

    def _set(self, inputs: Mapping[str, float]) -> None:
        for name, value in inputs.items():
            self._row[self._inputs[name]] = value
        self._acting = codegen.core_inputs(self._core, self._row, self._actuator)

    def index(self, output: str) -> int:
        """Return the index of an output in `now` and in the result of `run`."""
        return self._names.index(output)

    @property
    def now(self) -> tuple[Any, ...]:
        """The outputs at the present time, in the interface's order."""
        return self._rows[-1]

    def run(self, **inputs: float) -> tuple[Any, ...]:
        """Return the outputs after a step, with these inputs changed. Raises ArithmeticError."""
        if inputs:
            self._set(inputs)
        time = len(self._rows) * self._step
        try:
            self._rows.append(self._core.run(time, self._acting))
        except ArithmeticError as error:
            raise ArithmeticError(f"at {time:.6g} s: {error}") from error
        return self.now

    def columns(self) -> dict[str, Array]:
        """Return all outputs up to now by name, with ``time`` [s]."""
        table = np.array(self._rows, dtype=float)
        return {"time": np.arange(len(table)) * self._step,
                **{name: table[:, i] for i, name in enumerate(self._names)}}
