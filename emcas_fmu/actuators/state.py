"""States of an actuator."""

from __future__ import annotations

import keyword
from dataclasses import dataclass, field

from ..errors import EmcasError
from ..namespace import Record


@dataclass(frozen=True)
class State:
    """A state by name, a Python identifier, with its unit.

    A state that samples set has the value `start` in a plant without controllers, until a host sets it.
    """

    name: str
    unit: str = ""
    description: str = ""
    start: float = field(default=0.0, repr=False)

    def __post_init__(self) -> None:
        if not (self.name.isidentifier() and self.name.isascii()) or keyword.iskeyword(self.name):
            raise EmcasError(f"state {self.name!r}: a state's name is a Python identifier, such as fin_rate")
        if hasattr(Record, self.name):
            raise EmcasError(f"state {self.name!r}: is the name of a method of x; give it another name")


FIN = (State("fin_angle", "rad"), State("fin_rate", "rad/s"))
"""The states of the fin."""
