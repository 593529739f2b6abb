"""Dry friction at the motor that changes with speed: that at rest is above or below that of sliding.

    C_m (1 + (s - 1) exp(-(w/w_s)^2))

(:mod:`emcas_fmu.physics.friction`). Stick remains exact, up to s C_m. A ratio s below 1 is friction that builds up
with speed, as has been measured of a greased ball screw (docs/model/measured.md); the neutral one is 1.

The integrators use the friction at the speed predicted for mid-step: they have second order if a tick is short compared
with J w_s/((s - 1) C_m), the time in which a motor of inertia J passes the difference. Dry friction about the hinge
does not change, nor does the feedforward of the controller, which knows the identified friction.
"""

from __future__ import annotations

from dataclasses import replace

from ..actuators import capabilities
from ..actuators.declaration import Actuator
from ..variables import parameter
from .declaration import Extension

PARAMETERS = (
    parameter("stribeck.static_ratio", "1", 0.1, 10.0, "breakaway over Coulomb friction at the motor, s"),
    parameter("stribeck.speed", "rad/s", 0.1, 1e3,
              "motor speed at which 1/e of the difference to Coulomb friction is left, w_s", display="rpm"),
)


def extend(actuator: Actuator) -> Actuator:
    """Return the actuator with this friction."""
    return replace(actuator, structure=replace(actuator.structure, stribeck=True))


EXTENSION = Extension(
    "stribeck", "Stribeck friction at the motor", extend, needs=(capabilities.COULOMB_FRICTION,),
    replaces=(capabilities.COULOMB_FRICTION,), parameters=lambda actuator: PARAMETERS)
