"""The nonlinear actuator with an elastic drive line and a gap between nut and fork.

The rotor and the fin have an angle each (:mod:`emcas_fmu.physics.drive_line`); the fin's is told at the motor. What
the encoder sees comes first in the plant: the rotor, or with ``encoder.on_fin`` the fin. Without compliance and gap
it is the nonlinear actuator, step for step.
"""

from __future__ import annotations

from typing import Any

from .. import control
from ..integrate import Boundary, Plant
from ..integrate import advance as advance_rigid
from ..ops.base import Ops, Value
from ..physics import drive_line, kinematics, mechanics
from ..variables import Variable
from . import nonlinear
from .two_inertias import Pair, advance

TITLE = "nonlinear electromechanical actuator with elastic drive line and backlash"
PLANT = ("angle at the encoder's side", "speed at the encoder's side", "motor current", "drive integral",
         "angle at the other side", "speed at the other side")
DESCRIPTIONS = {
    "motor_angle": "angle of the rotor (indirect fin angle, by lever and screw)",
    "nut_position": "nut displacement from the assembly position, before the gap",
}


def _own(name: str, unit: str, minimum: float, maximum: float, description: str) -> Variable:
    return Variable(f"drive_line.{name}", "Real", "parameter", "fixed", unit, description, minimum, maximum)


AXIAL = (
    _own("axial_compliance", "m/N", 0.0, 1e-3, "compliance of screw, nut and thrust bearing in tension (0: rigid)"),
    _own("axial_damping", "N.s/m", 0.0, 1e7, "structural damping of screw, nut and thrust bearing"),
)
TORSIONAL = (
    _own("torsional_compliance", "rad/(N.m)", 0.0, 1e3, "compliance of motor shaft and screw in torsion (0: rigid)"),
    _own("torsional_damping", "N.m.s/rad", 0.0, 10.0, "structural damping of motor shaft and screw in torsion"),
)
GAP = (
    _own("backlash", "m", 0.0, 0.01, "whole gap between nut and fork along the screw (0: preloaded, no contact)"),
    _own("contact_stiffness", "N/m", 1e4, 1e10, "stiffness of the flanks of nut and fork"),
    _own("contact_damping", "N.s/m", 0.0, 1e7, "damping of the flanks of nut and fork"),
)
OWN = AXIAL + TORSIONAL + GAP


def _sides(ops: Ops, p: Any, angle: Value, speed: Value, current: Value, integral: Value, other_angle: Value,
           other_speed: Value) -> Pair:
    """Rotor and fin from what the encoder sees and the other; the other way round it is the same."""
    at_fin = p.encoder.on_fin
    return Pair(ops.where(at_fin, other_angle, angle), ops.where(at_fin, other_speed, speed), current, integral,
                ops.where(at_fin, angle, other_angle), ops.where(at_fin, speed, other_speed))


def initial(ops: Ops, p: Any) -> tuple[Value, ...]:
    """At rest at fin.start_angle, the nut amid its gap; see :mod:`emcas_fmu.actuators.nonlinear`."""
    angle, speed, current, xi, *controller = nonlinear.initial(ops, p)
    return angle, speed, current, xi, angle, speed, *controller


sample = nonlinear.sample
forces = nonlinear.forces


def yielding(ops: Ops, p: Any, angle: Value, speed: Value, current: Value, integral: Value, other_angle: Value,
             other_speed: Value, reference: Value, aero_torque: Value, f_x: Value, f_z: Value, supply: Value,
             enable: Value, h: Value) -> tuple[Value, ...]:
    """:func:`step` of a drive line that is not rigid."""
    b = Boundary(reference, aero_torque, f_x, f_z, supply, enable)
    s, used = advance(ops, p, _sides(ops, p, angle, speed, current, integral, other_angle, other_speed), b, h)
    return *_sides(ops, p, *s), used


def step(ops: Ops, p: Any, angle: Value, speed: Value, current: Value, integral: Value, other_angle: Value,
         other_speed: Value, reference: Value, aero_torque: Value, f_x: Value, f_z: Value, supply: Value,
         enable: Value, h: Value) -> tuple[Value, ...]:
    """The plant after h [s] or at the first event before, and the time that took."""
    def as_one() -> tuple[Value, ...]:
        plant, used = advance_rigid(ops, p, Plant(angle, speed, current, integral),
                                    Boundary(reference, aero_torque, f_x, f_z, supply, enable), h)
        return *plant, plant.angle, plant.speed, used

    return ops.branch(drive_line.rigid(ops, p), as_one,
                      lambda: yielding(ops, p, angle, speed, current, integral, other_angle, other_speed, reference,
                                       aero_torque, f_x, f_z, supply, enable, h))


def outputs(ops: Ops, p: Any, angle: Value, speed: Value, current: Value, integral: Value, other_angle: Value,
            other_speed: Value, active: Value, reference: Value, measured: Value, limited: Value, command: Value,
            aero_torque: Value, f_x: Value, f_z: Value, supply: Value, enable: Value) -> tuple[Value, ...]:
    """Every output, in the order of the variable table: the fin's of the fin, the others of the motor."""
    s = _sides(ops, p, angle, speed, current, integral, other_angle, other_speed)
    (_, _, motor_angle, motor_speed, flowing, voltage, torque, dac, _, _, power, _, seen, saturated,
     _) = nonlinear.outputs(ops, p, s.angle, s.speed, current, integral, active, reference, measured, limited, command,
                            aero_torque, f_x, f_z, supply, enable)
    tangent = kinematics.lever_tangent(ops, p, s.fin_angle)
    fin = kinematics.fin_angle(ops, p, tangent)
    lag = drive_line.nut_lag(ops, drive_line.line(ops, p), s.angle - s.fin_angle)
    return (
        fin,
        s.fin_speed / kinematics.reduction_ratio(ops, p, tangent),
        motor_angle,
        motor_speed,
        flowing,
        voltage,
        torque,
        dac,
        kinematics.nut_position(ops, p, s.angle - lag),
        mechanics.external_moment(ops, p, tangent, aero_torque, f_x, f_z),
        power,
        control.clipped_command(ops, p, command) - fin,
        seen,
        saturated,
        ops.fabs(fin) >= p.fin.stop_angle * (1.0 - 1e-12),
    )
