"""A screw with losses laid over an electromechanical actuator (:mod:`emcas_fmu.physics.screw`).

Steps follow from the parameters alone; what is added is the output `screw_loss`.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from ...namespace import Record
from ...ops.base import Ops, Value
from ...physics import screw_loss
from ...rules import Rule, when
from ...variables import parameter, real_output
from ..declaration import Actuator, PlantInputs, Values
from .rules import MOST_JAMMING, jams

PARAMETERS = (
    parameter("efficiency.forward", "1", 0.01, 1.0, "efficiency of the screw where the motor drives the load",
              sheet="screw: efficiency, turning into thrust"),
    parameter("efficiency.backward", "1", -10.0, 1.0,
              "efficiency of the screw where the load drives the motor (0 or less: it cannot)",
              sheet="screw: efficiency, thrust into turning"),
)
LOSS = real_output("screw_loss", "W", "power that the loaded screw turns into heat", 100.0, minimum=0.0)


def jamming_text(turning: str) -> str:
    """Return what a rule says of a backward efficiency with which a screw jams, by what turns with it."""
    return (f"efficiency.backward = %.6g must not be below minus {MOST_JAMMING:g} times the inertia of {turning} over "
            "that of the load at the motor, %.6g over %.6g kg.m2")


def with_losses(actuator: Actuator) -> Actuator:
    """Return the actuator with such a screw: steps see its parameters."""
    def output_values(ops: Ops, p: Any, x: Record, u: PlantInputs) -> Values:
        outputs = actuator.output_values(ops, p, x, u)
        return {**outputs, LOSS.name: screw_loss.loss(ops, actuator.plant_parameters(ops, p), x, u, outputs)}

    return replace(actuator, output_values=output_values, structure=replace(actuator.structure, screw_losses=True))


def rules(actuator: Actuator) -> tuple[Rule, ...]:
    """Return the rules for the efficiencies of such a screw."""
    def jamming(ops: Ops, p: Any, _: Value) -> tuple[Value, ...]:
        return jams(ops, p, p.efficiency.backward, actuator.longest_tick(ops, p))

    def jamming_line(ops: Ops, p: Any, _: Value) -> tuple[Value, ...]:
        return when(ops, p.efficiency.backward < 0.0), p.efficiency.backward

    rigid = Rule(jamming, jamming_text("motor and screw"))
    line = Rule(jamming_line, "efficiency.backward = %.6g must not be below 0 with an elastic drive line; 0 is a screw "
                              "that the load cannot drive")
    return (rigid, line) if actuator.structure.drive_line else (rigid,)
