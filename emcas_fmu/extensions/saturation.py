"""Saturation of the motor's iron (:mod:`emcas_fmu.physics.saturation`): less torque and back-EMF per current and speed.

A step uses the constants at the mean square of its current, which a first step with the constants at its start
predicts. The error is of second order in the tick, and 0 at a constant current. The controllers do not know the
saturation: friction compensation and feed-forward use the torque constant of the parameters.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from ..actuators import capabilities
from ..actuators.declaration import Actuator, PlantInputs, Values
from ..namespace import Record
from ..ops.base import Ops, Value
from ..physics.saturation import saturated
from ..rules import rule, when
from ..variables import in_group, parameter
from .currents import flowing, mean_square
from .declaration import Extension

PARAMETERS = in_group(
    "saturation",
    parameter("share", "1", 0.0, 0.33, "share of torque and back-EMF constant that is lost at saturation.current",
              sheet="motor: 1 - peak torque/(K_t times peak current)"),
    parameter("current", "A", 1e-3, 1e4, "current at which saturation.share is lost; the loss rises with the current's "
              "square", sheet="motor: peak current"),
)


def extend(actuator: Actuator) -> Actuator:
    """Return the actuator with a motor that saturates."""
    def at(ops: Ops, p: Any, x: Record, u: PlantInputs) -> Any:
        current = flowing(ops, actuator, p, x, u)
        return saturated(ops, p, current * current)

    def step(ops: Ops, p: Any, x: Record, u: PlantInputs, h: Value) -> tuple[Values, Value]:
        moved, used = actuator.step(ops, at(ops, p, x, u), x, u, h)
        square = mean_square(ops, actuator, p, x, u, h, moved, used)
        return actuator.step(ops, saturated(ops, p, square), x, u, h)

    def derivatives(ops: Ops, p: Any, x: Record, u: PlantInputs) -> Values:
        return actuator.rates(ops, at(ops, p, x, u), x, u)

    def output_values(ops: Ops, p: Any, x: Record, u: PlantInputs) -> Values:
        return actuator.output_values(ops, at(ops, p, x, u), x, u)

    return replace(actuator, step=step, derivatives=derivatives if actuator.derivatives else None,
                   output_values=output_values)


@rule("saturation.share = %.6g at saturation.current = %.6g A: the motor has its largest torque at %.6g A, which is "
      "below drive.current_limit = %.6g A; lower saturation.share, or raise saturation.current")
def _monotonic(ops: Ops, p: Any, _: Value) -> tuple[Value, ...]:
    s, limit = p.saturation, p.drive.current_limit
    largest = s.current / ops.sqrt(ops.maximum(3.0 * s.share, 1e-300))
    return when(ops, largest < limit), s.share, s.current, largest, limit


EXTENSION = Extension(
    "saturation", "saturation of the motor's iron", extend,
    needs=(capabilities.MOTOR_CURRENT, capabilities.CURRENT_LIMIT), replaces=(capabilities.PROPORTIONAL_TORQUE,),
    parameters=lambda actuator: PARAMETERS, rules=lambda actuator: (_monotonic,),
    references=tuple(f"emcas_fmu.reference.{name}" for name in (
        "simulate", "worm_gear", "worm_gear_elastic", "series_clutch", "electrohydrostatic")))
