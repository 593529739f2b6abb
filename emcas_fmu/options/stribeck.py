"""Dry friction at the motor that falls with speed: breakaway above sliding (:mod:`emcas_fmu.physics.friction`).

    C_m (1 + (s - 1) exp(-(w/w_s)^2))

Stick stays exact, up to s C_m. The integrators take the friction of the speed predicted for mid-step: of second order
where a tick is short beside J w_s/((s - 1) C_m), in which a motor of inertia J passes the excess. Dry friction about
the hinge stays as it is, and so does what the controller feeds forward: it knows the friction identified.
"""

from __future__ import annotations

from dataclasses import replace

from ..actuators.model import Model
from ..variables import Variable

TITLE = "Stribeck friction at the motor"
PARAMETERS = (
    # The physics takes the group's presence for the wish: see friction.falls().
    Variable("stribeck.static_ratio", "Real", "parameter", "fixed", "1",
             "breakaway over Coulomb friction at the motor, s", 1.0, 10.0),
    Variable("stribeck.speed", "Real", "parameter", "fixed", "rad/s",
             "motor speed at which the excess over Coulomb friction has fallen to 1/e of itself, w_s", 0.1, 1e3),
)
_WITHOUT = {"linear": "the linear model has no dry friction", "second-order": "the second-order model has no friction"}


def unfit(model: str, options: tuple[str, ...]) -> str:
    """Why it cannot be laid over a model or beside other options; nothing if it can."""
    if model in _WITHOUT:
        return f"needs dry friction at the motor: {_WITHOUT[model]}"
    return "is part of lugre already (lugre.static_ratio, lugre.stribeck_speed)" if "lugre" in options else ""


def extended(model: Model) -> Model:
    """`model` under this friction."""
    return replace(model, parameters=model.parameters + PARAMETERS)
