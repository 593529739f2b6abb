"""An actuator of the tests' own, for :mod:`emcas_fmu.steppers.events`: a fin on a spring, with dry friction and stops.

    J d2(delta)/dt2 = -k delta - C sgn(d(delta)/dt) + T
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

from emcas_fmu.actuators import fin_port
from emcas_fmu.actuators.declaration import Actuator, PlantInputs, State, Values
from emcas_fmu.namespace import Record
from emcas_fmu.ops.base import Ops, Value
from emcas_fmu.physics import stick
from emcas_fmu.steppers import events
from emcas_fmu.variables import parameter


def _torque(p: Any, x: Record, u: PlantInputs) -> Value:
    return u.aero_torque - p.spring.stiffness * x.fin_angle


def _mode(ops: Ops, p: Any, x: Record, u: PlantInputs, h: Value) -> Record:
    return Record(slide=stick.slide(ops, x.fin_rate, _torque(p, x, u), p.friction.fin_coulomb, x.fin_angle,
                                    p.fin.stop_angle))


def _rates(ops: Ops, p: Any, x: Record, u: PlantInputs, m: Record) -> Values:
    rate = (_torque(p, x, u) - m.slide.direction * p.friction.fin_coulomb) / p.inertia.fin
    return {"fin_angle": x.fin_rate, "fin_rate": stick.moves(ops, m.slide, rate)}


def _margins(ops: Ops, p: Any, x: Record, u: PlantInputs, m: Record) -> Values:
    return {"fin": stick.margin(ops, m.slide, x.fin_rate, _torque(p, x, u)),
            "stop": stick.stop_margin(ops, m.slide, x.fin_angle, p.fin.stop_angle)}


def _landed(ops: Ops, p: Any, begin: Record, x: Record, u: PlantInputs, m: Record, lost: Values) -> Values:
    halted = ops.both(ops.negate(ops.equal(m.slide.direction, 0.0)), ops.either(lost["fin"], lost["stop"]))
    return {"fin_rate": stick.speed_after(ops, m.slide, begin.fin_rate, x.fin_rate, halted),
            "fin_angle": ops.where(lost["stop"], m.slide.direction * p.fin.stop_angle, x.fin_angle)}


SYSTEM = events.Switched(_mode, _rates, _margins, _landed)


def step(ops: Ops, p: Any, x: Record, u: PlantInputs, h: Value) -> tuple[Values, Value]:
    moved, used = events.advance(ops, p, SYSTEM, x, u, h)
    return vars(moved), used


def output_values(ops: Ops, p: Any, x: Record, u: PlantInputs) -> Values:
    return {
        "fin_angle": x.fin_angle, "fin_rate": x.fin_rate,
        "hinge_torque": fin_port.hinge_torque(ops, p, x.fin_angle, u),
        "tracking_error": fin_port.clipped_command(ops, p, u.command) - x.fin_angle,
        "measured_fin_angle": u.measured_fin_angle, "saturated": u.limited > 0.0,
        "at_stop": ops.fabs(x.fin_angle) >= fin_port.stop_edge(p),
    }


ACTUATOR = Actuator(
    name="stick-slip",
    title="fin on a spring with dry friction",
    states=(State("fin_angle", "rad"), State("fin_rate", "rad/s")),
    outputs=fin_port.OUTPUTS,
    parameters=(*fin_port.PARAMETERS,
                parameter("spring.stiffness", "N.m/rad", 0.0, 1e6, "stiffness of the spring"),
                parameter("friction.fin_coulomb", "N.m", 0.0, 1e3, "dry friction")),
    step=step,
    output_values=output_values,
    files=(Path(__file__).with_suffix(".toml"),),
    modules=(sys.modules[__name__],),
)
