"""The slave of several fins. Standard library and pythonfmu's base class only: it is embedded in the FMU."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import isfinite, nan
from typing import Any, ClassVar

from ..consistency import check_consistency
from ..kernels.bank import Bank, mixes
from ..kernels.core import Functions
from .slave import Slave

# Of the variable table's inputs, those a core takes besides the specific force.
_COMMAND, _TORQUE, _SUPPLY, _ENABLE = "fin_command", "aero_torque", "supply_voltage", "enable"


class FinsSlave(Slave):
    """Base of the generated slave class, which adds the fins' `places` and the names of one fin's parameters."""

    places: ClassVar[tuple[tuple[int, ...], ...]]
    names: ClassVar[tuple[str, ...]]
    supply_power: ClassVar[int]  # its place among a fin's outputs
    _mixing: ClassVar[list[int]]
    _each: ClassVar[list[list[int]]]  # command, torque, supply, enable and own inputs of each fin
    _first: ClassVar[int]

    @classmethod
    def _place_inputs(cls) -> None:
        cls._mixing = [cls._index[name] for name in ("roll_command", "pitch_command", "yaw_command")]
        cls._each = []
        for row in cls.places:
            place = {cls.table.rows[i][0].rpartition("].")[2]: i for i in row}
            cls._each.append([place[name] for name in (_COMMAND, _TORQUE, _SUPPLY, _ENABLE, *cls.own)])
        cls._first = len(cls.table.rows) - len(cls.places) * len(cls.names)

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self._mixes: list[Any] = []
        self._forces: list[tuple[float, float]] = []

    def _fins(self, values: Mapping[str, Any]) -> list[dict[str, Any]]:
        """Each fin's parameters under their own names."""
        owned = list(values.values())[-len(self.places) * len(self.names):]
        return [dict(zip(self.names, owned[k * len(self.names):(k + 1) * len(self.names)], strict=True))
                for k in range(len(self.places))]

    def _bound_functions(self, values: Mapping[str, Any]) -> Sequence[Functions]:
        functions = [type(self).make(own) for own in self._fins(values)]
        self._mixes = mixes(functions)
        return functions

    def _made(self, values: Mapping[str, Any]) -> Any:
        return Bank(self._bound_functions(values), values["bus.source_resistance"], values["bus.update_time"],
                    self.supply_power, *self.sizes)

    def _rebind(self, core: Any, values: Mapping[str, Any]) -> None:
        core.bind(self._bound_functions(values))

    def _inconsistencies(self, values: Mapping[str, Any]) -> list[str]:
        return [f"fin[{k}]: {problem}" for k, own in enumerate(self._fins(values), 1)
                for problem in check_consistency(own)]

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
        found = []
        for mix, force, (command, *direct) in zip(self._mixes, self._forces, self._each, strict=True):
            (mixed,) = mix(values[command], *mixing)
            torque, *rest = map(values.__getitem__, direct)
            found.append((mixed, torque, *force, *rest))
        return tuple(found)
