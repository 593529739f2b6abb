"""The unit as built: it differs from the nominal parameters, which are all that its controllers know.

    actual = nominal (1 + deviation)        the lever's assembly angle: nominal + deviation

Deviations act on the plant alone. A motor whose flux is off has both constants off. With all of them 0 the controllers
know the plant exactly.
"""

from __future__ import annotations

from math import radians
from typing import Any

from ...namespace import with_values
from ...ops.base import Ops
from ...variables import Variable, in_group, parameter

LEVER = in_group(
    "deviation",
    parameter("kinematics.moment_arm", "1", -0.5, 0.5, "moment arm as built over nominal, less 1"),
    parameter("kinematics.initial_angle", "rad", radians(-10.0), radians(10.0),
              "assembly angle of the lever as built, less nominal"),
)
SCREW = in_group("deviation", parameter("screw.lead", "1", -0.5, 0.5, "screw lead as built over nominal, less 1"))
MOTOR = in_group("deviation", parameter("motor.torque_constant", "1", -0.5, 0.5,
                                        "torque and back-EMF constant as built over nominal, less 1"))
FIN = in_group("deviation", parameter("mass.fin", "1", -0.9, 10.0,
                                      "mass and inertia of the fin as built over nominal, less 1"))
COULOMB = in_group("deviation", parameter("friction.coulomb", "1", -1.0, 10.0,
                                          "Coulomb friction as built over nominal, less 1"))
VISCOUS = in_group("deviation", parameter("friction.viscous", "1", -1.0, 10.0,
                                          "viscous friction as built over nominal, less 1"))


def nominal(*deviations: Variable) -> dict[str, float]:
    """Return the values of deviations that make a unit nominal."""
    return {v.name: 0.0 for v in deviations}


NOMINAL = nominal(*LEVER, *SCREW, *MOTOR, *FIN, *COULOMB, *VISCOUS)


def as_built(_: Ops, p: Any) -> Any:
    """Return the parameters of the plant, without further deviations."""
    off, coulomb, viscous = p.deviation, p.friction.coulomb, p.friction.viscous
    flux, dry, wet = (1.0 + x for x in (off.motor.torque_constant, off.friction.coulomb, off.friction.viscous))
    return with_values(p, {
        **NOMINAL,
        "kinematics.moment_arm": p.kinematics.moment_arm * (1.0 + off.kinematics.moment_arm),
        "kinematics.initial_angle": p.kinematics.initial_angle + off.kinematics.initial_angle,
        "screw.lead": p.screw.lead * (1.0 + off.screw.lead),
        "motor.torque_constant": p.motor.torque_constant * flux,
        "motor.back_emf_constant": p.motor.back_emf_constant * flux,
        "mass.fin": p.mass.fin * (1.0 + off.mass.fin),
        "inertia.fin": p.inertia.fin * (1.0 + off.mass.fin),
        "friction.coulomb.positive": tuple(c * dry for c in coulomb.positive),
        "friction.coulomb.negative": tuple(c * dry for c in coulomb.negative),
        "friction.fin_coulomb": p.friction.fin_coulomb * dry,
        "friction.viscous.positive": viscous.positive * wet,
        "friction.viscous.negative": viscous.negative * wet,
        "friction.fin_viscous": p.friction.fin_viscous * wet,
    })
