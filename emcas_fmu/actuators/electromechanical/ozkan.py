"""The actuator after Ozkan, as the thesis describes it in section 1.1.1.1.

A brushless DC motor under an ideal current loop: the current is its reference at once, within the drive's limit, so
that neither voltage nor back-EMF matters to the motion. The motor's shaft is flexible; there is no gap, and inertia
and friction are reduced to the motor shaft at a constant ratio. The voltage shown is what such a loop would need.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from typing import Any

from ...namespace import Record, with_values
from ...ops.base import Ops
from ...physics import drive
from ...physics.structure import Structure
from .. import capabilities
from ..declaration import Acting, Values
from . import elastic, interface
from .habibi import at_motor
from .rewired import rewired

# rad/(N.m). Under an ideal current loop a rigid shaft has no step of its own: it gives by 6e-6 deg at the fin
# under the motor's full torque.
_STIFFEST = 1e-6
_GAPLESS = {**{f"drive_line.{name}": 0.0 for name in ("axial_compliance", "axial_damping", "backlash",
                                                      "contact_damping")}, "drive_line.contact_stiffness": 1.0}


def _gapless(_: Ops, p: Any) -> Any:
    return with_values(at_motor(p), _GAPLESS)


def _ozkan(ops: Ops, p: Any) -> Any:
    return with_values(_gapless(ops, p), {
        "drive_line.torsional_compliance": ops.maximum(p.drive_line.torsional_compliance, _STIFFEST)})


def output_values(ops: Ops, p: Any, x: Record, u: Acting) -> Values:
    """Return every output; `saturated` is of command, speed, DAC and current."""
    q = _ozkan(ops, p)
    shown = elastic.output_values(ops, q, x, u)
    rotor = ops.where(p.encoder.on_fin, x.other_speed, x.speed_at_encoder)
    flowing = ops.where(u.enabled, drive.current_reference(ops, q, u.reference), 0.0)
    voltage = p.motor.resistance * flowing + drive.back_emf(p, rotor)
    over = ops.both(u.enabled, ops.fabs(drive.current_reference_raw(q, u.reference)) > p.drive.current_limit)
    return {**shown, "motor_current": flowing, "motor_voltage": voltage, "motor_torque": drive.torque(p, flowing),
            "supply_power": voltage * flowing, "saturated": ops.either(over, u.limited > 0.0)}


ACTUATOR = replace(
    elastic.ACTUATOR,
    name="ozkan",
    title="electromechanical actuator after Ozkan: ideal current loop, flexible motor shaft, constant ratio",
    parameters=interface.PARAMETERS + elastic.TORSIONAL,
    provides=elastic.ACTUATOR.provides - {
        capabilities.SCREW_LOAD, capabilities.BACKLASH, capabilities.CURRENT_LOOP, capabilities.VOLTAGE_LIMIT},
    descriptions={**interface.INPUT_DESCRIPTIONS, "supply_voltage": "bus voltage of the drive; limits nothing here"},
    structure=Structure(constant_ratio=True, current="ideal", drive_line=True),
    initial=rewired(elastic.initial, _ozkan),
    sample=rewired(elastic.sample, _ozkan),
    derivatives=rewired(elastic.derivatives, _gapless),
    step=rewired(elastic.yielding, _ozkan),
    output_values=output_values,
    modules=(sys.modules[__name__], *elastic.ACTUATOR.modules),
)
