"""An actuator's equations without quantisation, as functions with exact Jacobians.

A limit stays a limit: at rest within it, it has the slope of its argument, beyond it none.

They are traced once for all values of the gains: searches and root loci change these a thousand times.
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
    """Symbols with these operations."""


class _Unlimited(_Fine):
    """The same without limits, or without those at one value."""

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
        opened = ca.SX.sym(_GAIN, len(gains))
        values = {**fixed, **dict(zip(gains, ca.vertsplit(opened), strict=True))}
        # The range of commands has no limits, since a fin at its end is at rest like any other.
        command_ops = _Unlimited(float(values["command.limit"]))
        equations = Equations(actuator, values, actuator.namespace(values), FINE, command_ops, fin_angle)
        begun = equations.start()
        self._start = ca.Function("start", [opened], [ca.vertcat(*begun)])
        self.states, self.sampled = tuple(equations.states), tuple(equations.sampled)
        count, sampled = len(self.states), len(self.sampled)
        arguments = count + 2 + sampled, opened
        self.plant = Linearised(equations.plant, *arguments)
        self._unlimited = partial(Linearised, partial(equations.plant, ops=UNLIMITED), *arguments)
        self.controllers = Linearised(equations.controllers, len(equations.kept) + count + 1, opened)
        of_plant = ca.SX(ca.vertcat(*begun[:count], *begun[len(begun) - sampled:]))
        self.plant_varies = self.plant.varies or bool(ca.depends_on(of_plant, opened))

    @cached_property
    def unlimited(self) -> Linearised:
        """The plant without limits."""
        return self._unlimited()

    def start(self, gains: Sequence[float]) -> Array:
        """Return the result of :meth:`Equations.start`."""
        begun: Array = self._start(list(gains)).full().ravel()
        return begun


def gains_of(actuator: Actuator, values: Mapping[str, Any]) -> dict[str, float]:
    """Return the controllers' gains, which a host may change during a run, by name, in SI.

    A gain of 0 is left out, together with its part of the equations.
    """
    names = [v.name for v in actuator.parameters
             if v.kind == "Real" and v.variability == "tunable" and v.name.startswith("controller.")]
    return {name: float(values[name]) for name in names if values[name]}


@lru_cache(maxsize=64)
def traced(model: str, fixed: tuple[tuple[str, Any], ...], gains: tuple[str, ...], fin_angle: float) -> Traced:
    """Return the traced equations of an actuator with a command of `fin_angle` [rad].

    `gains` are the names of the free parameters, `fixed` pairs of name and value of the others.
    """
    return Traced(get(model), dict(fixed), gains, fin_angle)
