"""Plant and sampled controllers of an actuator at rest as functions, for linear analysis."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from math import nan
from typing import Any

from ...actuators import external, get, parts
from ...actuators.declaration import Actuator, PlantInputs, SampleInputs
from ...actuators.positional import identifier
from ...errors import EmcasError
from ...namespace import Record
from ...ops.base import Value
from ...physics import loads
from ...trace.tracer import Tracer

# The controllers' command is that on the bus; the command's latency is a separate block outside all loops.
LEFT_OUT = {"compensation.gain": 0.0, "command.latency": 0.0, "command.resolution": 0.0, "command.update_time": 0.0}
"""The parameters that a linear model replaces, with the values in it."""
OUTPUTS = ("fin_angle", "motor_angle", "motor_current", "motor_voltage")
"""The outputs that `Equations.plant` returns after the rates of the states."""


class Equations:
    """Plant and sampled controllers as functions of states and inputs.

    `p` is the namespace of the parameters' flat `values`, numbers or symbols. `ops` are the plant's operations without
    quantisation, `command_ops` those of the controllers. The command at rest is `fin_angle` [rad].
    """

    def __init__(self, actuator: Actuator, values: Mapping[str, Any], p: Any, ops: Any, command_ops: Any,
                 fin_angle: float = 0.0) -> None:
        self._actuator, self._values, self._p, self._at = actuator, values, p, fin_angle
        self._ops, self._command_ops = ops, command_ops
        self.states = [s.name for s in actuator.states]
        self.sampled = [s.name for s in actuator.sampled_states]
        self.kept = [*(s.name for s in actuator.controller_states), *self.sampled]
        self._supply = self._started(actuator.supply.input) if actuator.supply else 0.0

    def _started(self, variable: Any) -> Any:
        return self._values[variable.key] if variable.key else variable.start or 0.0

    def start(self) -> list[Value]:
        """Return the initial values, in SI, of `states`, then of the controllers' states `kept`."""
        begun = self._actuator.start(self._ops, self._p, self._at)
        inputs = self.acting(0.0, 0.0, [begun[name] for name in self.sampled])
        x = self._actuator.begun(self._ops, self._p, Record(**begun), inputs)
        return [getattr(x, name) for name in (*self.states, *self.kept)]

    def acting(self, reference: Value, aero_torque: Value, sampled: Sequence[Value]) -> PlantInputs:
        """Return the inputs of the plant; inputs that are not arguments have their start values."""
        return PlantInputs(
            reference=reference, **vars(loads.level(self._ops, self._p, aero_torque)), supply=self._supply,
            enabled=True, rated_current_limit=None, command=self._at, sampled_reference=reference,
            measured_fin_angle=self._at, limited=0.0,
            **{identifier(v.name): self._started(v) for v in self._actuator.acting_inputs},
            **dict(zip(self.sampled, sampled, strict=True)))

    def plant(self, *arguments: Value, ops: Any = None) -> list[Value]:
        """Return the rates of the states, then OUTPUTS, nan for those that the actuator lacks.

        `arguments` are the states, the reference, the hinge moment [N.m] and the sampled states. `ops`, such as
        operations without limits, replace those of the plant.
        """
        ops = ops or self._ops
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


def plain(model: str) -> str:
    """Return the model without the extensions homing and faults, which a linear model leaves out."""
    actuator, extensions = parts(model)
    return "+".join((actuator, *(each for each in extensions if each not in ("homing", "faults"))))


class Unquantised:
    """Symbolic operations without quantisation; a value at a limit has the slope inside the limit."""

    where: Callable[..., Value]

    def floor(self, x: Value) -> Value:
        """Return the value itself."""
        return x

    def clip(self, x: Value, low: Value, high: Value) -> Value:
        """Return the value within its limits."""
        return self.where(x < low, low, self.where(x > high, high, x))


class _Program(Unquantised, Tracer):
    """A tracer of a program with operations without quantisation."""


def program(model: str) -> Tracer:
    """Return start, plant and controllers at rest at 0, traced over the actuator's parameters in their order.

    The first argument of each function is the supply. The plant returns the fin angle as its only output.
    """
    tracer, actuator = _Program(), get(plain(model))
    symbols = {v.name: tracer.parameter(v.name) for v in get(model).parameters}
    values: dict[str, Value] = {v.name: LEFT_OUT.get(v.name, symbols[v.name]) for v in actuator.parameters}

    def at(supply: Value) -> Equations:
        key = actuator.supply.input.key if actuator.supply else None
        return Equations(actuator, {**values, key or "": supply}, actuator.namespace(values), tracer, tracer)

    def called(function: Callable[..., list[Value]], supply: Value, *x: Value) -> list[Value]:
        return function(at(supply), *x)

    names = at(0.0)
    states, kept = (tuple(map(identifier, each)) for each in (names.states, names.kept))
    count, after = len(states) + 1, ("reference", "aero_torque", *map(identifier, names.sampled))
    traced: tuple[tuple[str, tuple[str, ...], Callable[..., list[Value]]], ...] = (
        ("start", (), Equations.start),
        ("plant", (*states, *after), lambda each, *x: each.plant(*x)[:count]),
        ("controllers", (*kept, *states, "command"), Equations.controllers))
    for name, arguments, function in traced:
        try:
            tracer.function(name, ("supply", *arguments), partial(called, function))
        except Exception as error:
            if actuator.source is None or isinstance(error, EmcasError):
                raise
            raise external.refusal(error, actuator.source) from error
    return tracer
