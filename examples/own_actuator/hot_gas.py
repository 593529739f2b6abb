"""A hot-gas actuator: gas generator, proportional valve, cylinder with rack and pinion, fin. Its edges choke.

    J d2(delta)/dt2 = A r (p_1 - p_2) + T_h - C          V_1 = V + A r delta      V_2 = V - A r delta
    dp_k/dt = n/V_k (E (m_in - m_out) - p_k dV_k/dt)     ds/dt = (u - s)/tau      E = R T
    m = c a p_u psi(p_d/p_u)                             psi(q) = sqrt(1 - ((q - b)/(1 - b))^2)

Through an edge with opening a, gas flows from p_u to p_d. Below the pressure ratio b the flow is choked, psi = 1; above
q_l it is laminar, psi proportional to 1 - q (ISO 6358-1), and above 1 it reverses. The spool s opens one edge of each
chamber; all edges have a clearance. Without `enable` the spool is centred. C is Coulomb friction, T_h the hinge moment.
A PI controller with feedback of the load pressure commands the spool. All values are estimates for 60 N.m at 5 MPa.
"""

from pathlib import Path

import emcas_fmu.declare as em

PARAMETERS = (
    em.parameter("cylinder.area", "m2", 1e-6, 1.0, "piston area, A"),
    em.parameter("cylinder.volume", "m3", 1e-8, 1.0, "volume of a chamber at mid-stroke, V"),
    em.parameter("rack.radius", "m", 1e-4, 1.0, "pitch radius of the pinion, r"),
    em.parameter("friction.fin", "N.m", 0.0, 1e3, "Coulomb friction of seals and hinge, C"),
    em.parameter("gas.energy", "J/kg", 1e3, 1e7, "gas constant times temperature, E"),
    em.parameter("gas.exponent", "1", 1.0, 2.0, "polytropic exponent, n"),
    em.parameter("gas.critical_ratio", "1", 0.1, 0.9, "pressure ratio below which an edge is choked, b"),
    em.parameter("gas.laminar_ratio", "1", 0.91, 0.9999, "pressure ratio from which an edge is laminar, q_l"),
    em.parameter("exhaust.pressure", "Pa", 1e3, 1e7, "pressure behind the exhaust"),
    em.parameter("valve.conductance", "kg/(s.Pa)", 1e-15, 1e-3, "ratio of choked flow to pressure of an open edge, c"),
    em.parameter("valve.clearance", "1", 1e-4, 0.5, "opening of every edge with the spool at 0"),
    em.parameter("valve.time_constant", "s", 1e-4, 1.0, "time constant of the spool, tau"),
    em.tunable("controller.kp", "1/rad", 0.0, 1e4, "proportional gain"),
    em.tunable("controller.ki", "1/(rad.s)", 0.0, 1e6, "integral gain"),
    em.tunable("controller.kd", "1/Pa", 0.0, 1e-3, "gain of the load-pressure feedback, for damping"),
)
ESTIMATES = {
    "cylinder.area": "16 cm^2", "cylinder.volume": "20 cm^3", "rack.radius": "20 mm", "friction.fin": "4 N*m",
    "inertia.fin": "0.05 kg*m^2", "gas.energy": "420 kJ/kg", "gas.exponent": 1.25, "gas.critical_ratio": 0.5,
    "gas.laminar_ratio": 0.98, "gas_supply.pressure": "5 MPa", "exhaust.pressure": "0.1 MPa", "valve.clearance": 0.1,
    "monitor.minimum_pressure": "3 MPa", "controller.ki": "40 1/(rad*s)", "valve.conductance": "3e-10 kg/(s*Pa)",
    "valve.time_constant": "2 ms", "solver.max_tick": "0.1 ms", "controller.kp": "8 1/rad", "controller.kd": "1 1/MPa"}
EDGES = ("in_1", "in_2", "out_1", "out_2")


def ends(p, x, u):
    """Return the pressures before and behind every edge."""
    one, two, exhaust = x.pressure_1, x.pressure_2, p.exhaust.pressure
    return dict(zip(EDGES, ((u.supply, one), (u.supply, two), (one, exhaust), (two, exhaust))))


def flow(ops, p, x, u, edge):
    """Return the mass flow [kg/s] through an edge; `u` has the edges' pressure ratios, limited to b and q_l."""
    (before, behind), b, laminar = ends(p, x, u)[edge], p.gas.critical_ratio, p.gas.laminar_ratio
    scaled = (getattr(u, edge) - b) / (1.0 - b)
    line = (1.0 - ops.maximum(behind / before, laminar)) / (1.0 - laminar)  # 1 up to q_l
    opening = p.valve.clearance + (u.toward_1 if edge in ("in_1", "out_2") else u.toward_1 - x.spool)
    return p.valve.conductance * opening * before * ops.sqrt(1.0 - scaled * scaled) * line


def sample(ops, p, x, inputs):
    """Return the command of the spool, the integral and the flag of a limit at a sample."""
    c = p.controller
    error = em.fin_port.clipped_command(ops, p, inputs.command) - x.fin_angle
    demand = c.kp * error + x.integral - c.kd * (x.pressure_1 - x.pressure_2)
    limited = ops.fabs(demand) > 1.0
    moved = x.integral + ops.where(limited, 0.0, c.sample_time * c.ki * error)
    return {"reference": ops.where(inputs.enable, ops.clip(demand, -1.0, 1.0), 0.0),
            "integral": ops.where(inputs.enable, moved, 0.0), "limited": ops.where(limited, 1.0, 0.0)}


def derivatives(ops, p, x, u):
    swept, (in_1, in_2, out_1, out_2) = p.cylinder.area * p.rack.radius, (flow(ops, p, x, u, edge) for edge in EDGES)
    moment = swept * (x.pressure_1 - x.pressure_2) + em.fin_port.hinge_torque(ops, p, x.fin_angle, u) - u.friction
    rise_1 = p.gas.energy * (in_1 - out_1) - x.pressure_1 * swept * x.fin_rate
    rise_2 = p.gas.energy * (in_2 - out_2) + x.pressure_2 * swept * x.fin_rate
    bulk_1, bulk_2 = (p.gas.exponent / (p.cylinder.volume + way * swept * x.fin_angle) for way in (1.0, -1.0))
    return {"fin_angle": x.fin_rate, "fin_rate": moment / em.fin_port.hinge_inertia(p),
            "pressure_1": bulk_1 * rise_1, "pressure_2": bulk_2 * rise_2,
            "spool": (ops.where(u.enabled, u.reference, 0.0) - x.spool) / p.valve.time_constant}


def output_values(ops, p, x, u):
    drawn = p.gas.energy * (flow(ops, p, x, u, "in_1") + flow(ops, p, x, u, "in_2"))
    return {"pressure_1": x.pressure_1, "pressure_2": x.pressure_2, "supply_power": drawn}


ACTUATOR = em.Actuator(
    name="hot-gas", title="hot-gas cylinder with rack and pinion", parameters=PARAMETERS, values=ESTIMATES,
    states=(*em.FIN, em.State("pressure_1", "Pa"), em.State("pressure_2", "Pa"), em.State("spool")),
    outputs=tuple(em.real_output(f"pressure_{k}", "Pa", f"pressure in chamber {k}", 1e6) for k in (1, 2)),
    supply=em.Supply.pressure("gas_supply.pressure", "pressure of the gas generator"),
    descriptions={"enable": "false: the spool is centred; the gas in the chambers holds the fin, and leaks"},
    provides=frozenset({em.capabilities.POSITION_LOOP, em.capabilities.SUPPLY_PRESSURE}),
    initial=lambda ops, p, start, u: {"pressure_1": 0.8 * u.supply, "pressure_2": 0.8 * u.supply},
    sample=sample, derivatives=derivatives, output_values=output_values, controller_states=(em.State("integral"),),
    discontinuities=(
        *(em.Limit(edge, lambda ops, p, x, u, edge=edge: ends(p, x, u)[edge][1] / ends(p, x, u)[edge][0],
                "gas.laminar_ratio", "gas.critical_ratio", saturates=False) for edge in EDGES),
        em.Limit("toward_1", lambda ops, p, x, u: x.spool, 1.0, 0.0, saturates=False),
        em.Coulomb("friction", "fin_rate", "friction.fin")),
    reference=Path(__file__).with_name("hot_gas_reference.py"),
)
