"""The model after Habibi, Roach and Luecke, as the thesis describes it in section 1.1.1.1.

Loops of current, velocity and position in cascade, a gap between nut and fork, every component rigid, inertia and
friction reduced to the motor shaft at a constant ratio: viscous and constant Coulomb friction, the same in both
directions. The flanks of the gap have the stiffness and damping of :mod:`emcas_fmu.actuators.elastic`.
"""

from __future__ import annotations

from typing import Any

from ..ops.base import Ops, Value
from ..tree import changed
from . import elastic

TITLE = "electromechanical actuator after Habibi: cascaded loops, constant ratio, backlash"
PLANT = elastic.PLANT
OWN = elastic.GAP


def at_motor(p: Any) -> Any:
    """Parameters with the ratio constant and one viscous and one Coulomb coefficient at the motor."""
    viscous, coulomb = p.friction.viscous, p.friction.coulomb
    mean = 0.5 * (viscous.positive + viscous.negative)
    constant = (0.5 * (coulomb.positive[0] + coulomb.negative[0]), 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    return changed(p, {
        "kinematics.constant_ratio": True, "friction.viscous.positive": mean, "friction.viscous.negative": mean,
        "friction.coulomb.positive": constant, "friction.coulomb.negative": constant})


def _wired(p: Any) -> Any:
    return changed(at_motor(p), {f"drive_line.{name}": 0.0 for name in (
        "axial_compliance", "axial_damping", "torsional_compliance", "torsional_damping")})


def initial(ops: Ops, p: Any) -> tuple[Value, ...]:
    """See :mod:`emcas_fmu.actuators.elastic`."""
    return elastic.initial(ops, _wired(p))


def sample(ops: Ops, p: Any, angle: Value, speed: Value, integral: Value, counts: Value, command: Value,
           enable: Value) -> tuple[Value, ...]:
    """See :mod:`emcas_fmu.actuators.nonlinear`."""
    return elastic.sample(ops, _wired(p), angle, speed, integral, counts, command, enable)


forces = elastic.forces


def step(ops: Ops, p: Any, angle: Value, speed: Value, current: Value, integral: Value, other_angle: Value,
         other_speed: Value, reference: Value, aero_torque: Value, f_x: Value, f_z: Value, supply: Value,
         enable: Value, h: Value) -> tuple[Value, ...]:
    """See :mod:`emcas_fmu.actuators.elastic`."""
    return elastic.step(ops, _wired(p), angle, speed, current, integral, other_angle, other_speed, reference,
                        aero_torque, f_x, f_z, supply, enable, h)


def outputs(ops: Ops, p: Any, angle: Value, speed: Value, current: Value, integral: Value, other_angle: Value,
            other_speed: Value, active: Value, reference: Value, measured: Value, limited: Value, command: Value,
            aero_torque: Value, f_x: Value, f_z: Value, supply: Value, enable: Value) -> tuple[Value, ...]:
    """See :mod:`emcas_fmu.actuators.elastic`."""
    return elastic.outputs(ops, _wired(p), angle, speed, current, integral, other_angle, other_speed, active,
                           reference, measured, limited, command, aero_torque, f_x, f_z, supply, enable)
