"""A test actuator: a fin that a pressure moves, with inputs and states that no shipped actuator has.

    T d2(delta)/dt2 = p/p_0 k (delta_c - delta) - d(delta)/dt + drift

The step is the explicit midpoint rule without events. It suffices to test that both back ends compute the same, and
that inputs act at the time at which they change.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

from emcas_fmu.actuators import fin_port
from emcas_fmu.actuators.declaration import Actuator, PlantInputs, SampleInputs, State, Values
from emcas_fmu.namespace import Record
from emcas_fmu.ops.base import Ops, Value
from emcas_fmu.variables import boolean_input, parameter, real_input, real_output, tunable

RATED = 2e5  # Pa


def initial(ops: Ops, p: Any, start: Record) -> Values:
    return {"fin_angle": start.fin_angle, "measured_fin_angle": start.fin_angle, "gain": 1.0}


def sample(ops: Ops, p: Any, x: Record, inputs: SampleInputs) -> Values:
    boost = ops.where(inputs.boost, 2.0, 1.0)
    return {"reference": ops.where(inputs.enable, boost * fin_port.clipped_command(ops, p, inputs.command), 0.0),
            "samples": x.samples + 1.0, "gain": boost}


def _rates(p: Any, angle: Value, rate: Value, u: PlantInputs) -> tuple[Value, Value]:
    push = u.hydraulic_pressure / RATED * p.hydraulic.gain * u.gain * (u.reference - angle)
    return rate, (push - rate + u.drift + u.aero_torque * 1e-3) / p.hydraulic.time


def step(ops: Ops, p: Any, x: Record, u: PlantInputs, h: Value) -> tuple[Values, Value]:
    angle, rate = x.fin_angle, x.fin_rate
    d_angle, d_rate = _rates(p, angle, rate, u)
    d_angle, d_rate = _rates(p, angle + 0.5 * h * d_angle, rate + 0.5 * h * d_rate, u)
    stop = p.fin.stop_angle
    return {"fin_angle": ops.clip(angle + h * d_angle, -stop, stop), "fin_rate": rate + h * d_rate}, h


def output_values(ops: Ops, p: Any, x: Record, u: PlantInputs) -> Values:
    return {
        "fin_angle": x.fin_angle, "fin_rate": x.fin_rate,
        "hinge_torque": fin_port.hinge_torque(ops, p, x.fin_angle, u),
        "tracking_error": fin_port.clipped_command(ops, p, u.command) - x.fin_angle,
        "measured_fin_angle": u.measured_fin_angle, "saturated": u.limited > 0.0,
        "at_stop": ops.fabs(x.fin_angle) >= fin_port.stop_edge(p),
        "flow": u.hydraulic_pressure * x.fin_rate * 1e-6, "boosted": u.gain,
    }


ACTUATOR = Actuator(
    name="driven",
    title="fin moved by a pressure",
    states=(State("fin_angle", "rad"), State("fin_rate", "rad/s")),
    controller_states=(State("samples"),),
    sampled_states=(State("gain"),),
    # The Boolean, which only samples read, is first: inputs that act on the plant must be found at any position.
    further_inputs=(boolean_input("boost", "doubles gain and command", False),
                    real_input("hydraulic.pressure", "Pa", "pressure of the line", start=RATED),
                    real_input("drift", "rad/s", "speed at which the fin creeps")),
    outputs=(*fin_port.OUTPUTS, real_output("flow", "m3/s", "flow from the line", 1e-3),
             real_output("boosted", "1", "gain of the last sample", 1.0)),
    parameters=(*fin_port.PARAMETERS,
                tunable("hydraulic.gain", "1/s", 0.0, 1e3, "gain at the rated pressure"),
                parameter("hydraulic.time", "s", 1e-4, 1.0, "time constant of the rate")),
    initial=initial,
    sample=sample,
    step=step,
    output_values=output_values,
    files=(Path(__file__).with_suffix(".toml"),),
    modules=(sys.modules[__name__],),
)
