"""Dry friction at the motor that changes with speed: breakaway friction is above or below sliding friction.

    C_m (1 + (s - 1) exp(-(w/w_s)^2))

C_m is the Coulomb friction at the motor, w the motor's speed (:mod:`emcas_fmu.physics.friction`). The motor still
sticks exactly, up to a torque of s C_m. With a ratio s below 1 friction rises with speed, as was measured on a greased
ball screw (docs/model/measured.md); 1 is neutral.

A step uses the friction at the speed predicted for mid-step. The error is of second order if a tick is short compared
with J w_s/(|s - 1| C_m), the time in which that difference accelerates a motor of inertia J by w_s. Dry friction
about the hinge does not change, nor does the friction compensation of the controller, which uses C_m.
"""

from __future__ import annotations

from dataclasses import replace

from ..actuators import capabilities
from ..actuators.declaration import Actuator
from ..variables import parameter
from .declaration import Extension

PARAMETERS = (
    parameter("stribeck.static_ratio", "1", 0.1, 10.0, "ratio of breakaway to Coulomb friction at the motor, s"),
    parameter("stribeck.speed", "rad/s", 0.1, 1e3,
              "motor speed at which 1/e of the difference from Coulomb friction is left, w_s", display="rpm"),
)


def extend(actuator: Actuator) -> Actuator:
    """Return the actuator with Stribeck friction at the motor."""
    return replace(actuator, structure=replace(actuator.structure, stribeck=True))


EXTENSION = Extension(
    "stribeck", "Stribeck friction at the motor", extend, needs=(capabilities.COULOMB_FRICTION,),
    replaces=(capabilities.COULOMB_FRICTION,), parameters=lambda actuator: PARAMETERS)
