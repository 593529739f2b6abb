"""The worm-gear actuator with a compliant mesh and backlash: worm and fin have an angle each.

A worm is a screw on the rim of its wheel: its lead per radian is m z_1/2, the lever is m z_2/2, m the module. Worm,
flanks and wheel are compliant in series as screw, flanks and fork in
:mod:`emcas_fmu.actuators.electromechanical.elastic`. The torque T through them (:mod:`emcas_fmu.physics.drive_line`) is
the load of the worm:

    J_r dw/dt = T_m - C_m sgn w - b_m w - e T        e = 1/eta_f where T w > 0, else eta_b

Without compliance it is :mod:`emcas_fmu.actuators.electromechanical.worm_gear`. The flanks' friction is set-valued at
rest: a self-locking worm stays at rest whatever torque the mesh transmits, while the fin may swing and rattle.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from typing import Any

from ...namespace import with_values
from ...ops.base import Ops, Value
from ...physics import drive_line, worm
from ...physics.structure import Structure
from ...steppers import elastic as elastic_stepper
from .. import capabilities
from . import elastic, groups, interface, worm_gear
from .rules import MOST_JAMMING

COMPOSITION = interface.composed(
    elastic.moment,
    *groups.with_gear(worm_gear.WORM, "worm wheel",
                      replace(groups.SHAFT, provides=(capabilities.MOTOR_SHAFT,)).reworded(
                          {"motor angle": "angle of the rotor (indirect fin angle, by worm and wheel)"})),
    elastic.AXIAL.reworded({"screw, nut": "worm", "in tension": "along its axis"}, {
        "screw: compliance, 1 over the axial rigidity of screw, nut and bearing":
            "gear: compliance, 1 over the axial rigidity of worm, mesh and bearing"}),
    elastic.GAP.reworded({"nut and fork": "worm and wheel", "the screw": "the pitch circle"},
                         {"screw: axial play": "gear: play of the mesh"}),
    elastic.HINGE.reworded({"fork": "worm wheel", "screw": "worm"}))


def geared(ops: Ops, p: Any) -> Any:
    """Return the parameters of an equivalent screw on the rim of the wheel, with the flanks' friction as built.

    Shaft and worm are rigid in torsion, so that the flanks' friction acts on the motor directly. Applying the function
    to its own result changes nothing.
    """
    lead = 0.5 * p.worm.module * p.worm.starts
    return with_values(COMPOSITION.completed(worm_gear.geared(ops, p), (elastic.TORSIONAL,)), {
        "screw.lead": lead, "kinematics.moment_arm": lead * worm.ratio(p)})


def longest_tick(ops: Ops, p: Any) -> Value:
    """Return the largest tick [s], at most that of a rigid mesh, in which a locked worm's acceleration is unique."""
    of_rigid, p = worm_gear.longest_tick(ops, p), geared(ops, p)
    line = drive_line.line(ops, p, 0.0)
    return ops.minimum(of_rigid, elastic_stepper.longest_step(ops, p, line, MOST_JAMMING))


ACTUATOR = COMPOSITION.over(
    elastic.ACTUATOR, geared, (*worm_gear.RULES, elastic.stiff_hinge),
    name="worm-gear-elastic",
    title="electromechanical actuator with a worm gear whose mesh yields and has backlash",
    origin=worm_gear.ACTUATOR.origin,
    descriptions=worm_gear.ACTUATOR.descriptions,
    structure=Structure(constant_ratio=True, drive_line=True, screw_losses=True, worm=True),
    faults=worm_gear.FAULTS,
    equation_parameters=geared,
    longest_tick=longest_tick,
    reference="emcas_fmu.reference.worm_gear_elastic",
    modules=(sys.modules[__name__], drive_line, elastic_stepper, *worm_gear.ACTUATOR.modules),
)
