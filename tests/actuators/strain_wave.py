"""An actuator of the tests' own: motor, drive and loops of the nonlinear one on a strain-wave gear of constant ratio.

It is put together from groups, its gear one of its own in place of screw and lever, and takes extensions by what it
declares.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

from emcas_fmu.actuators import capabilities
from emcas_fmu.actuators.declaration import PlantInputs, Values
from emcas_fmu.actuators.electromechanical import groups, interface, nonlinear
from emcas_fmu.actuators.electromechanical.interface import with_parameters
from emcas_fmu.namespace import Record, with_values
from emcas_fmu.ops.base import Ops
from emcas_fmu.physics.structure import Structure
from emcas_fmu.variables import parameter

GEAR = interface.Group((parameter("gear.ratio", "1", 30.0, 320.0, "turns of the motor in one of the fin"),
                        parameter("gear.inertia", "kg.m2", 0.0, 1.0, "inertia of the wave generator")))
PARTS = interface.Parts((
    groups.COULOMB, groups.ENCODER, *groups.LOOPS, groups.VISCOUS, groups.hinge("flexspline"),
    groups.HINGE_FRICTION, groups.SHAFT, *groups.SERVO, GEAR))


def geared(_: Ops, p: Any) -> Any:
    """Parameters as those of a screw of that ratio without lever."""
    return with_values(PARTS.completed(p, (groups.LEVER, groups.SCREW)), {
        "kinematics.moment_arm": p.gear.ratio, "screw.lead": 1.0, "inertia.screw": p.gear.inertia})


def output_values(ops: Ops, p: Any, x: Record, u: PlantInputs) -> Values:
    return nonlinear.shown(PARTS, ops, geared(ops, p), x, u)


ACTUATOR = replace(
    nonlinear.ACTUATOR, name="strain-wave", title="motor with a strain-wave gear", outputs=PARTS.outputs,
    parameters=PARTS.parameters, rules=PARTS.rules, terminals=PARTS.terminals(),
    provides=nonlinear.ACTUATOR.provides - {capabilities.SCREW_AND_LEVER, capabilities.SCREW_LOAD},
    nominal={v.name: 0.0 for v in PARTS.parameters if v.name.startswith("deviation.")},
    structure=Structure(constant_ratio=True), equation_parameters=geared, output_values=output_values,
    initial=with_parameters(nonlinear.initial, geared), sample=with_parameters(nonlinear.sample, geared),
    derivatives=with_parameters(nonlinear.derivatives, geared), step=with_parameters(nonlinear.step, geared),
    reference=None, files=(Path(__file__).with_suffix(".toml"),),
    modules=(sys.modules[__name__],))
