"""Faults that an actuator declares for its kind: while one is active, parameters of the plant have other values.

The extension ``faults`` (:mod:`emcas_fmu.extensions.faults`) offers them in addition to the general faults.
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
"""Parameters of every fault, in addition to its amounts."""


@dataclass(frozen=True)
class PlantFault:
    """A fault of an actuator's kind, with the parameters ``fault.NAME.active``, ``.begin``, ``.end`` and its amounts.

    `changes(ops, p, amounts)` returns the plant's parameters that change while the fault is active, by their dotted
    names, arrays as tuples. `p` contains the changes by active faults declared before this one; ``amounts.X`` is the
    parameter ``fault.NAME.X``. A `lasting` fault stays active until reset; if it `grows`, its amounts do not fall
    until then. A fault with the name of a general fault replaces the general fault. Raises EmcasError for a name that a
    parameter cannot have.
    """

    name: str
    description: str
    changes: Callable[[Ops, Any, Any], Mapping[str, Value]]
    amounts: tuple[Variable, ...] = ()
    lasting: bool = False
    grows: bool = False

    @classmethod
    def scaling(cls, name: str, description: str, amount: Variable, *parameters: str, lasting: bool = False
                ) -> PlantFault:
        """Return a fault that multiplies `parameters`, dotted names, by its `amount`; arrays element by element.

        Its `changes` raise AttributeError for a parameter that the actuator does not have.
        """
        return cls(name, description, lambda ops, p, amounts: scaled(p, getattr(amounts, amount.name), *parameters),
                   (amount,), lasting)

    def __post_init__(self) -> None:
        for name in (self.name, *(v.name for v in self.amounts)):
            if not (name.isidentifier() and name.isascii()) or keyword.iskeyword(name):
                raise EmcasError(f"fault {self.name!r}: {name!r} is not a Python identifier in ASCII such as leakage, "
                                 "or is a keyword; rename it")
        if reserved := [v.name for v in self.amounts if v.name in SCHEDULE]:
            raise EmcasError(f"fault {self.name}: every fault has a parameter {reserved[0]}; give the amount another "
                             "name")


def scaled(p: Any, factor: Value, *names: str) -> Mapping[str, Value]:
    """Return `factor` times the parameters with these dotted names; arrays element by element."""
    values = {name: value_of(p, name) for name in names}
    return {name: tuple(factor * x for x in value) if isinstance(value, tuple) else factor * value
            for name, value in values.items()}


def check_names(actuator: str, faults: Iterable[PlantFault]) -> None:
    """Raise EmcasError if two faults have the same name; `actuator` is the actuator's name, for the message."""
    names = [fault.name for fault in faults]
    if twice := [name for name in names if names.count(name) > 1]:
        raise EmcasError(f"actuator {actuator}: fault {twice[0]} is declared twice; rename or remove one")
