"""The actuator after Habibi, Roach and Luecke, as the thesis describes it in section 1.1.1.1.

Loops of current, velocity and position in cascade, a gap between nut and fork, every component rigid, inertia and
friction reduced to the motor shaft at a constant ratio: viscous and constant Coulomb friction, the same in both
directions. The flanks of the gap have the stiffness and damping of
:mod:`emcas_fmu.actuators.electromechanical.elastic`.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from typing import Any

from ...namespace import with_values
from ...ops.base import Ops
from ...physics.structure import Structure
from .. import capabilities
from . import elastic, groups, interface, nonlinear
from .interface import with_parameters

PARTS = interface.Parts((
    *groups.lever_and_screw(elastic.SCREW), elastic.SHAFT, *groups.SERVO, elastic.GAP))


def at_motor(p: Any) -> Any:
    """Return parameters with one viscous and one Coulomb coefficient at the motor."""
    viscous, coulomb = p.friction.viscous, p.friction.coulomb
    mean = 0.5 * (viscous.positive + viscous.negative)
    constant = (0.5 * (coulomb.positive[0] + coulomb.negative[0]), 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    return with_values(p, {
        "friction.viscous.positive": mean, "friction.viscous.negative": mean,
        "friction.coulomb.positive": constant, "friction.coulomb.negative": constant})


def _habibi(_: Ops, p: Any) -> Any:
    return PARTS.completed(at_motor(p), elastic.LINE)


ACTUATOR = replace(
    elastic.ACTUATOR,
    name="habibi",
    title="electromechanical actuator after Habibi: cascaded loops, constant ratio, backlash",
    parameters=PARTS.parameters,
    rules=nonlinear.ACTUATOR.rules,
    provides=elastic.ACTUATOR.provides - {capabilities.SCREW_LOAD},
    structure=Structure(constant_ratio=True, drive_line=True),
    initial=with_parameters(elastic.initial, _habibi),
    sample=with_parameters(nonlinear.sample, _habibi),
    derivatives=with_parameters(elastic.derivatives, _habibi),
    step=with_parameters(elastic.step, _habibi),
    output_values=with_parameters(elastic.output_values, _habibi),
    modules=(sys.modules[__name__], *elastic.ACTUATOR.modules),
)
