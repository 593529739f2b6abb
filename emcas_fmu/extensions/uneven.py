"""Dry friction that grows with the load of the fin's bearings, and varies over a revolution of the motor.

    C_f -> C_f + s |T_a|          C_m -> C_m (1 + a cos(theta - theta_0))

C_f is the Coulomb friction about the hinge and C_m that at the motor (:mod:`emcas_fmu.physics.mechanics`), T_a the
aerodynamic hinge moment, theta the motor's angle. A bearing of bore d under a radial force F has the friction mu F d/2
(JTEKT, "Frictional coefficient", table 8-1). A fin's lift acts at a distance e from the hinge axis, and along this axis
at a distance b outside the fin's two bearings, which are c apart. The sum of their forces is k = 1 + 2 b/c times the
lift: s = mu k d/(2 e). Lift is not an input: the model uses |T_a|/e. The variation over a revolution is that of an
eccentric screw or gear.

A step uses the friction at the angle predicted for mid-step. The error is of second order in the tick, and 0 at rest.
As a is below 1 and s is not negative, friction is not below 0 and creates no energy.
"""

from __future__ import annotations

from dataclasses import replace
from math import pi
from typing import Any

from ..actuators import capabilities
from ..actuators.declaration import Actuator, PlantInputs, Values
from ..namespace import Record, with_values
from ..ops.base import Ops, Value
from ..variables import in_group, parameter
from .declaration import Extension

PARAMETERS = in_group(
    "uneven",
    parameter("load_share", "1", 0.0, 1.0, "ratio of added friction about the hinge to the aerodynamic hinge moment, s",
              sheet="bearings: friction coefficient, bore and spacing, and the distance of the lift from the hinge"),
    parameter("ripple", "1", 0.0, 0.9, "variation of Coulomb friction at the motor over a revolution, a",
              sheet="screw: fluctuation of its torque"),
    parameter("phase", "rad", -pi, pi, "motor angle at which friction at the motor is largest, theta_0"),
)


def varied(ops: Ops, p: Any, x: Record, u: PlantInputs, h: Value) -> Any:
    """Return the parameters with the friction at the middle of a step of `h` [s]."""
    angle = x.motor_angle + 0.5 * h * x.motor_speed
    factor = 1.0 + p.uneven.ripple * ops.cos(angle - p.uneven.phase)
    return with_values(p, {
        "friction.fin_coulomb": p.friction.fin_coulomb + p.uneven.load_share * ops.fabs(u.aero_torque),
        "friction.table.coulomb": tuple(factor * ratio for ratio in p.friction.table.coulomb)})


def extend(actuator: Actuator) -> Actuator:
    """Return the actuator with uneven friction."""
    def step(ops: Ops, p: Any, x: Record, u: PlantInputs, h: Value) -> tuple[Values, Value]:
        return actuator.step(ops, varied(ops, p, x, u, h), x, u, h)

    def output_values(ops: Ops, p: Any, x: Record, u: PlantInputs) -> Values:
        return actuator.output_values(ops, varied(ops, p, x, u, 0.0), x, u)

    return replace(actuator, step=step, output_values=output_values)


EXTENSION = Extension(
    "uneven", "friction that grows with the fin's load and varies over a revolution of the motor", extend,
    needs=(capabilities.DRY_FRICTION,), parameters=lambda actuator: PARAMETERS)
