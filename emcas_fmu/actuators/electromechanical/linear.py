"""The thesis's linear model, (2.18)-(2.26): the nonlinear actuator without what makes it so.

A constant ratio, one viscous coefficient for both directions, no dry friction and no compensation of it, no
encoder, and none of the limits of speed, reference, current and voltage. Command limit and mechanical stops stay,
and so do loads, drive delay and sampling. With ``controller.position.ki`` = 0 it is the thesis's P control, else PI.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from math import inf
from typing import Any

from ...namespace import Record, with_values
from ...ops.base import Ops, Value
from ...physics.structure import Structure
from .. import capabilities
from ..declaration import PlantInputs, Values
from . import groups, interface, nonlinear, plausibility
from .interface import with_parameters

PARTS = interface.Parts((
    groups.LEVER, groups.SCREW, groups.VELOCITY_LOOP, groups.POSITION_LOOP, groups.VISCOUS,
    groups.HINGE, groups.SHAFT, groups.MOTOR, groups.CURRENT, groups.POWER, groups.INDUCTANCE,
    groups.DELAY, groups.CURRENT_GAIN, groups.CURRENT_LOOP))


def _linear(_: Ops, p: Any) -> Any:
    viscous = 0.5 * (p.friction.viscous.positive + p.friction.viscous.negative)
    return with_values(PARTS.completed(p, groups.OPTIONAL), {
        "friction.viscous.positive": viscous, "friction.viscous.negative": viscous})


def step(ops: Ops, p: Any, x: Record, u: PlantInputs, h: Value) -> tuple[Values, Value]:
    """Return the plant after h [s] or at the first event before, and the time that took; no supply limits it."""
    return nonlinear.step(ops, _linear(ops, p), x, u.replace(supply=inf), h)


def output_values(ops: Ops, p: Any, x: Record, u: PlantInputs) -> Values:
    """Return every output."""
    return nonlinear.shown(PARTS, ops, _linear(ops, p), x, u.replace(supply=inf))


ACTUATOR = replace(
    nonlinear.ACTUATOR,
    name="linear",
    title="linear electromechanical actuator: constant ratio, viscous friction, no limits",
    outputs=PARTS.outputs,
    terminals=PARTS.terminals(),
    parameters=PARTS.parameters,
    rules=(*PARTS.rules, plausibility.INERTIA_RULE, plausibility.VELOCITY_RULE, plausibility.WINDING_RULE),
    supply_rules=(),
    descriptions={**interface.INPUT_DESCRIPTIONS, "supply_voltage": "bus voltage of the drive; limits nothing here"},
    provides=frozenset({capabilities.MOTOR_CURRENT, capabilities.CURRENT_LOOP, capabilities.RIGID_DRIVE_LINE,
                        capabilities.SCREW_DRIVE, capabilities.SCREW_AND_LEVER, capabilities.POSITION_LOOP,
                        capabilities.CASCADE, capabilities.SUPPLY_VOLTAGE, capabilities.RETURNS_POWER,
                        capabilities.AMBIENT_TEMPERATURE, capabilities.DRIVE_STEP}),
    structure=Structure(constant_ratio=True),
    initial=with_parameters(nonlinear.initial, _linear),
    equation_parameters=_linear,
    sample=with_parameters(nonlinear.sample, _linear),
    derivatives=with_parameters(nonlinear.derivatives, _linear),
    step=step,
    output_values=output_values,
    reference=None,
    modules=(sys.modules[__name__], *nonlinear.EQUATIONS),
)
