"""Failed windings of a permanent-magnet motor: terminals shorted, a phase open. No energy appears.

With its terminals shorted a motor of n pole pairs at a speed w has, in the rotor's axes q and d,

    L di_q/dt = -R i_q - n w L i_d - K_e w        L di_d/dt = -R i_d + n w L i_q

and at a constant speed i_q = -K_e w/R' and a loss of R (i_q^2 + i_d^2) = R' i_q^2, with

    R' = R + (n w L)^2/R        T = -K_t K_e w R/(R^2 + (n w L)^2)

T is largest at w = R/(n L). The current i_d is that of a constant speed also while w changes.
R' is that of the speed at the start of a step, which has first order in the tick while w changes: from rest under
100 N.m the default fin is off by 0.0012 deg with ticks of 1 ms, and by 0.005 deg in all.

Without one of its phases the two others are in series: one winding of R and L, line to line, whose back-EMF is a sine
of the rotor's angle,

    L di/dt = v - R i - s K_e w        T = s K_t i        s = sin n (theta - theta_0)

The drive still requests of each phase its part, in that winding s i_ref. At a constant i_ref and a low speed the torque
is s^2 of that of the whole motor: half of it in the mean, none at 2 n angles in a turn. Simscape's
block PMSM (Single-Phase) has the same equations of the winding.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ..ops.base import Ops, Value

_LEAST = 1e-6  # share of the torque; some equations divide by it
WITHOUT_LOOP: Mapping[str, Value] = {"motor.pole_pairs": 0, "drive.kp": 1e-12, "drive.ki": 0.0}
"""Parameters of a current loop without effect: the gain [V/A] is not 0, as some equations divide by it."""


def shorted(p: Any, pole_pairs: Value, speed: Value) -> Mapping[str, Value]:
    """Return the changed parameters of motor and drive with shorted terminals at a motor speed [rad/s].

    The integral of the current loop is 0, too.
    """
    resistance = p.motor.resistance
    across = pole_pairs * speed * p.motor.inductance
    return {"motor.resistance": resistance + across * across / resistance, **WITHOUT_LOOP}


def single_phase(ops: Ops, p: Any, pole_pairs: Value, angle: Value) -> Mapping[str, Value]:
    """Return the changed parameters of motor and drive without a phase at an `angle` [rad] from one without torque."""
    sine = ops.sin(pole_pairs * angle)
    share = ops.where(ops.fabs(sine) > _LEAST, sine, _LEAST)
    return {"motor.torque_constant": share * p.motor.torque_constant,
            "motor.back_emf_constant": share * p.motor.back_emf_constant, "motor.pole_pairs": 0,
            "drive.current_gain": share * p.drive.current_gain, "drive.current_offset": share * p.drive.current_offset,
            "drive.current_limit": ops.fabs(share) * p.drive.current_limit}
