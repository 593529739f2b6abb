"""The drive's current loop in actuators that integrate motor current and integral with their other states.

These step from event to event (:mod:`emcas_fmu.steppers.events`), in the modes of
:func:`emcas_fmu.steppers.electrical.electrical_mode`: the demanded voltage is free, clipped at its limit, or stays at
the limit while the integral follows.
"""

from __future__ import annotations

from typing import Any

from ..ops.base import Ops, Value
from ..physics import drive
from .electrical import Drive


def rates(ops: Ops, p: Any, d: Drive, speed: Value, current: Value, integral: Value) -> tuple[Value, Value]:
    """Return di/dt [A/s] and dxi/dt [V/s] in a mode at a motor speed [rad/s]; both are 0 for a disabled drive.

    A clipped voltage is the limit of mid-step.
    """
    free = ops.equal(d.side, 0.0)
    voltage = ops.where(free, drive.voltage_demand(p, d.i_ref, current, integral), d.source)
    rise = (voltage - p.motor.resistance * current - drive.back_emf(p, speed)) / p.motor.inductance
    gain = ops.where(ops.both(d.enabled, free), p.drive.ki, 0.0)
    return ops.where(d.enabled, rise, 0.0), gain * (d.i_ref - current)


def integral_end(ops: Ops, p: Any, d: Drive, speed: Value, current: Value, integral: Value) -> Value:
    """Return the integral [V] at the end of a step; it keeps a demand that stays at the limit there."""
    followed = d.side * d.limit_at(ops, p, speed, current) - p.drive.kp * (d.i_ref - current)
    return ops.where(d.enabled, ops.where(d.stays > 0.0, followed, integral), 0.0)


def reserve(ops: Ops, p: Any, d: Drive, speed: Value, current: Value, integral: Value) -> Value:
    """Return the event margin [V] of the demanded voltage, which meets or leaves its limit; 1 without such an event.

    From the limit itself the mode of the start holds through the step.
    """
    demand = drive.voltage_demand(p, d.i_ref, current, integral)
    limit = d.limit_at(ops, p, speed, current)
    left = ops.where(ops.equal(d.side, 0.0), limit - ops.fabs(demand), demand * d.side - limit)
    return ops.where(ops.both(d.enabled, ops.equal(d.at_limit, 0.0)), left, 1.0)
