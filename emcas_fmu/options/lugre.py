"""LuGre bristles instead of exact stick at the motor: presliding, frictional lag, breakaway that depends on the rate.

    dz/dt = w - sigma_0 |w| z/g(w)            g = C_m (1 + (s - 1) exp(-(w/w_s)^2)) + C_f/R
    torque = sigma_0 z + sigma_1(w) dz/dt     sigma_1(w) = sigma_1/(1 + sigma_1 |w|/g)

after Canudas de Wit, Olsson, Astrom and Lischinsky (1995), "A new model for control of systems with friction", IEEE
Transactions on Automatic Control 40 (3), 419-425, besides the viscous friction there is; C_f is that about the hinge.
Friction's power less the rate of sigma_0 z^2/2 is a quadratic form of dz/dt and z that is never negative where
sigma_1 |w| <= 4 g. A damping that fades with speed keeps to q = sigma_1(w) |w|/g < 1 for any sigma_1, and then

    torque = (1 - q) sigma_0 z + q g sgn w

lies between the bristles' spring and sliding friction: no larger than the largest g on the way, at a reversal too.
Without friction, g = 0, bristles slip at once and carry nothing. Solved in :mod:`emcas_fmu.integrate_bristle`.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from ..actuators.model import Asked, Model, Sampled, Shown, State, Values, split
from ..integrate import Boundary, Plant
from ..integrate_bristle import advance
from ..ops.base import Ops, Value
from ..physics import friction, mechanics
from ..variables import Variable

TITLE = "LuGre friction at the motor"


def _own(name: str, unit: str, minimum: float, maximum: float, description: str) -> Variable:
    return Variable(f"lugre.{name}", "Real", "parameter", "fixed", unit, description, minimum, maximum)


PARAMETERS = (
    _own("stiffness", "N.m/rad", 1e-3, 1e6, "stiffness of the bristles at the motor, sigma_0"),
    _own("damping", "N.m.s/rad", 0.0, 1.0, "damping of the bristles at rest, sigma_1; it fades with speed"),
    _own("static_ratio", "1", 1.0, 10.0, "breakaway over Coulomb friction at the motor, s"),
    _own("stribeck_speed", "rad/s", 1e-3, 1e3,
         "motor speed at which the excess over Coulomb friction has fallen to 1/e of itself, w_s"),
)
OUTPUTS = (
    Variable("bristle_deflection", "Real", "output", "continuous", "rad",
             "mean deflection of the bristles at the motor", nominal=0.01),
    Variable("friction_torque", "Real", "output", "continuous", "N.m",
             "friction at the motor without the viscous, positive against positive motion", nominal=0.1),
)


def unfit(model: str, options: tuple[str, ...]) -> str:
    """Why it cannot be laid over a model or beside other options; nothing if it can."""
    if model in ("linear", "second-order"):
        return f"needs dry friction at the motor, which the {model} model has not"
    if model != "nonlinear":
        return f"is solved with the nonlinear model's one inertia and drive, not with the {model} model"
    if "stribeck" in options:
        return "has that of stribeck already (lugre.static_ratio, lugre.stribeck_speed)"
    if "efficiency" in options:
        return "is not solved together with the screw's efficiency"
    return ""


def extended(model: Model) -> Model:
    """`model` on bristles, one more plant state."""
    def initial(ops: Ops, p: Any) -> tuple[State, Value]:
        state, measured = model.initial(ops, p)
        return state._replace(plant=(*state.plant, 0.0)), measured

    def sample(ops: Ops, p: Any, s: State, asked: Asked) -> Sampled:
        return model.sample(ops, p, s._replace(plant=split(s.plant, 1)[0]), asked)

    def step(ops: Ops, p: Any, plant: Values, held: Values, b: Boundary, h: Value) -> tuple[Values, Value]:
        moving, (deflection,) = split(plant, 1)
        moved, deflection, used = advance(ops, p, Plant(*moving), deflection, b, h)
        return (*moved, deflection), used

    def put_out(ops: Ops, p: Any, plant: Values, held: Values, b: Boundary, shown: Shown) -> Values:
        moving, (deflection,) = split(plant, 1)
        angle, speed = moving[:2]
        m = mechanics.coefficients(ops, p, angle, b.aero_torque, b.f_x, b.f_z)
        rate, damping = friction.bristles(ops, p, m.fin, m.ratio, speed)
        torque = p.lugre.stiffness * deflection + damping * (speed - rate * deflection)
        return *model.put_out(ops, p, moving, held, b, shown), deflection, torque

    return replace(model, plant=(*model.plant, "bristle deflection"), initial=initial, sample=sample, step=step,
                   put_out=put_out, parameters=model.parameters + PARAMETERS, outputs=model.outputs + OUTPUTS)
