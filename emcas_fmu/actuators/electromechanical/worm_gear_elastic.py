"""The worm-gear actuator with a mesh that yields and has backlash: worm and fin have an angle each.

A worm is a screw on the rim of its wheel: m z_1/2 its lead per radian, m z_2/2 the lever, m the module. Worm, flanks
and wheel yield in series as screw, flanks and fork of :mod:`emcas_fmu.actuators.electromechanical.elastic` do, and the
torque T that they update_motion_loads (:mod:`emcas_fmu.physics.drive_line`) is the load of the worm:

    J_r dw/dt = T_m - C_m sgn w - b_m w - e T        e = 1/eta_f where T w > 0, else eta_b

Where nothing yields it is :mod:`emcas_fmu.actuators.electromechanical.worm_gear`. Friction of the flanks is set-valued
at rest: a worm that locks stands under whatever the mesh brings while the fin swings and rattles behind it.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from typing import Any

from ...namespace import Record, with_values
from ...ops.base import Ops, Value
from ...physics import drive_line, screw_loss
from ...physics import worm as worm_and_wheel
from ...physics.structure import Structure
from ...steppers import elastic as elastic_stepper
from .. import capabilities
from ..declaration import PlantInputs, Values
from . import elastic, nonlinear, worm_gear
from .as_built import as_built
from .interface import with_parameters
from .rules import MOST_JAMMING

PARTS = worm_gear.parts(
    elastic.axial("worm and thrust bearing", "along its axis",
                  "gear: compliance, 1 over the axial rigidity of worm, mesh and bearing"),
    elastic.gap("worm and wheel", "pitch circle", "gear: play of the mesh"), elastic.hinge("worm wheel", "worm"),
    motor_angle="angle of the rotor (indirect fin angle, by worm and wheel)")


def geared(ops: Ops, p: Any) -> Any:
    """Return parameters as those of a screw on the rim of the wheel, its friction as built; of these, the same.

    What twists before the flanks would not feel their friction: shaft and worm are rigid in torsion.
    """
    lead = 0.5 * p.worm.module * p.worm.starts
    return with_values(PARTS.completed(worm_gear.geared(ops, p), (elastic.TORSIONAL,)), {
        "screw.lead": lead, "kinematics.moment_arm": lead * worm_and_wheel.ratio(p)})


def output_values(ops: Ops, p: Any, x: Record, u: PlantInputs) -> Values:
    """Return every output."""
    p = geared(ops, p)
    values = elastic.shown(PARTS, ops, p, x, u)
    return {**values, worm_gear.LOSS.name: screw_loss.loss(ops, as_built(ops, p), x, u, values)}


def longest_tick(ops: Ops, p: Any) -> Value:
    """Return the largest tick [s]: that of a rigid mesh, or one in which a locking worm has one acceleration."""
    of_rigid, p = worm_gear.longest_tick(ops, p), geared(ops, p)
    line = drive_line.line(ops, p, 0.0)
    return ops.minimum(of_rigid, elastic_stepper.longest_step(ops, p, line, MOST_JAMMING))


ACTUATOR = replace(
    worm_gear.ACTUATOR,
    name="worm-gear-elastic",
    title="electromechanical actuator with a worm gear whose mesh yields and has backlash",
    states=elastic.STATES,
    fin_side=elastic.FIN_SIDE,
    outputs=PARTS.outputs,
    parameters=PARTS.parameters,
    rules=(*worm_gear.RULES, elastic.LINE_RULE),
    provides=worm_gear.ACTUATOR.provides - {capabilities.RIGID_DRIVE_LINE} | {capabilities.BACKLASH},
    structure=Structure(constant_ratio=True, drive_line=True, screw_losses=True, worm=True),
    equation_parameters=geared,
    initial=with_parameters(elastic.initial, geared),
    sample=with_parameters(nonlinear.sample, geared),
    derivatives=with_parameters(elastic.derivatives, geared),
    step=with_parameters(elastic.step, geared),
    output_values=output_values,
    longest_tick=longest_tick,
    reference="emcas_fmu.reference.worm_gear_elastic",
    modules=(sys.modules[__name__], drive_line, elastic_stepper, *worm_gear.ACTUATOR.modules),
)
