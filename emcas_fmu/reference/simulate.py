"""The integration of any actuator, by default the thesis's."""

from __future__ import annotations

from collections.abc import Mapping

from .actuator import Actuator
from .events import Array, Value
from .plant import Plant


def simulate(parameters: Mapping[str, Value], inputs: Mapping[str, Array], kind: type[Actuator] = Plant
             ) -> dict[str, Array]:
    """Return `time` and the outputs of a `kind` of actuator, see :meth:`.Actuator.simulate`."""
    return kind.simulate(parameters, inputs)
