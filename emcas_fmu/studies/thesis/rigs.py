"""What the two rigs share: their numbers in models/rigs.toml, and the actuator moved on step by step under them.

Both rigs act on the product's own actuator through its hinge moment: a torque T on the screw is the moment R T about
the hinge, by virtual work.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np

from ...actuators import NONLINEAR, get
from ...files import models_directory
from ...runtime import codegen
from ...simulation import Array, stepped
from ...toml import tomllib

Columns = Mapping[str, Array]


class RigEntry(NamedTuple):
    """A number of a rig: its value in `unit`, which is SI, where it is from and why."""

    value: float
    unit: str
    source: str
    note: str


@cache
def rig_entries(rig: str) -> Mapping[str, RigEntry]:
    """Return the numbers of a rig by name, from models/rigs.toml."""
    document = tomllib.loads((models_directory() / "rigs.toml").read_text(encoding="utf-8"))
    return {name: RigEntry(float(entry["value"]), entry["unit"], entry["source"], entry["note"])
            for name, entry in document[rig].items()}


def rig_values(rig: str) -> Any:
    """Return the numbers of a rig as attributes, SI."""
    return SimpleNamespace(**{name: entry.value for name, entry in rig_entries(rig).items()})


class Unit:
    """The nonlinear actuator, moved on by steps of `step` [s] under inputs that are given for each."""

    def __init__(self, values: Mapping[str, Any], step: float) -> None:
        actuator = get(NONLINEAR)
        self._core, self._step, self._time = stepped(values), step, 0
        self._row = [v.initial(values) for v in actuator.inputs]
        self._inputs = {v.name: i for i, v in enumerate(actuator.inputs)}
        self._names = tuple(v.name for v in actuator.outputs)
        self._rows: list[tuple[Any, ...]] = [self._core.outputs(self._acting({}))]

    def _acting(self, inputs: Mapping[str, float]) -> Any:
        for name, value in inputs.items():
            self._row[self._inputs[name]] = value
        return codegen.core_inputs(self._core, self._row)

    def place(self, output: str) -> int:
        """Return where an output stands in what `now` and `run` give."""
        return self._names.index(output)

    @property
    def now(self) -> tuple[Any, ...]:
        """The outputs at the present time."""
        return self._rows[-1]

    def run(self, **inputs: float) -> tuple[Any, ...]:
        """Return the outputs a step later; inputs that are not given stay as they were."""
        self._time += 1
        self._rows.append(self._core.run(self._time * self._step, self._acting(inputs)))
        return self.now

    def columns(self) -> dict[str, Array]:
        """Return all outputs so far by name, with ``time`` [s]."""
        table = np.array(self._rows, dtype=float)
        return {"time": np.arange(len(table)) * self._step,
                **{name: table[:, i] for i, name in enumerate(self._names)}}
