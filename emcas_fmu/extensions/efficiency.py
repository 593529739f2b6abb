"""Efficiency of the screw in forward and backward drive (:mod:`emcas_fmu.physics.screw`), and the output `screw_loss`.

The steppers read the efficiencies themselves: the extension does not change the step.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from ..actuators import capabilities
from ..actuators.declaration import Actuator, PlantInputs, Values
from ..actuators.electromechanical import groups
from ..actuators.electromechanical.rules import jamming
from ..namespace import Record
from ..ops.base import Ops, Value
from ..physics import screw_loss
from ..rules import Rule, rule, when
from ..variables import real_output
from .declaration import Extension

LOSS = real_output("screw_loss", "W", "power that the loaded screw turns into heat", 100.0, minimum=0.0)


def extend(actuator: Actuator) -> Actuator:
    """Return the actuator with losses in its screw."""
    def output_values(ops: Ops, p: Any, x: Record, u: PlantInputs) -> Values:
        outputs = actuator.output_values(ops, p, x, u)
        return {**outputs, LOSS.name: screw_loss.loss(ops, actuator.plant_parameters(ops, p), x, u, outputs)}

    return replace(actuator, output_values=output_values, structure=replace(actuator.structure, screw_losses=True))


def _rules(actuator: Actuator) -> tuple[Rule, ...]:
    @rule("efficiency.backward = %.6g must not be below 0 with an elastic drive line; 0 is a screw that the load "
          "cannot drive")
    def jamming_line(ops: Ops, p: Any, _: Value) -> tuple[Value, ...]:
        return when(ops, p.efficiency.backward < 0.0), p.efficiency.backward

    rigid = jamming("motor and screw", actuator.equation_parameters, actuator.longest_tick)
    return (rigid, jamming_line) if actuator.structure.drive_line else (rigid,)


EXTENSION = Extension(
    "efficiency", "efficiency of the screw in forward and backward drive", extend,
    needs=(capabilities.SCREW_LOAD,), parameters=lambda actuator: groups.EFFICIENCY.parameters, outputs=(LOSS,),
    rules=_rules)
