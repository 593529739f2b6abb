"""What an actuator declares of the faults of its kind: parameters of the plant that are others while one acts.

The extension ``faults`` (:mod:`emcas_fmu.extensions.faults`) offers them beside those that every actuator has.
"""

from __future__ import annotations

import keyword
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from ..errors import EmcasError
from ..ops.base import Ops, Value
from ..variables import Variable

SCHEDULE = ("active", "begin", "end")


@dataclass(frozen=True)
class PlantFault:
    """One fault of an actuator's kind: ``fault.NAME.active``, ``.begin``, ``.end``, and a parameter for each amount.

    `changes(ops, p, amounts)` gives the plant's parameters that are others while it acts, by their dotted names, an
    array as a tuple; `p` has them under the faults that are declared before it, ``amounts.X`` is fault.NAME.X. A
    `lasting` one does not heal: it acts until reset. One with the name of a general fault takes that one's place.
    """

    name: str
    description: str
    changes: Callable[[Ops, Any, Any], Mapping[str, Value]]
    amounts: tuple[Variable, ...] = ()
    lasting: bool = False

    def __post_init__(self) -> None:
        for name in (self.name, *(v.name for v in self.amounts)):
            if not (name.isidentifier() and name.isascii()) or keyword.iskeyword(name):
                raise EmcasError(f"fault {self.name!r}: {name!r} is no Python identifier, such as leakage; give the "
                                 "fault and its amounts such names")
        if taken := [v.name for v in self.amounts if v.name in SCHEDULE]:
            raise EmcasError(f"fault {self.name}: {taken[0]} is of its schedule; give the amount another name")


def check_names(actuator: str, faults: Iterable[PlantFault]) -> None:
    """Raise EmcasError where an actuator of this name declares a fault twice."""
    names = [fault.name for fault in faults]
    if twice := [name for name in names if names.count(name) > 1]:
        raise EmcasError(f"actuator {actuator}: fault {twice[0]} is declared twice; faults have names of their own")
