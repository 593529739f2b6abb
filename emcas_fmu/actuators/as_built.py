"""The plant as built, which differs from the nominal parameters that the controllers know.

    actual = nominal (1 + deviation)        the lever's assembly angle: nominal + deviation

Deviations act on the plant only. With all of them 0 the controllers know the plant exactly.
"""

from __future__ import annotations

from collections.abc import Callable
from math import radians
from typing import Any, NamedTuple

from ..namespace import value_of, with_values
from ..ops.base import Ops
from ..physics import mechanics
from ..variables import Variable, parameter


class Deviation(NamedTuple):
    """A parameter ``deviation.X``, and the plant's parameters that it scales or shifts."""

    variable: Variable
    scales: tuple[str, ...] = ()
    shifts: tuple[str, ...] = ()

    def scaling(self, *names: str) -> Deviation:
        """Return this deviation with `names` as the parameters that it scales."""
        return self._replace(scales=names)


def _deviation(name: str, minimum: float, maximum: float, description: str, *scales: str) -> Deviation:
    variable = parameter(f"deviation.{name}", "1", minimum, maximum, f"relative deviation as built of {description}")
    return Deviation(variable, scales)


MOMENT_ARM = _deviation("kinematics.moment_arm", -0.5, 0.5, "the moment arm", "kinematics.moment_arm")
INITIAL_ANGLE = Deviation(
    parameter("deviation.kinematics.initial_angle", "rad", radians(-10.0), radians(10.0),
              "deviation as built of the lever's assembly angle"), shifts=("kinematics.initial_angle",))
LEAD = _deviation("screw.lead", -0.5, 0.5, "the screw lead", "screw.lead")
# Both constants are proportional to the flux of the magnets.
FLUX = _deviation("motor.torque_constant", -0.5, 0.5, "torque and back-EMF constant",
                  "motor.torque_constant", "motor.back_emf_constant")
FIN = _deviation("mass.fin", -0.9, 10.0, "mass and inertia of the fin", "mass.fin", "inertia.fin")
COULOMB = _deviation("friction.coulomb", -1.0, 10.0, "Coulomb friction", "friction.coulomb.positive",
                     "friction.coulomb.negative", *mechanics.HINGE_DRY)
VISCOUS = _deviation("friction.viscous", -1.0, 10.0, "viscous friction", "friction.viscous.positive",
                     "friction.viscous.negative", *mechanics.HINGE_VISCOUS)
RATED_FLOW = _deviation("valve.rated_flow", -0.9, 10.0, "the rated flow", "valve.rated_flow")

ENCODER, OFFSET, COMPLIANCE, BACKLASH = IMPERFECTIONS = ("encoder", "drive offset", "compliance", "backlash")
"""Imperfections of the held fin angle that an accuracy budget lists even if an actuator does not have them."""


def plant(*deviations: Deviation) -> Callable[[Ops, Any], Any]:
    """Return the function of (ops, p) that returns nominal parameters as built, with the deviations set to 0."""
    def as_built(_: Ops, p: Any) -> Any:
        changes: dict[str, Any] = {}
        for variable, scales, shifts in deviations:
            deviation = value_of(p, variable.name)
            changes[variable.name] = 0.0
            for name in scales:
                nominal = value_of(p, name)
                changes[name] = (tuple(x * (1.0 + deviation) for x in nominal) if isinstance(nominal, tuple)
                                 else nominal * (1.0 + deviation))
            for name in shifts:
                changes[name] = value_of(p, name) + deviation
        return with_values(p, changes)

    return as_built
