"""The actuator after Habibi, Roach and Luecke, as the thesis describes it in section 1.1.1.1.

Current, velocity and position loops are in cascade. There is a gap between nut and fork, whose flanks have the
stiffness and damping of :mod:`emcas_fmu.actuators.electromechanical.elastic`; all other components are rigid. The ratio
is constant; the coefficients of viscous and Coulomb friction are constant and the same in both directions.
"""

from __future__ import annotations

import sys

from ...physics.structure import Structure
from . import elastic, groups, interface, nonlinear, plausibility

COMPOSITION = interface.composed(elastic.moment, *groups.with_screw(elastic.SCREW), elastic.SHAFT, *groups.SERVO,
                                 elastic.GAP)
ACTUATOR = COMPOSITION.over(
    elastic.ACTUATOR, lambda ops, p: COMPOSITION.completed(nonlinear.constant_friction(p), elastic.LINE),
    plausibility.RULES,
    name="habibi",
    title="electromechanical actuator after Habibi: cascaded loops, constant ratio, backlash",
    origin="Section 1.1.1.1 of the thesis of Yerlikaya (2016) describes this structure, after Habibi, Roach and "
           "Luecke, without numbers; nothing is from these authors' papers. Motor, drive, screw, fin and loops are "
           "those of the default actuator. Entries are engineering estimates where their source says so.",
    structure=Structure(constant_ratio=True, drive_line=True),
    modules=(sys.modules[__name__], *elastic.ACTUATOR.modules),
)
