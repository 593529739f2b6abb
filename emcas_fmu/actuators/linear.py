"""The thesis's linear model, (2.18)-(2.26): the nonlinear actuator without what makes it so.

A constant ratio, one viscous coefficient for both directions, no dry friction and no compensation of it, no
encoder, and none of the limits of speed, reference, current and voltage. Command limit and mechanical stops stay,
and so do loads, drive delay and sampling. With ``controller.position.ki`` = 0 it is the thesis's P control, else PI.
"""

from __future__ import annotations

from typing import Any

from ..ops.base import Ops, Value
from ..tree import changed
from . import nonlinear
from .rewired import rewired

TITLE = "linear electromechanical actuator: constant ratio, viscous friction, no limits"
PLANT = nonlinear.PLANT
OWN = ()
_UNLIMITED = 1e12


def _linear(_: Ops, p: Any) -> Any:
    viscous = 0.5 * (p.friction.viscous.positive + p.friction.viscous.negative)
    none = (0.0,) * 7
    return changed(p, {
        "kinematics.constant_ratio": True, "friction.viscous.positive": viscous, "friction.viscous.negative": viscous,
        "friction.coulomb.positive": none, "friction.coulomb.negative": none, "friction.fin_coulomb": 0.0,
        "compensation.gain": 0.0, "encoder.enabled": False, "drive.current_offset": 0.0,
        "drive.current_limit": _UNLIMITED, "drive.reference_limit": _UNLIMITED, "controller.speed_limit": _UNLIMITED})


initial = rewired(nonlinear.initial, _linear)
sample = rewired(nonlinear.sample, _linear)
forces = nonlinear.forces


def step(ops: Ops, p: Any, angle: Value, speed: Value, current: Value, integral: Value, reference: Value,
         aero_torque: Value, f_x: Value, f_z: Value, supply: Value, enable: Value, h: Value) -> tuple[Value, ...]:
    """See :mod:`emcas_fmu.actuators.nonlinear`; the supply does not matter."""
    return nonlinear.step(ops, _linear(ops, p), angle, speed, current, integral, reference, aero_torque, f_x, f_z,
                          _UNLIMITED, enable, h)


def outputs(ops: Ops, p: Any, angle: Value, speed: Value, current: Value, integral: Value, active: Value,
            reference: Value, measured: Value, limited: Value, command: Value, aero_torque: Value, f_x: Value,
            f_z: Value, supply: Value, enable: Value) -> tuple[Value, ...]:
    """See :mod:`emcas_fmu.actuators.nonlinear`."""
    return nonlinear.outputs(ops, _linear(ops, p), angle, speed, current, integral, active, reference, measured,
                             limited, command, aero_torque, f_x, f_z, _UNLIMITED, enable)
