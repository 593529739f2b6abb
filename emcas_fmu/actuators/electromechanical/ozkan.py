"""The actuator after Ozkan, as the thesis describes it in section 1.1.1.1.

A brushless DC motor has an ideal current loop: the current equals its reference at once, within the drive's limit.
Voltage and back-EMF do not affect the motion. The motor's shaft is flexible; there is no gap. The ratio is constant;
friction is the same in both directions. The output motor_voltage is the voltage that such a loop would need, without
that across the inductance.
"""

from __future__ import annotations

import sys
from typing import Any

from ...namespace import with_values
from ...ops.base import Ops
from ...physics.structure import Structure
from .. import fin_port
from ..composition import with_parameters
from ..declaration import Supply
from . import elastic, groups, interface, nonlinear, plausibility

# Smallest compliance [rad/(N.m)] of the shaft, 6e-6 deg at the fin under the motor's full torque: the equations of a
# rigid shaft do not cover an ideal current loop.
_LEAST_COMPLIANCE = 1e-6
_HINGE = groups.HINGE.reworded({"DAC, current or voltage": "DAC or current"})
COMPOSITION = interface.composed(
    elastic.moment, *groups.with_screw(groups.SCREW, _HINGE), elastic.SHAFT, groups.MOTOR, groups.CURRENT, groups.POWER,
    groups.DELAY, groups.CURRENT_GAIN, groups.CURRENT_LIMIT, groups.COMPENSATION, elastic.TORSIONAL)


def _gapless(_: Ops, p: Any) -> Any:
    return COMPOSITION.completed(nonlinear.constant_friction(p), elastic.LINE)


def _ozkan(ops: Ops, p: Any) -> Any:
    return with_values(_gapless(ops, p), {
        "drive_line.torsional_compliance": ops.maximum(p.drive_line.torsional_compliance, _LEAST_COMPLIANCE)})


ACTUATOR = COMPOSITION.over(
    elastic.ACTUATOR, _ozkan, plausibility.RULES_WITHOUT_WINDING,
    name="ozkan",
    title="electromechanical actuator after Ozkan: ideal current loop, flexible motor shaft, constant ratio",
    origin="Section 1.1.1.1 of the thesis of Yerlikaya (2016) describes this structure, after Ozkan, without numbers; "
           "nothing is from that author's own work. Motor, screw, fin and loops are those of the default actuator. "
           "Entries are engineering estimates where their source says so.",
    supply=Supply(interface.SUPPLY_VOLTAGE, interface.SUPPLY_POWER),
    descriptions={**interface.INPUT_DESCRIPTIONS, "supply_voltage": "bus voltage of the drive; has no effect"},
    without_effect=frozenset({"supply_voltage"}),
    structure=Structure(constant_ratio=True, current="ideal", drive_line=True),
    derivatives=with_parameters(elastic.derivatives, _gapless),
    step=with_parameters(elastic.yielding, _ozkan),
    longest_tick=fin_port.max_tick,
    tick_remedy="raise solver.max_tick",
    modules=(sys.modules[__name__], *elastic.ACTUATOR.modules),
)
