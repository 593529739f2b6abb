"""The model after Ozkan, as the thesis describes it in section 1.1.1.1.

A brushless DC motor under an ideal current loop: the current is its reference at once, within the drive's limit, so
that neither voltage nor back-EMF matters to the motion. The motor's shaft is flexible; there is no gap, and inertia
and friction are reduced to the motor shaft at a constant ratio. The voltage shown is what such a loop would need.
"""

from __future__ import annotations

from typing import Any

from ..ops.base import Ops, Value
from ..physics import drive
from ..tree import changed
from . import elastic
from .habibi import at_motor
from .rewired import rewired

TITLE = "electromechanical actuator after Ozkan: ideal current loop, flexible motor shaft, constant ratio"
PLANT = elastic.PLANT
DESCRIPTIONS = elastic.DESCRIPTIONS
OWN = elastic.TORSIONAL
# rad/(N.m). Under an ideal current loop a rigid shaft has no step of its own: it gives by 6e-6 deg at the fin
# under the motor's full torque.
_STIFFEST = 1e-6


def _wired(ops: Ops, p: Any) -> Any:
    stiff = {f"drive_line.{name}": 0.0 for name in ("axial_compliance", "axial_damping", "backlash",
                                                    "contact_damping")}
    return changed(at_motor(p), {
        **stiff, "drive_line.contact_stiffness": 1.0, "drive.ideal_current": True,
        "drive_line.torsional_compliance": ops.maximum(p.drive_line.torsional_compliance, _STIFFEST)})


initial = rewired(elastic.initial, _wired)
sample = rewired(elastic.sample, _wired)
forces = elastic.forces


def step(ops: Ops, p: Any, angle: Value, speed: Value, current: Value, integral: Value, other_angle: Value,
         other_speed: Value, reference: Value, aero_torque: Value, f_x: Value, f_z: Value, supply: Value,
         enable: Value, h: Value) -> tuple[Value, ...]:
    """See :mod:`emcas_fmu.actuators.elastic`; the supply does not matter."""
    return elastic.yielding(ops, _wired(ops, p), angle, speed, current, integral, other_angle, other_speed, reference,
                            aero_torque, f_x, f_z, supply, enable, h)


def outputs(ops: Ops, p: Any, angle: Value, speed: Value, current: Value, integral: Value, other_angle: Value,
            other_speed: Value, active: Value, reference: Value, measured: Value, limited: Value, command: Value,
            aero_torque: Value, f_x: Value, f_z: Value, supply: Value, enable: Value) -> tuple[Value, ...]:
    """See :mod:`emcas_fmu.actuators.elastic`; `saturated` tells of command, speed, DAC and current."""
    q = _wired(ops, p)
    found = list(elastic.outputs(ops, q, angle, speed, current, integral, other_angle, other_speed, active, reference,
                                 measured, limited, command, aero_torque, f_x, f_z, supply, enable))
    rotor = ops.where(p.encoder.on_fin, other_speed, speed)
    flowing = ops.where(enable, drive.current_reference(ops, q, active), 0.0)
    voltage = p.motor.resistance * flowing + drive.back_emf(p, rotor)
    over = ops.both(enable, ops.fabs(drive.current_reference_raw(q, active)) > p.drive.current_limit)
    found[4:7] = flowing, voltage, drive.torque(p, flowing)
    found[10] = voltage * flowing
    found[13] = ops.either(over, limited > 0.0)
    return tuple(found)
