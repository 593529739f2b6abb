"""The hydraulic unit as built: lever, fin, friction and valve differ from what its controller knows.

    actual = nominal (1 + deviation)        the lever's assembly angle: nominal + deviation

Deviations act on the plant alone. Of oil, cylinder and line the controller knows nothing: these vary by themselves.
"""

from __future__ import annotations

from typing import Any

from ...namespace import with_values
from ...ops.base import Ops
from ...variables import parameter
from ..electromechanical import as_built as electromechanical
from ..electromechanical.as_built import nominal as nominal

LEVER_AND_FRICTION = (*electromechanical.LEVER, *electromechanical.FIN, *electromechanical.COULOMB,
                      *electromechanical.VISCOUS)
(MOTOR,) = electromechanical.MOTOR
RATED_FLOW = parameter("deviation.valve.rated_flow", "1", -0.9, 10.0, "rated flow as built over nominal, less 1")


def lever_and_friction(p: Any) -> Any:
    """Return the parameters of the plant, but for a valve's, or a motor's and a pump's."""
    off = p.deviation
    dry, wet = 1.0 + off.friction.coulomb, 1.0 + off.friction.viscous
    return with_values(p, {
        **nominal(*LEVER_AND_FRICTION),
        "kinematics.moment_arm": p.kinematics.moment_arm * (1.0 + off.kinematics.moment_arm),
        "kinematics.initial_angle": p.kinematics.initial_angle + off.kinematics.initial_angle,
        "mass.fin": p.mass.fin * (1.0 + off.mass.fin),
        "inertia.fin": p.inertia.fin * (1.0 + off.mass.fin),
        "friction.fin_coulomb": p.friction.fin_coulomb * dry,
        "cylinder.coulomb_friction": p.cylinder.coulomb_friction * dry,
        "friction.fin_viscous": p.friction.fin_viscous * wet,
        "cylinder.viscous_friction": p.cylinder.viscous_friction * wet,
    })


def with_valve(_: Ops, p: Any) -> Any:
    """Return the parameters of the plant with a valve."""
    flow = p.valve.rated_flow * (1.0 + p.deviation.valve.rated_flow)
    return with_values(lever_and_friction(p), {"deviation.valve.rated_flow": 0.0, "valve.rated_flow": flow})


def with_pump(_: Ops, p: Any) -> Any:
    """Return the parameters of the plant with motor and pump."""
    off, pump = p.deviation, p.pump
    flux, dry, wet = (1.0 + x for x in (off.motor.torque_constant, off.friction.coulomb, off.friction.viscous))
    return with_values(lever_and_friction(p), {
        MOTOR.name: 0.0,
        "motor.torque_constant": p.motor.torque_constant * flux,
        "motor.back_emf_constant": p.motor.back_emf_constant * flux,
        "pump.coulomb_friction": pump.coulomb_friction * dry,
        "pump.pressure_friction": pump.pressure_friction * dry,
        "pump.viscous_friction": pump.viscous_friction * wet,
    })
