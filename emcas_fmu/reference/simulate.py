"""Integration of any actuator class, by default the thesis's."""

from __future__ import annotations

from collections.abc import Mapping

from .actuator import Actuator
from .events import Array, Value
from .plant import Plant


def simulate(parameters: Mapping[str, Value], inputs: Mapping[str, Array], kind: type[Actuator] = Plant
             ) -> dict[str, Array]:
    """Return `time` [s] and the outputs [SI] of the actuator class `kind`; see :meth:`.Actuator.simulate`."""
    return kind.simulate(parameters, inputs)
