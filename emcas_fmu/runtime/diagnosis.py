"""The functions of a user's actuator over floats, not traced: slow, but errors name the line of the file."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from math import isfinite
from typing import Any

from ..actuators import get
from ..actuators.declaration import Actuator
from ..actuators.external import of_function
from ..ops.base import Value
from ..ops.floats import FLOATS, FloatOps
from ..ops.located import LocatedFloats, located
from . import codegen
from .core import ROUNDED, Functions

_NEVER_0 = "divide by a value that is never 0, as in ops.where(ops.fabs(x) > 1e-9, x, 1e-9)"
# Remedies by a part of the text of the operation whose result is not finite.
_REMEDIES = {
    " / 0 =": _NEVER_0,
    " / -0 =": _NEVER_0,
    "sqrt(-": "use ops.sqrt(ops.maximum(x, 0.0))",
    "pow(-": "use ops.pow(ops.maximum(x, 0.0), y)",
    "log(": "use ops.log(ops.maximum(x, 1e-9))",
    "": "the values have grown without bound: check the signs of the equations, or lower solver.max_tick",
}


def functions(values: Mapping[str, Any], model: str, several: bool = False, actuator: Actuator | None = None,
              follow: bool = True) -> Functions:
    """Return the functions of a user's actuator, or of the changed copy `actuator`, with these parameters.

    They raise ArithmeticError with location and remedy if a result is not finite, or if a step returns a time that is
    not above 0 or exceeds h. With `follow` the location is the line of the operation. Without it the functions are
    faster, but also raise ArithmeticError or ValueError at an operation such as 1/0 whose result is not used.
    """
    actuator = actuator or get(model)
    assert actuator.source is not None
    ops: FloatOps = LocatedFloats(actuator.source) if follow else FLOATS
    number = partial(located, path=actuator.source) if follow else float
    p = actuator.namespace({name: number(value) for name, value in values.items()})
    states, controllers, sampled = ([s.name for s in each] for each in (
        actuator.states, actuator.controller_states, actuator.sampled_states))
    names = {"initial": [*states, *controllers, "measured_fin_angle", *sampled],
             "sample": ["reference", *controllers, "measured_fin_angle", "limited", *sampled],
             "step": states, "outputs": [v.name for v in actuator.outputs]}

    def checked(name: str, function: Callable[..., tuple[Value, ...]], *arguments: float) -> tuple[Value, ...]:
        results = function(ops, p, *map(number, arguments))
        for of_result, value in zip(names.get(name, ()), results, strict=False):
            if not isfinite(value):
                origin = getattr(value, "origin", "") or of_function(actuator, name)
                remedy = next(remedy for part, remedy in _REMEDIES.items() if part in origin)
                raise ArithmeticError(f"{of_result} is {value:g}: {origin}; {remedy}")
        if name == "step" and not 0.0 < (used := results[-1]) <= arguments[-1] * ROUNDED:
            raise ArithmeticError(f"{of_function(actuator, name)} returns a time of {used:g} s for h = "
                                  f"{arguments[-1]:g} s; it must be above 0, and at most h")
        return results

    return tuple(partial(checked, name, function) for name, _, function in codegen.functions(actuator, several))
