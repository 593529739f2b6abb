"""The current of a motor during a step, for extensions in which the motor's parameters depend on it."""

from __future__ import annotations

from typing import Any

from ..actuators import capabilities
from ..actuators.declaration import Actuator, PlantInputs, Values
from ..namespace import Record
from ..ops.base import Ops, Value
from ..physics import inverter, step_means
from ..steppers.electrical import electrical_mode


def flowing(ops: Ops, actuator: Actuator, p: Any, x: Record, u: PlantInputs) -> Value:
    """Return the current [A] at the start of a step from `x`; 0 for an open bridge whose diodes do not conduct."""
    current = actuator.motor_current(ops, p, x, u)
    if capabilities.DRIVE_STEP not in actuator.provides:
        return current
    flows = ops.either(u.enabled, p.inverter.pole_pairs > 0.0) if p.structure.inverter else u.enabled
    return ops.where(flows, current, 0.0)


def time_constant(ops: Ops, q: Any, x: Record, u: PlantInputs, h: Value) -> Value:
    """Return the time constant [s] of the current in a step of `h` [s] by the equations of the drive.

    `q` are the plant's parameters.
    """
    tau = electrical_mode(ops, q, x, u, h).tau
    if not q.structure.inverter:
        return tau
    (tau,) = ops.branch(u.enabled, lambda: (tau,), lambda: (
        q.motor.inductance / inverter.diodes(ops, q, u.supply, x.motor_speed).resistance,))
    return tau


def lossy_resistance(ops: Ops, actuator: Actuator, p: Any, x: Record, u: PlantInputs) -> Value:
    """Return the resistance [Ohm] that turns the square of the motor current into heat.

    It is the winding's, or a larger one while the diodes of an open bridge conduct.
    """
    if not p.structure.inverter:
        return p.motor.resistance
    (loss,) = ops.branch(ops.either(u.enabled, p.inverter.pole_pairs <= 0.0), lambda: (p.motor.resistance,), lambda: (
        inverter.diodes(ops, actuator.plant_parameters(ops, p), u.supply, x.motor_speed).loss,))
    return loss


def mean_square(ops: Ops, actuator: Actuator, p: Any, x: Record, u: PlantInputs, h: Value, moved: Values, used: Value
                ) -> Value:
    """Return the mean of i^2 [A^2] over the `used` [s] of a step of `h` [s] from `x` to `moved`.

    The course of the current is an exponential, a line if the equations of the drive do not step the motor, and
    constant with an ideal current loop.
    """
    current = flowing(ops, actuator, p, x, u)
    if capabilities.DRIVE_STEP not in actuator.provides:
        end = actuator.motor_current(ops, p, x.replace(**moved), u)
        return (current * current + current * end + end * end) / 3.0
    if p.structure.current == "ideal":
        return moved["motor_current"] * moved["motor_current"]
    tau = time_constant(ops, actuator.plant_parameters(ops, p), x, u, h)
    return step_means.mean_square(ops, current, moved["motor_current"], used / tau)
