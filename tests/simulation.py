"""Run the kernel directly, call by call."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from emcas_fmu.actuators import NONLINEAR, fin_port, get
from emcas_fmu.actuators.declaration import PlantInputs
from emcas_fmu.namespace import namespace
from emcas_fmu.physics.loads import LOADS, NONE
from emcas_fmu.runtime import codegen
from emcas_fmu.runtime.batch import Batch
from emcas_fmu.runtime.codegen import inputs_at_rest
from emcas_fmu.runtime.compiled import parameter_row
from emcas_fmu.runtime.core import Core, Inputs
from emcas_fmu.simulation import simulate
from tests.default_actuator import OUTPUTS

__all__ = ["NAMES", "CompiledCore", "acting", "inputs_at_rest", "nested", "new_core", "ramped_core", "simulate"]
NAMES = [v.name for v in OUTPUTS]


def new_core(values: Mapping[str, Any]) -> Core:
    """Return a core of the default actuator at its start."""
    return codegen.core(values)


Ramp = tuple[float, tuple[float, ...]]


class RampedCore(Core):
    """A core whose inputs may ramp, as in core.h: a tick uses the inputs at its middle, a sample those at its time.

    A ramp is its begin [s] and the rates of change of the inputs before ``enable`` and of the further acting inputs.
    """

    _ramp: Ramp | None = None
    _time = 0.0

    def run(self, end: float, inputs: Inputs, ramp: Ramp | None = None) -> tuple[Any, ...]:
        self._ramp, self._end, self._held = ramp, end, inputs
        return super().run(end, inputs)

    def outputs(self, inputs: Inputs) -> tuple[Any, ...]:
        return super().outputs(inputs if self._ramp is None else self._at(self._end))

    def _tick(self, inputs: Inputs, until: float, whole: bool) -> None:
        length, before, _, arrival, h_before, h_after, *_ = self.schedule
        position, covered = self._position, 0.0 if self._part is None else self._part[1]
        within = position * h_before if position < before else arrival + (position - before) * h_after
        self._begun = self._period * length + within
        super()._tick(self._at(self._begun + 0.5 * (until + covered)), until, whole)

    def _sample(self, inputs: Inputs) -> None:
        super()._sample(self._at(self._begun))

    def _at(self, time: float) -> Inputs:
        """Return the inputs at a time [s] of the ramp."""
        if self._ramp is None:
            return self._held
        begin, rates = self._ramp
        enable = self._supply + 1
        before, acting, further = (self._held[part] for part in (
            slice(0, enable), slice(enable + 1, self._acting.stop), slice(self._acting.stop, None)))
        changed = [x + rate * (time - begin) for x, rate in zip((*before, *acting), rates, strict=True)]
        return (*changed[:enable], self._held[enable], *changed[enable:], *further)


def ramped_core(values: Mapping[str, Any], model: str = NONLINEAR) -> RampedCore:
    """Return a core at its start, whose inputs may ramp."""
    return RampedCore(codegen.bound_functions(values, model), codegen.sizes(get(model)))


class CompiledCore:
    """A core in machine code: a batch of one, whose inputs contain no loads from the vehicle's motion."""

    def __init__(self, values: Mapping[str, Any], model: str = NONLINEAR) -> None:
        self._batch = Batch(parameter_row(values, model)[np.newaxis], 1, model, lanes=1)
        self._supplied = get(model).supply is not None

    def run(self, end: float, inputs: Inputs) -> tuple[Any, ...]:
        command, load, *motion_loads = inputs[:1 + len(LOADS)]
        supply, *others = inputs[1 + len(LOADS):]
        assert not any(motion_loads)
        row = (command, load, *(0.0 for _ in fin_port.VEHICLE_MOTION), *([supply] if self._supplied else ()), *others)
        for index, value in enumerate(row):
            self._batch.hold(index, value)
        return tuple(self._batch.run(end)[:, 0].tolist())


def acting(reference: float = 0.0, supply: float = 39.0, enabled: bool = True) -> PlantInputs:
    """Return an electromechanical plant's inputs for a step: the drive's reference [V], the supply [V] and no load."""
    return PlantInputs(reference=reference, **vars(NONE), supply=supply, enabled=enabled, rated_current_limit=None)


def nested(values: Mapping[str, Any], model: str, **structure: Any) -> Any:
    """Return parameters as a model's equations read them, with changes of its structure."""
    return namespace(values, replace(get(model).structure, **structure))
