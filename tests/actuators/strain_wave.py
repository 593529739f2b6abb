"""A test actuator: motor, drive and loops of the nonlinear actuator on a strain-wave gear of constant ratio.

It is composed of groups, with its own group for the gear instead of screw and lever. From its groups follow the
extensions that it may have.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

from emcas_fmu.actuators.composition import Group
from emcas_fmu.actuators.electromechanical import groups, interface, nonlinear
from emcas_fmu.namespace import with_values
from emcas_fmu.ops.base import Ops
from emcas_fmu.physics.structure import Structure
from emcas_fmu.variables import parameter

GEAR = Group((parameter("gear.ratio", "1", 30.0, 320.0, "turns of the motor in one of the fin"),
              parameter("gear.inertia", "kg.m2", 0.0, 1.0, "inertia of the wave generator")))
COMPOSITION = interface.composed(nonlinear.moment, *groups.with_gear(GEAR, "flexspline"))


def geared(_: Ops, p: Any) -> Any:
    """Return the parameters of an equivalent screw with the gear's ratio and without lever."""
    return with_values(COMPOSITION.completed(p, (groups.LEVER, groups.SCREW)), {
        "kinematics.moment_arm": p.gear.ratio, "screw.lead": 1.0, "inertia.screw": p.gear.inertia})


ACTUATOR = COMPOSITION.over(
    nonlinear.ACTUATOR, geared, name="strain-wave", title="motor with a strain-wave gear",
    structure=Structure(constant_ratio=True), equation_parameters=geared,
    files=(Path(__file__).with_suffix(".toml"),), modules=(sys.modules[__name__],))
