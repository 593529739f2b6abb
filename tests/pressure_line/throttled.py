"""A fin on a rotary hydraulic motor behind a valve, the simplest load of a pressure line.

    d(delta)/dt = w        dw/dt = (Q_r u sqrt(p/p_r)/D - w)/tau        Q = Q_r |u| sqrt(p/p_r)        P = p Q

The valve's opening u, from -1 to 1, is proportional to the error at the last sample. Loads do not move the fin.
"""

from emcas_fmu.actuators import fin_port
from emcas_fmu.actuators.declaration import Actuator, State, Supply
from emcas_fmu.variables import parameter, real_input, real_output

PARAMETERS = (
    *fin_port.PARAMETERS,
    parameter("valve.rated_flow", "m3/s", 0.0, 1.0, "flow through the open valve at its rated pressure, Q_r"),
    parameter("valve.rated_pressure", "Pa", 1.0, 1e9, "pressure p_r"),
    parameter("valve.gain", "1/rad", 0.0, 1e6, "opening for an error"),
    parameter("motor.displacement", "m3/rad", 1e-9, 1.0, "volume that turns the fin by 1 rad, D"),
    parameter("motor.time_constant", "s", 1e-5, 10.0, "lag of the rate, tau"),
)
SUPPLY_PRESSURE = real_input("supply_pressure", "Pa", "pressure at the valve", minimum=0.0, maximum=1e8, nominal=1e7,
                             start=None, key="hydraulic_supply.pressure")
SUPPLY_POWER = real_output("supply_power", "W", "hydraulic power drawn: pressure times flow", 100.0)


def sample(ops, p, x, inputs):
    """Return the valve's opening, proportional to the error; 0 while disabled."""
    error = fin_port.clipped_command(ops, p, inputs.command) - x.fin_angle
    return {"reference": ops.where(inputs.enable, ops.clip(p.valve.gain * error, -1.0, 1.0), 0.0)}


def flow(ops, p, u):
    """Return the flow [m3/s] through the valve, with the opening's sign."""
    return p.valve.rated_flow * u.reference * ops.sqrt(ops.maximum(u.supply, 0.0) / p.valve.rated_pressure)


def derivatives(ops, p, x, u):
    """Return d/dt of both states."""
    driven = flow(ops, p, u) / p.motor.displacement
    return {"fin_angle": x.fin_rate, "fin_rate": (driven - x.fin_rate) / p.motor.time_constant}


def output_values(ops, p, x, u):
    """Return every output."""
    return {
        "fin_angle": x.fin_angle,
        "fin_rate": x.fin_rate,
        "hinge_torque": fin_port.hinge_torque(ops, p, x.fin_angle, u),
        "tracking_error": fin_port.clipped_command(ops, p, u.command) - x.fin_angle,
        "measured_fin_angle": u.measured_fin_angle,
        "saturated": ops.fabs(u.sampled_reference) >= 1.0,
        "at_stop": ops.fabs(x.fin_angle) >= fin_port.stop_edge(p),
        "supply_power": ops.maximum(u.supply, 0.0) * ops.fabs(flow(ops, p, u)),
    }


ACTUATOR = Actuator(
    name="throttled",
    title="fin on a hydraulic motor behind a valve",
    states=(State("fin_angle", "rad"), State("fin_rate", "rad/s")),
    parameters=PARAMETERS,
    outputs=(*fin_port.OUTPUTS, SUPPLY_POWER),
    supply=Supply(SUPPLY_PRESSURE, SUPPLY_POWER),
    sample=sample,
    derivatives=derivatives,
    output_values=output_values,
)
