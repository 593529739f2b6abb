"""Efficiency of the screw in forward and backward drive (:mod:`emcas_fmu.physics.screw`).

Steps follow from the parameters alone; what is added is the output `screw_loss`.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from ..actuators.model import Model, Shown, Values
from ..integrate import Boundary
from ..ops.base import Ops, Value
from ..physics import drive_line, friction, kinematics, loads, mechanics, screw
from ..tree import changed
from ..variables import OUTPUTS, Variable

TITLE = "efficiency of the screw in forward and backward drive"
PARAMETERS = (
    Variable("efficiency.forward", "Real", "parameter", "fixed", "1",
             "efficiency of the screw where the motor drives the load", 0.01, 1.0),
    Variable("efficiency.backward", "Real", "parameter", "fixed", "1",
             "efficiency of the screw where the load drives the motor (0 or less: it cannot)", -10.0, 1.0),
)
LOSS = Variable("screw_loss", "Real", "output", "continuous", "W", "power that the loaded screw turns into heat",
                nominal=100.0)
_UNFIT = {
    "linear": "is not for the linear model: torque that hangs on the sign of the load is not linear; take nonlinear",
    "second-order": "is not for the second-order model, which has no torques; take nonlinear",
    "habibi": "is not for the model after Habibi, whose losses are friction at the motor; take elastic",
    "ozkan": "is not for the model after Ozkan, whose losses are friction at the motor; take elastic",
}
_DIRECT = ("aero_torque", "acceleration.x", "acceleration.y", "acceleration.z", "attitude.roll", "attitude.pitch",
           "enable")


def unfit(model: str, options: tuple[str, ...]) -> str:
    """Why there can be no such screw in a model, nothing if there can."""
    return _UNFIT.get(model, "")


def _load_side(ops: Ops, p: Any, speed: Value, fin: Value, moment: Value, f_x: Value, direction: Value
               ) -> tuple[Value, Value]:
    """J_l [kg.m2] and L_0 [N.m] of a rigid drive line at a speed of the motor [rad/s] and a fin angle [rad]."""
    # The model after Ristanovic is the one of constant ratio among those that may have such a screw.
    wired = changed(p, {"kinematics.constant_ratio": True}) if hasattr(p, "pwm") else p
    motor_angle = kinematics.motor_angle(ops, wired, fin)
    m = mechanics.coefficients(ops, wired, motor_angle, 0.0, 0.0, 0.0)
    m = m._replace(load=moment / m.ratio + p.screw.lead * loads.nut_force(ops, p, f_x))
    return screw.load_inertia(p, m.ratio), screw.load(p, m, speed, direction)


def _line_load(ops: Ops, p: Any, plant: Values, f_x: Value) -> tuple[Value, Value]:
    """The same with an elastic drive line behind screw and nut."""
    angle, speed, _, _, other_angle, other_speed = plant
    side = ops.where(p.encoder.on_fin, -1.0, 1.0)  # the fin's comes first where the encoder is there
    deflection, rate = side * (angle - other_angle), side * (speed - other_speed)
    c = drive_line.line(ops, p)
    pressed, flank = drive_line.pressed(ops, c, deflection, rate)
    torque = ops.where(pressed, drive_line.torque(c, deflection, rate, flank), 0.0)
    return screw.nut_inertia(p), torque - p.screw.lead * loads.nut_force(ops, p, f_x)


def loss(ops: Ops, p: Any, plant: Values, b: Boundary, shown: dict[str, Value]) -> Value:
    """Power [W] that the screw turns into heat, from the plant's state and the model's other outputs by name."""
    speed, fin = shown["motor_speed"], shown["fin_angle"]
    direction = ops.where(speed > 0.0, 1.0, -1.0)

    def rigid() -> tuple[Value, Value]:
        return _load_side(ops, p, speed, fin, shown["hinge_torque"], b.f_x, direction)

    def turning() -> tuple[Value, ...]:
        inertia, load = rigid() if not hasattr(p, "drive_line") else ops.branch(
            drive_line.rigid(ops, p), rigid, lambda: _line_load(ops, p, plant, b.f_x))
        net = (shown["motor_torque"] - direction * friction.coulomb(ops, p, direction, fin, speed)
               - friction.viscous(ops, p, direction) * speed)
        transmitted, e = screw.transmitted(ops, p, net, inertia, load, direction)
        return ((e - 1.0) * transmitted * speed,)

    return ops.branch(ops.fabs(speed) > 0.0, turning, lambda: (0.0,))[0]


def extended(inner: Model) -> Model:
    """The model with such a screw: steps see its parameters."""
    names = [v.name for v in OUTPUTS + inner.outputs]

    def put_out(ops: Ops, p: Any, plant: Values, held: Values, b: Boundary, s: Shown) -> Values:
        outputs = inner.put_out(ops, p, plant, held, b, s)
        return *outputs, loss(ops, p, plant, b, dict(zip(names, outputs, strict=True)))

    return replace(inner, put_out=put_out, parameters=inner.parameters + PARAMETERS,
                   outputs=(*inner.outputs, LOSS), direct=(*inner.direct, (LOSS.name, _DIRECT)))
