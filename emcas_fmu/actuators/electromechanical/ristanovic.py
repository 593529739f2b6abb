"""After Ristanovic, Cojbasic and Lazic (2012): a brush DC motor under PWM, with no current loop.

"Intelligent control of DC motor driven electromechanical fin actuator", Control Engineering Practice 20 (6),
610-617. The amplifier puts a voltage on the winding in proportion to the controllers' reference, the speed demanded
saturates, a torsion bar stands for the hinge moment, and the ratio is constant:

    L di/dt = clip(K_pwm u, +-V) - R i - K_e w        T = T_aero - k_bar fin_angle

The model has no back-EMF (thesis, section 1.1.1.1): K_e is 0 unless given. The supply then gives the winding's heat
only; the work on the shaft has no counterpart, and no supply limits the speed. A K_e equal to K_t is that of a motor.
Friction, sampling, encoder and stops are the nonlinear actuator's. No friction is fed forward.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from typing import Any

from ...namespace import Record
from ...ops.base import Ops, Value
from ...physics import kinematics
from ...physics.structure import Structure
from ...variables import parameter
from .. import capabilities, fin_port
from ..declaration import PlantInputs, Values
from . import groups, interface, nonlinear, plausibility
from .as_built import as_built
from .interface import with_parameters

PWM = interface.Group((
    parameter("pwm.gain", "1", 1e-6, 1e4, "motor voltage per volt of reference, K_pwm",
              sheet="drive: motor voltage per volt of command"),))
BAR = interface.Group((
    parameter("load.torsion_bar", "N.m/rad", 0.0, 1e6, "stiffness of the torsion bar, k_bar"),))
PARTS = interface.Parts((
    groups.LEVER, groups.COULOMB, groups.ENCODER, groups.SCREW, *groups.LOOPS, groups.VISCOUS,
    groups.hinge(
        hinge_torque="total external moment about the hinge (aerodynamic + torsion bar + gravity + inertial)",
        saturated="any limit active: command, speed, DAC or voltage"),
    groups.HINGE_FRICTION, groups.SHAFT, groups.MOTOR,
    groups.current("motor current, which no loop controls"), groups.POWER, groups.INDUCTANCE,
    groups.delay(drive_reference="analogue reference held by the controller's DAC, which sets the PWM"), PWM, BAR))


def _uncompensated(_: Ops, p: Any) -> Any:
    return PARTS.completed(p, (groups.COMPENSATION,))


def _loaded(ops: Ops, p: Any, angle: Value, u: PlantInputs) -> PlantInputs:
    built = as_built(ops, p)
    fin = kinematics.fin_angle(ops, built, kinematics.lever_tangent(ops, built, angle))
    return u.replace(aero_torque=u.aero_torque - p.load.torsion_bar * fin)


def derivatives(ops: Ops, p: Any, x: Record, u: PlantInputs) -> Values:
    """Return d/dt of the states."""
    return nonlinear.derivatives(ops, p, x, _loaded(ops, p, x.motor_angle, u))


def step(ops: Ops, p: Any, x: Record, u: PlantInputs, h: Value) -> tuple[Values, Value]:
    """Return the plant after h [s] or at the first event before, and the time that took; the bar acts of mid-step."""
    return nonlinear.step(ops, p, x, _loaded(ops, p, x.motor_angle + 0.5 * h * x.motor_speed, u), h)


def output_values(ops: Ops, p: Any, x: Record, u: PlantInputs) -> Values:
    """Return every output; hinge_torque has the bar's."""
    return nonlinear.shown(PARTS, ops, p, x, _loaded(ops, p, x.motor_angle, u))


ACTUATOR = replace(
    nonlinear.ACTUATOR,
    name="ristanovic",
    title="DC motor under PWM without current loop, torsion-bar load, constant ratio (after Ristanovic et al. 2012)",
    outputs=PARTS.outputs,
    terminals=PARTS.terminals(),
    parameters=PARTS.parameters,
    rules=(*PARTS.rules, plausibility.INERTIA_RULE, plausibility.COUNT_RULE, plausibility.WINDING_RULE),
    supply_rules=plausibility.SUPPLY_RULES[:1],
    equal_parameters=(),
    provides=nonlinear.ACTUATOR.provides - {capabilities.CURRENT_LOOP, capabilities.CURRENT_LIMIT},
    structure=Structure(constant_ratio=True, current="pwm", torsion_bar=True),
    sample=with_parameters(nonlinear.sample, _uncompensated),
    derivatives=derivatives,
    step=step,
    output_values=output_values,
    longest_tick=fin_port.max_tick,
    tick_remedy="raise solver.max_tick",
    reference=None,
    modules=(sys.modules[__name__], *nonlinear.EQUATIONS),
)
