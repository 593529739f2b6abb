"""Faults that an actuator declares for its kind: parameters of the plant with other values while a fault is active.

The extension ``faults`` (:mod:`emcas_fmu.extensions.faults`) offers them in addition to those of every actuator.
"""

from __future__ import annotations

import keyword
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from ..errors import EmcasError
from ..namespace import value_of
from ..ops.base import Ops, Value
from ..variables import Variable

SCHEDULE = ("active", "begin", "end")


@dataclass(frozen=True)
class PlantFault:
    """A fault of an actuator's kind: ``fault.NAME.active``, ``.begin``, ``.end``, and a parameter for each amount.

    `changes(ops, p, amounts)` returns the plant's parameters that change while the fault is active, by their dotted
    names, arrays as tuples. `p` has the changes of the faults that are declared before; ``amounts.X`` is fault.NAME.X.
    A `lasting` fault does not heal: it is active until reset. One with the name of a general fault replaces that.
    """

    name: str
    description: str
    changes: Callable[[Ops, Any, Any], Mapping[str, Value]]
    amounts: tuple[Variable, ...] = ()
    lasting: bool = False

    @classmethod
    def scaling(cls, name: str, description: str, amount: Variable, *parameters: str, lasting: bool = False
                ) -> PlantFault:
        """Return a fault that multiplies parameters by its amount."""
        def changes(ops: Ops, p: Any, amounts: Any) -> Mapping[str, Value]:
            return {parameter: getattr(amounts, amount.name) * value_of(p, parameter) for parameter in parameters}

        return cls(name, description, changes, (amount,), lasting)

    def __post_init__(self) -> None:
        for name in (self.name, *(v.name for v in self.amounts)):
            if not (name.isidentifier() and name.isascii()) or keyword.iskeyword(name):
                raise EmcasError(f"fault {self.name!r}: {name!r} is not a Python identifier such as leakage; give the "
                                 "fault and its amounts such names")
        if reserved := [v.name for v in self.amounts if v.name in SCHEDULE]:
            raise EmcasError(f"fault {self.name}: {reserved[0]} is of its schedule; give the amount another name")


def check_names(actuator: str, faults: Iterable[PlantFault]) -> None:
    """Raise EmcasError where an actuator of this name declares a fault twice."""
    names = [fault.name for fault in faults]
    if twice := [name for name in names if names.count(name) > 1]:
        raise EmcasError(f"actuator {actuator}: fault {twice[0]} is declared twice; give one of them another name")
