"""Connectors of the system itself, and what they are wired to."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from ..actuators import get
from ..actuators.fin_port import ENABLE
from ..fmi.interface import FmuInterface, flat
from ..variables import Variable


@dataclass(frozen=True)
class Wire:
    """A connector of the system, and the component and variable it is wired to."""

    outer: str
    fin: str
    variable: Variable


def outer_name(number: int, name: str, model: str) -> str:
    """Return the system's connector of a fin's variable, such as ``fin1_fin_angle``; ``attitude_roll``, if shared.

    All fins share vehicle motion, supply and enable. OMSimulator takes no dot in such a name, and fmpy tells a
    connector of the system from one of a component by their paths alone.
    """
    shared = (*FmuInterface(1, model).shared, ENABLE.name)
    return flat(name if name in shared else f"fin[{number}].{name}")


def wires(model: str, fins: Sequence[str]) -> Iterator[Wire]:
    """Yield the wires of all inputs and outputs of an actuator in each of the components `fins`."""
    for number, fin in enumerate(fins, 1):
        for variable in get(model).inputs + get(model).outputs:
            yield Wire(outer_name(number, variable.name, model), fin, variable)
