"""The actuator after Ozkan, as the thesis describes it in section 1.1.1.1.

A brushless DC motor under an ideal current loop: the current is its reference at once, within the drive's limit, so
that neither voltage nor back-EMF matters to the motion. The motor's shaft is flexible; there is no gap, and inertia
and friction are reduced to the motor shaft at a constant ratio. The voltage shown is what such a loop would need.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from functools import partial
from typing import Any

from ...namespace import with_values
from ...ops.base import Ops
from ...physics.structure import Structure
from .. import capabilities, fin_port
from ..declaration import Supply
from . import elastic, groups, interface, nonlinear, plausibility
from .habibi import at_motor
from .interface import with_parameters

# rad/(N.m). Under an ideal current loop a rigid shaft has no step of its own: it gives by 6e-6 deg at the fin
# under the motor's full torque.
_STIFFEST = 1e-6
PARTS = interface.Parts((
    *groups.lever_and_screw(elastic.SCREW), elastic.SHAFT, groups.MOTOR, groups.CURRENT, groups.POWER,
    groups.DELAY, groups.CURRENT_GAIN, groups.CURRENT_LIMIT, groups.COMPENSATION, elastic.TORSIONAL))


def _gapless(_: Ops, p: Any) -> Any:
    return PARTS.completed(at_motor(p), elastic.LINE)


def _ozkan(ops: Ops, p: Any) -> Any:
    return with_values(_gapless(ops, p), {
        "drive_line.torsional_compliance": ops.maximum(p.drive_line.torsional_compliance, _STIFFEST)})


ACTUATOR = replace(
    elastic.ACTUATOR,
    name="ozkan",
    title="electromechanical actuator after Ozkan: ideal current loop, flexible motor shaft, constant ratio",
    parameters=PARTS.parameters,
    outputs=PARTS.outputs,
    terminals=PARTS.terminals(),
    supply=Supply(interface.SUPPLY_VOLTAGE, interface.SUPPLY_POWER),
    provides=elastic.ACTUATOR.provides - {
        capabilities.SCREW_LOAD, capabilities.BACKLASH, capabilities.CURRENT_LOOP, capabilities.VOLTAGE_LIMIT},
    rules=(*PARTS.rules, *plausibility.UNWOUND_RULES),
    descriptions={**interface.INPUT_DESCRIPTIONS, "supply_voltage": "bus voltage of the drive; limits nothing here"},
    structure=Structure(constant_ratio=True, current="ideal", drive_line=True),
    initial=with_parameters(elastic.initial, _ozkan),
    sample=with_parameters(nonlinear.sample, _ozkan),
    derivatives=with_parameters(elastic.derivatives, _gapless),
    step=with_parameters(elastic.yielding, _ozkan),
    output_values=with_parameters(partial(elastic.shown, PARTS), _ozkan),
    longest_tick=fin_port.max_tick,
    tick_remedy="raise solver.max_tick",
    modules=(sys.modules[__name__], *elastic.ACTUATOR.modules),
)
