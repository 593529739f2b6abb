"""The slave of several fins. Standard library and pythonfmu's base class only: it is embedded in the FMU."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import isfinite, nan
from typing import Any, ClassVar

from ...runtime.core import Functions
from ...runtime.multi_fin import MultiFin, mixes
from .slave import Slave


class MultiFinSlave(Slave):
    """Base of the generated slave class, which adds the names of one fin's parameters.

    `power` is the place of the supply's power among a fin's outputs, None of fins without a supply.
    """

    names: ClassVar[tuple[str, ...]]
    power: ClassVar[int | None]
    _mixing: ClassVar[list[int]]

    def __init_subclass__(cls, **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        cls._mixing = [cls._index[name] for name in ("roll_command", "pitch_command", "yaw_command")]

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self._mixes: list[Any] = []
        self._forces: list[tuple[float, float]] = []

    def _fins(self, values: Mapping[str, Any]) -> list[dict[str, Any]]:
        """Each fin's parameters under their own names."""
        of_fins = list(values.values())[-len(self.places) * len(self.names):]
        return [dict(zip(self.names, of_fins[k * len(self.names):(k + 1) * len(self.names)], strict=True))
                for k in range(len(self.places))]

    def _bound_functions(self, values: Mapping[str, Any]) -> Sequence[Functions]:
        functions = [type(self).make(one) for one in self._fins(values)]
        self._mixes = mixes(functions)
        return functions

    def _made(self, values: Mapping[str, Any]) -> Any:
        return MultiFin(self._bound_functions(values), values.get("bus.source_resistance", 0.0),
                    values.get("bus.update_time", 1.0), self.power, self.sizes)

    def _rebind(self, core: Any, values: Mapping[str, Any]) -> None:
        core.bind(self._bound_functions(values))

    def _inconsistencies(self, values: Mapping[str, Any]) -> list[str]:
        return [f"fin[{k}]: {problem}" for k, one in enumerate(self._fins(values), 1)
                for problem in self._broken_rules(one)]

    @staticmethod
    def _finite(inputs: tuple[Any, ...]) -> bool:
        return all(isfinite(sum(each)) for each in inputs)

    def _core_inputs(self, core: Any) -> tuple[Any, ...]:
        values = self._values
        motion = values[self._motion_slice]
        if motion != self._motion:
            known = isfinite(sum(motion))
            self._forces = [each.forces(*motion) if known else (nan, nan) for each in core.cores]
            self._motion = motion
        mixing = [values[i] for i in self._mixing]
        inputs = []
        for mix, force, (command, torque, supply, *rest) in zip(self._mixes, self._forces, self.places, strict=True):
            (mixed,) = mix(values[command], *mixing)
            inputs.append((mixed, values[torque], *force, 0.0 if supply is None else values[supply],
                           *map(values.__getitem__, rest)))
        return tuple(inputs)
