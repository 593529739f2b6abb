"""Motor and current-mode drive, (2.46), (2.47) and section 3.2.2.

    L di/dt = v - R i - K_e w        T_m = K_t i
    i_ref = clip(K_v u + i_off, +-I_max)
    v = clip(K_p (i_ref - i) + xi, +-V)        dxi/dt = K_i (i_ref - i), held while v is clipped
"""

from __future__ import annotations

from typing import Any

from ..ops.base import Ops, Value


def current_reference_raw(p: Any, reference: Value) -> Value:
    """Current asked for [A] by an analogue reference [V], before the limit."""
    return p.drive.current_gain * reference + p.drive.current_offset


def current_reference(ops: Ops, p: Any, reference: Value) -> Value:
    """Current demanded [A], within the drive's limit."""
    limit = p.drive.current_limit
    return ops.clip(current_reference_raw(p, reference), -limit, limit)


def voltage_demand(p: Any, i_ref: Value, current: Value, integral: Value) -> Value:
    """Output [V] of the current controller before the supply limits it."""
    return p.drive.kp * (i_ref - current) + integral


def back_emf(p: Any, speed: Value) -> Value:
    """Back-EMF [V] at a motor speed [rad/s]."""
    return p.motor.back_emf_constant * speed


def torque(p: Any, current: Value) -> Value:
    """Motor torque [N.m], (2.47)."""
    return p.motor.torque_constant * current
