"""The thesis's linear model, (2.18)-(2.26): the nonlinear actuator without its nonlinear equations.

It has a constant ratio, one viscous coefficient for both directions, no dry friction or friction compensation, no
encoder, and no limits of speed, reference, current and voltage. Command limit and mechanical stops remain, as do
loads, drive delay and sampling. With ``controller.position.ki`` = 0 it is the thesis's P control, otherwise PI.
"""

from __future__ import annotations

import sys
from math import inf
from typing import Any

from ...namespace import Record
from ...ops.base import Ops, Value
from ...physics.structure import Structure
from ..declaration import PlantInputs, Values
from . import groups, interface, nonlinear, plausibility


def moment(ops: Ops, p: Any, x: Record, u: PlantInputs) -> tuple[Any, Record]:
    """Return the parameters as built, and the values from which the outputs follow; the supply limits nothing."""
    return nonlinear.moment(ops, p, x, u.replace(supply=inf))


COMPOSITION = interface.composed(
    moment, groups.LEVER, groups.SCREW, groups.VELOCITY_LOOP, groups.POSITION_LOOP, groups.VISCOUS,
    groups.HINGE.reworded({"command, speed, DAC, current or voltage": "command", " from the encoder": ""}),
    groups.SHAFT, groups.MOTOR, groups.CURRENT, groups.POWER, groups.INDUCTANCE, groups.DELAY, groups.CURRENT_GAIN,
    groups.CURRENT_LOOP, groups.PHASES)


def _linear(_: Ops, p: Any) -> Any:
    return nonlinear.constant_friction(COMPOSITION.completed(p, groups.OPTIONAL))


def step(ops: Ops, p: Any, x: Record, u: PlantInputs, h: Value) -> tuple[Values, Value]:
    """Return the plant's states after `h` [s] or at the first event, and the time [s] until then."""
    return nonlinear.step(ops, _linear(ops, p), x, u.replace(supply=inf), h)


ACTUATOR = COMPOSITION.over(
    nonlinear.ACTUATOR, _linear,
    (plausibility.matched_inertia, plausibility.VELOCITY_RULE, plausibility.WINDING_RULE),
    name="linear",
    title="linear electromechanical actuator: constant ratio, viscous friction, no limits",
    supply_rules=(),
    descriptions={**interface.INPUT_DESCRIPTIONS, "supply_voltage": "bus voltage of the drive; has no effect"},
    without_effect=frozenset({"supply_voltage"}),
    structure=Structure(constant_ratio=True),
    equation_parameters=_linear,
    step=step,
    modules=(sys.modules[__name__], *nonlinear.MODULES),
)
