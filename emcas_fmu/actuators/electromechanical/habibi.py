"""The actuator after Habibi, Roach and Luecke, as the thesis describes it in section 1.1.1.1.

Current, velocity and position loops are in cascade. There is a gap between nut and fork, whose flanks have the
stiffness and damping of :mod:`emcas_fmu.actuators.electromechanical.elastic`; all other components are rigid. Inertia
and friction are reduced to the motor shaft at a constant ratio; viscous and Coulomb friction are constant and the same
in both directions.
"""

from __future__ import annotations

import sys
from typing import Any

from ...namespace import with_values
from ...physics.structure import Structure
from . import elastic, groups, interface, plausibility

COMPOSITION = interface.composed(elastic.moment, *groups.with_screw(elastic.SCREW), elastic.SHAFT, *groups.SERVO,
                                 elastic.GAP)


def at_motor(p: Any) -> Any:
    """Return parameters with viscous and constant Coulomb friction at the motor, both equal in both directions."""
    viscous, coulomb = p.friction.viscous, p.friction.coulomb
    mean = 0.5 * (viscous.positive + viscous.negative)
    constant = (0.5 * (coulomb.positive[0] + coulomb.negative[0]), 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    return with_values(p, {
        "friction.viscous.positive": mean, "friction.viscous.negative": mean,
        "friction.coulomb.positive": constant, "friction.coulomb.negative": constant})


ACTUATOR = COMPOSITION.over(
    elastic.ACTUATOR, lambda ops, p: COMPOSITION.completed(at_motor(p), elastic.LINE), plausibility.RULES,
    name="habibi",
    title="electromechanical actuator after Habibi: cascaded loops, constant ratio, backlash",
    structure=Structure(constant_ratio=True, drive_line=True),
    modules=(sys.modules[__name__], *elastic.ACTUATOR.modules),
)
