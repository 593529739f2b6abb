"""The drive's current loop where motor current and integral are integrated with the other states.

For actuators that step from event to event (:mod:`emcas_fmu.steppers.events`), in the modes of
:func:`emcas_fmu.steppers.electrical.electrical_mode`: the demanded voltage is free, clipped at its limit, or stays
there with the integral following.
"""

from __future__ import annotations

from typing import Any

from ..ops.base import Ops, Value
from ..physics import drive
from .electrical import Drive


def rates(ops: Ops, p: Any, d: Drive, speed: Value, current: Value, integral: Value) -> tuple[Value, Value]:
    """Return di/dt [A/s] and dxi/dt [V/s] in a mode at a motor speed [rad/s]; a disabled drive has none.

    A clipped voltage is held at the limit of mid-step.
    """
    free = ops.equal(d.side, 0.0)
    voltage = ops.where(free, drive.voltage_demand(p, d.i_ref, current, integral), d.source)
    rise = (voltage - p.motor.resistance * current - drive.back_emf(p, speed)) / p.motor.inductance
    gain = ops.where(ops.both(d.enabled, free), p.drive.ki, 0.0)
    return ops.where(d.enabled, rise, 0.0), gain * (d.i_ref - current)


def integral_end(ops: Ops, p: Any, d: Drive, speed: Value, current: Value, integral: Value) -> Value:
    """Return the integral [V] at the end of a step: where the demand stays at the limit, that which keeps it there."""
    followed = d.side * d.limit_at(ops, p, speed, current) - p.drive.kp * (d.i_ref - current)
    return ops.where(d.enabled, ops.where(d.stays > 0.0, followed, integral), 0.0)


def reserve(ops: Ops, p: Any, d: Drive, speed: Value, current: Value, integral: Value) -> Value:
    """Return what is above zero until the demanded voltage meets or leaves its limit [V]; 1 where that is no event.

    From the limit itself the mode of the start holds through the step.
    """
    demand = drive.voltage_demand(p, d.i_ref, current, integral)
    limit = d.limit_at(ops, p, speed, current)
    left = ops.where(ops.equal(d.side, 0.0), limit - ops.fabs(demand), demand * d.side - limit)
    return ops.where(ops.both(d.enabled, ops.equal(d.at_limit, 0.0)), left, 1.0)
