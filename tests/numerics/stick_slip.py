"""A test actuator: a fin on a spring, with dry friction and stops.

    J d2(delta)/dt2 = -k delta - C sgn(d(delta)/dt) + T
"""

from typing import Any

from emcas_fmu.actuators.declaration import FIN, Actuator, Values
from emcas_fmu.namespace import Record
from emcas_fmu.ops.base import Ops
from emcas_fmu.steppers.discontinuities import Coulomb
from emcas_fmu.variables import parameter


def derivatives(ops: Ops, p: Any, x: Record, u: Record) -> Values:
    torque = u.aero_torque - p.spring.stiffness * x.fin_angle - u.friction
    return {"fin_angle": x.fin_rate, "fin_rate": torque / p.inertia.fin}


ACTUATOR = Actuator(
    name="stick-slip", title="fin on a spring with dry friction", states=FIN,
    parameters=(parameter("spring.stiffness", "N.m/rad", 0.0, 1e6, "stiffness of the spring"),
                parameter("friction.fin_coulomb", "N.m", 0.0, 1e3, "dry friction")),
    values={"spring.stiffness": 600.0, "friction.fin_coulomb": 24.0, "inertia.fin": 0.06}, derivatives=derivatives,
    discontinuities=(Coulomb("friction", "fin_rate", "friction.fin_coulomb"),),
)
