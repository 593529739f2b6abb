"""Dry friction at the motor that falls with speed: breakaway above sliding (:mod:`emcas_fmu.physics.friction`).

    C_m (1 + (s - 1) exp(-(w/w_s)^2))

Stick stays exact, up to s C_m. The integrators take the friction of the speed predicted for mid-step: of second order
where a tick is short beside J w_s/((s - 1) C_m), in which a motor of inertia J passes the excess. Dry friction about
the hinge stays as it is, and so does what the controller feeds forward: it knows the friction identified.
"""

from __future__ import annotations

import sys
from dataclasses import replace

from ..actuators import capabilities
from ..actuators.declaration import Actuator
from ..variables import parameter
from .declaration import Extension

PARAMETERS = (
    parameter("stribeck.static_ratio", "1", 1.0, 10.0, "breakaway over Coulomb friction at the motor, s"),
    parameter("stribeck.speed", "rad/s", 0.1, 1e3,
              "motor speed at which the excess over Coulomb friction has fallen to 1/e of itself, w_s", display="rpm"),
)


def extend(actuator: Actuator) -> Actuator:
    """Return `actuator` under this friction."""
    return replace(actuator, structure=replace(actuator.structure, stribeck=True))


EXTENSION = Extension(
    "stribeck", "Stribeck friction at the motor", extend, needs=(capabilities.COULOMB_FRICTION,),
    replaces=(capabilities.COULOMB_FRICTION,), parameters=lambda actuator: PARAMETERS, module=sys.modules[__name__])
