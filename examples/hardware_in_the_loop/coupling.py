"""Coupling of two halves of an actuator: FMUs in fmpy, or objects with the same two methods, such as a real drive.

    with Half(Path("controller.fmu")) as controllers, Half(Path("plant.fmu")) as plant:
        response = coupled(controllers, plant, 0.3, inputs={"fin_command": lambda t: 0.1})

Signals have the same names in both halves. In each step the controllers are first: their sample at t reads the plant's
outputs at t, and the reference acts on the plant from t on. The trajectory is then that of the whole actuator.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Protocol

import fmpy
import numpy as np
from numpy.typing import NDArray

Signals = Mapping[str, float]


class Stepped(Protocol):
    """A half, in software or in hardware."""

    def signals(self) -> Signals:
        """Return the present outputs by name."""

    def step(self, time: float, size: float, inputs: Signals) -> None:
        """Advance from `time` by `size` [s]; `inputs` that the half does not have are ignored."""


class Half:
    """An FMU (FMI 2.0), as a context manager; `starts` are parameters by name in SI."""

    def __init__(self, path: Path, starts: Signals | None = None) -> None:
        description = fmpy.read_model_description(str(path))
        self._folder = fmpy.extract(str(path))
        self._fmu = fmpy.instantiate_fmu(self._folder, description, "CoSimulation")
        self._inputs, self._outputs, self._parameters = ({
            v.name: v for v in description.modelVariables if v.causality == causality and v.type in ("Real", "Boolean")}
            for causality in ("input", "output", "parameter"))
        self._fmu.setupExperiment()
        for name, value in (starts or {}).items():
            self._set(self._parameters[name], value)
        self._fmu.enterInitializationMode()
        self._fmu.exitInitializationMode()

    def _set(self, variable: fmpy.model_description.ScalarVariable, value: float) -> None:
        if variable.type == "Real":
            self._fmu.setReal([variable.valueReference], [value])
        else:
            self._fmu.setBoolean([variable.valueReference], [int(value)])

    def signals(self) -> Signals:
        values: dict[str, float] = {}
        for kind, get in (("Real", self._fmu.getReal), ("Boolean", self._fmu.getBoolean)):
            names = {name: v.valueReference for name, v in self._outputs.items() if v.type == kind}
            values |= dict(zip(names, map(float, get(list(names.values()))), strict=True))
        return values

    def step(self, time: float, size: float, inputs: Signals) -> None:
        for name, value in inputs.items():
            if name in self._inputs:
                self._set(self._inputs[name], value)
        self._fmu.doStep(time, size)

    def __enter__(self) -> Half:
        return self

    def __exit__(self, *_: object) -> None:
        self._fmu.terminate()
        self._fmu.freeInstance()
        shutil.rmtree(self._folder, ignore_errors=True)


def coupled(controllers: Stepped, plant: Stepped, stop: float, size: float = 1e-3,
            inputs: Mapping[str, Callable[[float], float]] | None = None, in_turn: bool = True,
            ) -> dict[str, NDArray[np.float64]]:
    """Return the plant's outputs and ``time`` every `size` [s] from 0 to `stop` [s].

    `inputs` of both halves are functions of time [s]. Without `in_turn` both halves step at once: the reference reaches
    the plant a communication step later, as in a master that transfers signals only between steps.
    """
    rows = [plant.signals()]
    for k in range(round(stop / size)):
        time = k * size
        external = {name: float(value(time)) for name, value in (inputs or {}).items()}
        before = controllers.signals()
        controllers.step(time, size, {**external, **plant.signals()})
        plant.step(time, size, {**external, **(controllers.signals() if in_turn else before)})
        rows.append(plant.signals())
    return {"time": np.arange(len(rows)) * size, **{name: np.array([row[name] for row in rows]) for name in rows[0]}}
