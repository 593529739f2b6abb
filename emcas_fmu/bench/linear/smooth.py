"""An actuator's equations without quantisation, as functions with exact Jacobians.

A limit stays a limit: at rest within it, it has the slope of its argument, beyond it none.

They are traced once for all values of the gains: searches and root loci change these a thousand times.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property, lru_cache, partial
from math import nan
from typing import Any

import casadi as ca

from ...actuators import get
from ...actuators.declaration import Actuator, PlantInputs, SampleInputs
from ...actuators.positional import identifier
from ...namespace import Record
from ...ops.base import Value
from ...ops.floats import FLOATS
from ...ops.symbols import Linearised, SymbolOps
from ...physics import loads
from .systems import Array

OUTPUTS = ("fin_angle", "motor_angle", "motor_current", "motor_voltage")
"""The outputs of a plant that follow the rates of its states."""
_GAIN = "gain"


class _Fine(SymbolOps):
    """Symbols without quantisation, and at a limit with the slope inside it."""

    @staticmethod
    def floor(x: Value) -> Value:
        return x

    @staticmethod
    def clip(x: Value, low: Value, high: Value) -> Value:
        return SymbolOps.where(x < low, low, SymbolOps.where(x > high, high, x))


class _Unlimited(_Fine):
    """The same without limits, or without those at one value."""

    def __init__(self, limit: float | None = None) -> None:
        self._limit = limit

    def clip(self, x: Value, low: Value, high: Value) -> Value:  # type: ignore[override]  # static there
        left_out = self._limit is None or (isinstance(high, float) and high == self._limit)
        return x if left_out else _Fine.clip(x, low, high)


FINE, UNLIMITED = _Fine(), _Unlimited()


class Equations:
    """Plant and sampled controllers as functions of states and inputs.

    `p` are the parameters with the flat `values`, numbers or symbols; the command is `fin_angle` [rad]. The range of
    commands has no limits, since a fin at its end is at rest like any other.
    """

    def __init__(self, actuator: Actuator, values: Mapping[str, Any], p: Any, fin_angle: float) -> None:
        self._actuator, self._values, self._p, self._at = actuator, values, p, fin_angle
        self._command_ops = _Unlimited(float(values["command.limit"]))
        self.states = [s.name for s in actuator.states]
        self.sampled = [s.name for s in actuator.sampled_states]
        self.kept = [*(s.name for s in actuator.controller_states), *self.sampled]
        self._supply = self._started(actuator.supply.input) if actuator.supply else 0.0

    def _started(self, variable: Any) -> Any:
        return self._values[variable.key] if variable.key else variable.start or 0.0

    def start(self) -> list[Value]:
        """Return the initial values, in SI, of `states`, then of the controllers' states `kept`."""
        begun = self._actuator.start(FINE, self._p, self._at)
        inputs = self.acting(0.0, 0.0, [begun[name] for name in self.sampled])
        x = self._actuator.begun(FINE, self._p, Record(**begun), inputs)
        return [getattr(x, name) for name in (*self.states, *self.kept)]

    def acting(self, reference: Value, aero_torque: Value, sampled: Sequence[Value]) -> PlantInputs:
        """Return the inputs of the plant; those that are not arguments have their start values."""
        return PlantInputs(
            reference=reference, **vars(loads.level(FLOATS, self._p, aero_torque)), supply=self._supply, enabled=True,
            rated_current_limit=None, command=self._at, sampled_reference=reference, measured_fin_angle=self._at,
            limited=0.0, **{identifier(v.name): self._started(v) for v in self._actuator.acting_inputs},
            **dict(zip(self.sampled, sampled, strict=True)))

    def plant(self, *arguments: Value, ops: Any = FINE) -> list[Value]:
        """Return the states' rates and OUTPUTS; with UNLIMITED as `ops` those without limits.

        `arguments` are the states, the reference, the hinge moment [N.m] and the sampled states.
        """
        x = Record(**dict(zip(self.states, arguments, strict=False)))
        reference, aero_torque, *sampled = arguments[len(self.states):]
        u = self.acting(reference, aero_torque, sampled)
        outputs = self._actuator.output_values(ops, self._p, x, u)
        return [*self._actuator.rates(ops, self._p, x, u).values(), *(outputs.get(name, nan) for name in OUTPUTS)]

    def controllers(self, *arguments: Value) -> list[Value]:
        """Return controller states after a sample, the reference, the measured angle [rad] and the sampled states.

        `arguments` are the controllers' states before the sample, the plant's states and the command [rad].
        """
        *values, command = arguments
        ops = self._command_ops
        state = Record(**dict(zip((*self.kept, *self.states), values, strict=True)))
        inputs = SampleInputs(
            command=command, position=self._actuator.position(ops, self._p, state), supply=self._supply, enable=True,
            **{identifier(v.name): self._started(v) for v in self._actuator.further_inputs})
        after = self._actuator.commanded(ops, self._p, state, inputs)
        return [after[name] for name in (*self.kept, "reference", "measured_fin_angle", *self.sampled)]


class Traced:
    """The equations' values and Jacobians for any values of `gains`.

    ``plant_varies`` says whether the plant depends on the gains.
    """

    def __init__(self, actuator: Actuator, fixed: Mapping[str, Any], gains: Sequence[str], fin_angle: float) -> None:
        opened = ca.SX.sym(_GAIN, len(gains))
        values = {**fixed, **dict(zip(gains, ca.vertsplit(opened), strict=True))}
        equations = Equations(actuator, values, actuator.namespace(values), fin_angle)
        begun = equations.start()
        self._start = ca.Function("start", [opened], [ca.vertcat(*begun)])
        self.states, self.sampled = tuple(equations.states), tuple(equations.sampled)
        count, sampled = len(self.states), len(self.sampled)
        self.plant = Linearised(equations.plant, count + 2 + sampled, opened)
        self._unlimited = partial(Linearised, partial(equations.plant, ops=UNLIMITED), count + 2 + sampled, opened)
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
