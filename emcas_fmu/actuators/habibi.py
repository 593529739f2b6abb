"""The model after Habibi, Roach and Luecke, as the thesis describes it in section 1.1.1.1.

Loops of current, velocity and position in cascade, a gap between nut and fork, every component rigid, inertia and
friction reduced to the motor shaft at a constant ratio: viscous and constant Coulomb friction, the same in both
directions. The flanks of the gap have the stiffness and damping of :mod:`emcas_fmu.actuators.elastic`.
"""

from __future__ import annotations

from typing import Any

from ..ops.base import Ops
from ..tree import changed
from . import elastic
from .rewired import rewired

TITLE = "electromechanical actuator after Habibi: cascaded loops, constant ratio, backlash"
PLANT = elastic.PLANT
DESCRIPTIONS = elastic.DESCRIPTIONS
OWN = elastic.GAP


def at_motor(p: Any) -> Any:
    """Parameters with the ratio constant and one viscous and one Coulomb coefficient at the motor."""
    viscous, coulomb = p.friction.viscous, p.friction.coulomb
    mean = 0.5 * (viscous.positive + viscous.negative)
    constant = (0.5 * (coulomb.positive[0] + coulomb.negative[0]), 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    return changed(p, {
        "kinematics.constant_ratio": True, "friction.viscous.positive": mean, "friction.viscous.negative": mean,
        "friction.coulomb.positive": constant, "friction.coulomb.negative": constant})


def _wired(_: Ops, p: Any) -> Any:
    return changed(at_motor(p), {f"drive_line.{name}": 0.0 for name in (
        "axial_compliance", "axial_damping", "torsional_compliance", "torsional_damping")})


initial = rewired(elastic.initial, _wired)
sample = rewired(elastic.sample, _wired)
forces = elastic.forces
step = rewired(elastic.step, _wired)
outputs = rewired(elastic.outputs, _wired)
