"""Failed windings of a permanent-magnet motor: terminals shorted, or a phase open. The equations create no energy.

The currents of a motor with n pole pairs and shorted terminals at a speed w are, in the rotor's axes q and d,

    L di_q/dt = -R i_q - n w L i_d - K_e w        L di_d/dt = -R i_d + n w L i_q

and at a constant speed i_q = -K_e w/R' and a loss of R (i_q^2 + i_d^2) = R' i_q^2, with

    R' = R + (n w L)^2/R        T = -K_t K_e w R/(R^2 + (n w L)^2)

The braking torque is largest at w = R/(n L). i_d is that of a constant speed even while w changes, and R' that of the
speed at the start of a step, with an error of first order in the tick. From rest under 100 N.m the fin angle of the
default actuator has an error of 0.005 deg in all; the tick's part is 0.0012 deg at 1 ms.

If one phase is open, the two others are in series: one winding of R and L, line to line, whose back-EMF is a sine of
the rotor's angle,

    L di/dt = v - R i - s K_e w        T = s K_t i        s = sin n (theta - theta_0)

The drive still requests the reference of each phase, s i_ref in this winding. At a constant i_ref and a low speed the
torque is s^2 times that of the intact motor: half of it in the mean, and 0 at 2 n angles in a turn. Simscape's block
PMSM (Single-Phase) has the same equations for the winding.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ..ops.base import Ops, Value

_LEAST = 1e-6  # smallest |s|, since some equations divide by s
WITHOUT_LOOP: Mapping[str, Value] = {"motor.pole_pairs": 0, "drive.kp": 1e-12, "drive.ki": 0.0}
"""Parameters of a current loop without effect; its gain [V/A] is not 0, since some equations divide by it."""


def shorted(p: Any, pole_pairs: Value, speed: Value) -> Mapping[str, Value]:
    """Return the changed parameters of motor and drive with shorted terminals at a motor speed [rad/s].

    The caller sets the integral of the current loop to 0, since shorted terminals have no voltage.
    """
    resistance = p.motor.resistance
    reactance = pole_pairs * speed * p.motor.inductance
    return {"motor.resistance": resistance + reactance * reactance / resistance, **WITHOUT_LOOP}


def single_phase(ops: Ops, p: Any, pole_pairs: Value, angle: Value) -> Mapping[str, Value]:
    """Return the changed parameters of motor and drive with an open phase, at a motor `angle` [rad] that is 0 where the
    torque vanishes."""
    sine = ops.sin(pole_pairs * angle)
    share = ops.where(ops.fabs(sine) > _LEAST, sine, _LEAST)
    return {"motor.torque_constant": share * p.motor.torque_constant,
            "motor.back_emf_constant": share * p.motor.back_emf_constant, "motor.pole_pairs": 0,
            "drive.current_gain": share * p.drive.current_gain, "drive.current_offset": share * p.drive.current_offset,
            "drive.current_limit": ops.fabs(share) * p.drive.current_limit}
