"""Saturation of a motor's iron: the larger the current, the smaller are torque constant and back-EMF constant.

    T_m = K_t k i        e = K_e k w        k = 1 - s (i/i_s)^2

s is the share of both constants that is lost at the current i_s. The torque is an odd polynomial of third order in the
current; makers of servo drives approximate a motor's torque by such a polynomial (Beckhoff, AMP8000, object 32C2,
*SynchronousMotor torque characteristic*). Since k acts on torque and back-EMF alike, T_m w = e i: all power of the
back-EMF becomes mechanical power. The inductance is constant.

The polynomial has its largest torque at the current i_s/sqrt(3 s), where k = 2/3. At larger currents k remains 2/3.
"""

from __future__ import annotations

from typing import Any

from ..namespace import with_values
from ..ops.base import Ops, Value

LEAST_FACTOR = 2.0 / 3.0  # smallest k


def constants_left(ops: Ops, p: Any, square: Value) -> Value:
    """Return k [-], the share of both constants that remains, for the square of a current [A^2]."""
    s = p.saturation
    return ops.maximum(1.0 - s.share * square / (s.current * s.current), LEAST_FACTOR)


def saturated(ops: Ops, p: Any, square: Value) -> Any:
    """Return the parameters with both constants of the motor at the square of a current [A^2]."""
    left = constants_left(ops, p, square)
    return with_values(p, {"motor.torque_constant": p.motor.torque_constant * left,
                           "motor.back_emf_constant": p.motor.back_emf_constant * left})
