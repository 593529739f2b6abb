"""An actuator's equations without quantisation, as functions with exact Jacobians.

Limits remain: within a limit the slope is that of the argument, beyond it 0. The equations are traced once for all
values of the gains, which searches and root loci change a thousand times.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property, lru_cache, partial
from typing import Any

import casadi as ca

from ...actuators import get
from ...actuators.declaration import Actuator
from ...ops.base import Value
from ...ops.symbols import Linearised, SymbolOps
from .equations import Equations, Unquantised
from .systems import Array

_GAIN = "gain"


class _Fine(Unquantised, SymbolOps):
    """Symbolic operations without quantisation, with Jacobians."""


class _Unlimited(_Fine):
    """The same operations without `clip`; with a `limit`, only without each clip whose upper value is this number."""

    def __init__(self, limit: float | None = None) -> None:
        self._limit = limit

    def clip(self, x: Value, low: Value, high: Value) -> Value:  # type: ignore[override]  # static there
        left_out = self._limit is None or (isinstance(high, float) and high == self._limit)
        return x if left_out else super().clip(x, low, high)


FINE, UNLIMITED = _Fine(), _Unlimited()


class Traced:
    """The equations' values and Jacobians for any values of `gains`.

    ``plant_varies`` says whether the plant depends on the gains.
    """

    def __init__(self, actuator: Actuator, fixed: Mapping[str, Any], gains: Sequence[str], fin_angle: float) -> None:
        gain_symbols = ca.SX.sym(_GAIN, len(gains))
        values = {**fixed, **dict(zip(gains, ca.vertsplit(gain_symbols), strict=True))}
        # Commands are not limited: a fin at the end of its range rests like any other.
        command_ops = _Unlimited(float(values["command.limit"]))
        equations = Equations(actuator, values, actuator.namespace(values), FINE, command_ops, fin_angle)
        initial = equations.start()
        self._start = ca.Function("start", [gain_symbols], [ca.vertcat(*initial)])
        self.states, self.sampled = tuple(equations.states), tuple(equations.sampled)
        count, sampled = len(self.states), len(self.sampled)
        arguments = count + 2 + sampled, gain_symbols
        self.plant = Linearised(equations.plant, *arguments)
        self._unlimited = partial(Linearised, partial(equations.plant, ops=UNLIMITED), *arguments)
        self.controllers = Linearised(equations.controllers, len(equations.kept) + count + 1, gain_symbols)
        of_plant = ca.SX(ca.vertcat(*initial[:count], *initial[len(initial) - sampled:]))
        self.plant_varies = self.plant.varies or bool(ca.depends_on(of_plant, gain_symbols))

    @cached_property
    def unlimited(self) -> Linearised:
        """The plant without limits."""
        return self._unlimited()

    def start(self, gains: Sequence[float]) -> Array:
        """Return the result of :meth:`Equations.start`."""
        initial: Array = self._start(list(gains)).full().ravel()
        return initial


def gains_of(actuator: Actuator, values: Mapping[str, Any]) -> dict[str, float]:
    """Return the controllers' gains by name, in SI: their parameters that a host may change during a run.

    A gain of 0 is left out; the terms that it multiplies then disappear from the equations.
    """
    names = [v.name for v in actuator.parameters
             if v.kind == "Real" and v.variability == "tunable" and v.name.startswith("controller.")]
    return {name: float(values[name]) for name in names if values[name]}


@lru_cache(maxsize=64)
def traced(model: str, fixed: tuple[tuple[str, Any], ...], gains: tuple[str, ...], fin_angle: float) -> Traced:
    """Return the traced equations of an actuator with a command of `fin_angle` [rad].

    `gains` are the names of the free parameters, `fixed` the names and values of the others.
    """
    return Traced(get(model), dict(fixed), gains, fin_angle)
