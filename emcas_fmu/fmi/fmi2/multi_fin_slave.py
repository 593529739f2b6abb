"""The slave of several fins. Standard library and pythonfmu's base class only: it is embedded in the FMU."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import isfinite
from typing import Any, ClassVar

from ...runtime.core import Functions, inputs_of
from ...runtime.multi_fin import MultiFin
from .slave import Slave


class MultiFinSlave(Slave):
    """Base of the generated slave class of several fins.

    The generated class adds the names of one fin's parameters, the value references of each fin's inputs and of the
    mixing inputs, the prefix of a fin's messages, and the initial state of the supply's line. The line's parameters
    come before those of the fins.
    """

    names: ClassVar[tuple[str, ...]]
    fin_inputs: ClassVar[tuple[tuple[int, ...], ...]]
    mixing: ClassVar[tuple[int, ...]]
    of_fin: ClassVar[str]
    line_start: ClassVar[float]

    def __init_subclass__(cls, **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        cls._unknown = [cls._unknown] * len(cls.fin_inputs)

    def _fins(self, values: Mapping[str, Any]) -> Mapping[str, Mapping[str, Any]]:
        count, fins = len(self.names), len(self.fin_inputs)
        of_fins = list(values.values())[-fins * count:]
        return {f"{self.of_fin % (fin + 1)}: ":
                dict(zip(self.names, of_fins[fin * count:(fin + 1) * count], strict=True)) for fin in range(fins)}

    def _functions(self, values: Mapping[str, Any]) -> Sequence[Functions]:
        return [type(self).make(one) for one in self._fins(values).values()]

    def _made(self, values: Mapping[str, Any]) -> Any:
        line = list(values.values())[:len(values) - len(self.fin_inputs) * len(self.names)]
        return MultiFin(self._functions(values), line, self.line_start, self.power, self._core_sizes)

    def _acting(self, core: Any) -> tuple[Any, ...]:
        values = self._values
        rows = [[values[i] for i in indices] for indices in self.fin_inputs]
        return core.acting(rows, self._motion_loads, [values[i] for i in self.mixing])  # type: ignore[no-any-return]

    def _shape_of_inputs(self) -> tuple[Any, ...]:
        return inputs_of((0.0,) * len(self.fin_inputs[0]), self._unknown[0], self._core_sizes.motion,
                         self.power is not None)

    @staticmethod
    def _finite(inputs: tuple[Any, ...]) -> bool:
        return all(isfinite(sum(each)) for each in inputs)
