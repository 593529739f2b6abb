"""Run four fins in the Python and the native FMU with the same inputs, and compare step by step."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from emcas_fmu.fmi.interface import FmuInterface, fin_sets
from emcas_fmu.parameters import load_parameters

from .built import slave_class
from .host import OK, Fmu, Instance


class Lockstep:
    """A model's Python and native FMU, both initialized with the same values; `unit` is the native instance."""

    def __init__(self, model: str, native: Fmu, values: Mapping[str, float]) -> None:
        self._four = FmuInterface(4, model)
        sets = [each.values for each in fin_sets(load_parameters(model=model), 4, "cross", {})]
        self._python: Any = slave_class(self._four, sets)(instance_name="fins")
        self.unit = Instance(native)
        self._real = [v.name for v in self._four.outputs if v.kind == "Real"]
        self._rng, self._time = np.random.default_rng(11), 0.0
        self._python.setup_experiment(0.0)
        self._python.enter_initialization_mode()
        assert [self.unit.setup(), self.unit.enter()] == [OK, OK]
        for name, value in values.items():
            self._put(name, value)
        self._python.exit_initialization_mode()
        assert self.unit.call("ExitInitializationMode") == OK

    def _put(self, name: str, value: float) -> None:
        self._python.set_real([self._four.reference[name]], [value])
        assert self.unit.set(name, value) == OK

    def run(self, changes: int, supply: str, least: float, most: float) -> Iterator[None]:
        """Step with changing commands and supply, and assert that the outputs have the same bits.

        The states are restored once, so that both step sizes begin at the same state; yield after each step size.
        """
        for _ in range(changes):
            self._put(f"fin[{self._rng.integers(1, 5)}].fin_command", self._rng.uniform(-0.4, 0.4))
            self._put(supply, self._rng.uniform(least, most))
            python, unit, begin = self._python._get_fmu_state(), self.unit.serialize(self.unit.save()), self._time
            for size in (1e-3, 3.7e-4):
                self._python._set_fmu_state(python)
                assert self.unit.restore(unit) == OK
                self._time = begin
                for _ in range(8):
                    assert self._python.do_step(self._time, size)
                    assert self.unit.step(self._time, size) == OK
                    self._time += size
                assert self._python.get_real([self._four.reference[name] for name in self._real]) == [
                    self.unit.get(name) for name in self._real]
                yield
