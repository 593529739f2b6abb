"""An actuator that a rig of the thesis moves step by step."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from emcas_fmu.actuators import NONLINEAR, get
from emcas_fmu.runtime.batch import Batch
from emcas_fmu.runtime.compiled import parameter_row
from emcas_fmu.simulation import Array


class SteppedActuator:
    """An actuator that is advanced by steps of `step` [s]; inputs may depend on its outputs.

    The inputs begin with their start values. Raises ParameterError, and CompilerError if there is no compiler.
    """

    def __init__(self, values: Mapping[str, Any], step: float, model: str = NONLINEAR) -> None:
        actuator = get(model)
        self._batch = Batch(parameter_row(values, model)[np.newaxis], 1, model, lanes=1)
        self._step = step
        self._inputs = {v.name: i for i, v in enumerate(actuator.inputs)}
        self._names = tuple(v.name for v in actuator.outputs)
        self._rows: list[tuple[Any, ...]] = []
        self.run(**{v.name: v.initial(values) for v in actuator.inputs})

    def index(self, output: str) -> int:
        """Return the index of an output in `now` and in the result of `run`."""
        return self._names.index(output)

    @property
    def now(self) -> tuple[Any, ...]:
        """The outputs at the present time, in the interface's order."""
        return self._rows[-1]

    def run(self, **inputs: float) -> tuple[Any, ...]:
        """Change inputs, advance by a step, and return the outputs. Raises ArithmeticError for a result not finite."""
        for name, value in inputs.items():
            self._batch.hold(self._inputs[name], value)
        time = len(self._rows) * self._step
        try:
            self._rows.append(tuple(self._batch.run(time)[:, 0].tolist()))
        except ArithmeticError as error:
            raise ArithmeticError(f"at {time:.6g} s: {error}") from error
        return self.now

    def columns(self) -> dict[str, Array]:
        """Return the outputs of all steps by name, with ``time`` [s]."""
        table = np.array(self._rows, dtype=float)
        return {"time": np.arange(len(table)) * self._step,
                **{name: table[:, i] for i, name in enumerate(self._names)}}
