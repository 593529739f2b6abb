"""The current of a motor during a step, for extensions whose motor changes with it."""

from __future__ import annotations

from typing import Any

from ..actuators import capabilities
from ..actuators.declaration import Actuator, PlantInputs, Values
from ..namespace import Record
from ..ops.base import Ops, Value
from ..physics import course
from ..steppers.electrical import electrical_mode


def flowing(ops: Ops, actuator: Actuator, p: Any, x: Record, u: PlantInputs) -> Value:
    """Return the current [A] with which a step from `x` starts; none flows through the open bridge of a disabled drive,
    unless its diodes conduct.
    """
    current = actuator.motor_current(ops, p, x, u)
    if capabilities.DRIVE_STEP not in actuator.provides:
        return current
    flows = ops.either(u.enabled, p.inverter.pole_pairs > 0.0) if p.structure.inverter else u.enabled
    return ops.where(flows, current, 0.0)


def mean_square(ops: Ops, actuator: Actuator, p: Any, x: Record, u: PlantInputs, h: Value, moved: Values, used: Value
                ) -> Value:
    """Return the mean of i^2 [A^2] over the `used` [s] of a step of `h` [s] from `x` to `moved`.

    It follows from the exponential course of the current between the ends, or from a line where the equations of the
    drive do not step it.
    """
    current = flowing(ops, actuator, p, x, u)
    if capabilities.DRIVE_STEP not in actuator.provides:
        end = actuator.motor_current(ops, p, x.replace(**moved), u)
        return (current * current + current * end + end * end) / 3.0
    if p.structure.current == "ideal":
        return moved["motor_current"] * moved["motor_current"]
    tau = electrical_mode(ops, actuator.plant_parameters(ops, p), x, u, h).tau
    return course.mean_square(ops, current, moved["motor_current"], used / tau)
