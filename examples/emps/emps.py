"""EMPS, a ball-screw axis under a position and a velocity loop.

    M dv/dt = F - F_0 - F_f sign(v) + F_e       dq/dt = v           dF/dt = (g u - F)/tau
    F_f = (A + B (1 - exp(-|v|/v_1)) + C |v|) (1 + a (q - q_m) + b (q - q_m)^2) + D |F|
    u = k_v (k_p (q_c - q) - (q - q'')/(2 T)) + u_a, within +-10 V

q is the load's position, F the force of the motor and F_e an external force. The amplifier has the gain g and the lag
tau. The friction F_f grows with speed from A to A + B; C, D, a and b depend on the direction. At rest friction holds
the load, up to its value at v = 0. q'' is q two samples before; the voltage u_a is added to that of the loops.

The fin port's angle is the load's position through an arm of 1 m: 1 rad is 1 m, 1 N.m is 1 N, and 1 kg.m2 is 1 kg.
Loops and gain are those of the rig: Janot, Gautier, Brunot, "Data Set and Reference Models of EMPS", 2019. The plant's
values are identified from the first record of the rig (emps.toml).
"""

import emcas_fmu.declare as em

MIDDLE = 0.123  # m, middle of the travel, q_m
DIRECTIONS = (("positive", "forwards"), ("negative", "backwards"))

PARAMETERS = (
    em.parameter("friction.dry", "N.m", 0.0, 1e3, "friction at a speed near 0, A"),
    em.parameter("friction.build_up", "N.m", -1e3, 1e3, "growth of friction with speed, B; below 0 a decrease"),
    em.parameter("friction.build_up_rate", "rad/s", 1e-6, 10.0, "speed at which 63 % of the growth is reached, v_1"),
    *(em.parameter(f"friction.viscous_{name}", "N.m.s/rad", 0.0, 1e5, f"viscous friction {words}, C")
      for name, words in DIRECTIONS),
    *(em.parameter(f"friction.load_{name}", "1", 0.0, 1.0, f"share of the motor's force that is friction {words}, D")
      for name, words in DIRECTIONS),
    *(em.parameter(f"friction.slope_{name}", "1/rad", -10.0, 10.0, f"growth of friction along the screw {words}, a")
      for name, words in DIRECTIONS),
    *(em.parameter(f"friction.curvature_{name}", "1/rad2", -100.0, 100.0,
                   f"growth of friction to both ends of the screw {words}, b") for name, words in DIRECTIONS),
    em.parameter("axis.offset", "N.m", -1e3, 1e3, "constant force against positive motion, F_0"),
    em.parameter("drive.gain", "N.m/V", 1e-3, 1e4, "force of the motor per volt of the loops, g"),
    em.parameter("drive.lag", "s", 1e-6, 0.01, "time constant of the amplifier, tau", display="ms"),
    em.parameter("drive.voltage_limit", "V", 0.1, 1e3, "largest magnitude of the loops' voltage"),
    em.parameter("start.rate", "rad/s", -10.0, 10.0, "speed at the start"),
    em.parameter("start.voltage", "V", -1e3, 1e3, "voltage before the first sample"),
    em.tunable("controller.kp", "1/s", 0.0, 1e5, "gain of the position loop, k_p"),
    em.tunable("controller.kv", "V.s/rad", 0.0, 1e5, "gain of the velocity loop, k_v; with 0 the loops are open"),
)
OF_THE_RIG = {name: {"value": value, "source": "Janot, Gautier, Brunot 2019"} for name, value in (
    ("drive.gain", "35.15065188 N*m/V"), ("drive.voltage_limit", "10 V"), ("controller.sample_time", "1 ms"),
    ("controller.kp", "160.18 1/s"), ("controller.kv", "243.45 V*s/rad"))}
ESTIMATES = {
    "start.rate": 0.0, "start.voltage": 0.0, "command.limit": 0.25, "fin.stop_angle": 0.3,
    "solver.max_tick": "0.25 ms"}  # with ticks of 0.025 ms the force differs by 0.003 N (RMS)
ADDED_VOLTAGE = em.real_input("added_voltage", "V", "voltage that is added to that of the loops, u_a")
DRIVE_VOLTAGE = em.real_output("drive_voltage", "V", "amplifier's input voltage since the last sample, u", 10.0)


def sample(ops, p, x, inputs):
    """Return the amplifier's voltage and the controllers' states; the rate is a difference over two samples."""
    c, limit = p.controller, p.drive.voltage_limit
    rate = (x.fin_angle - x.before) / (2.0 * c.sample_time)
    command = em.fin_port.clipped_command(ops, p, inputs.command)
    voltage = c.kv * (c.kp * (command - x.fin_angle) - rate) + inputs.added_voltage
    return {"reference": ops.where(inputs.enable, ops.clip(voltage, -limit, limit), 0.0),
            "previous": x.fin_angle, "before": x.previous,
            "limited": ops.where(ops.both(inputs.enable, ops.fabs(voltage) > limit), 1.0, 0.0)}


def dry_friction(ops, p, x, u):
    """Return the friction that opposes motion, F_f."""
    f, speed, along = p.friction, ops.fabs(x.fin_rate), x.fin_angle - MIDDLE

    def by_direction(positive, negative):
        return ops.where(x.fin_rate < 0.0, negative, positive)

    sliding = (f.dry + f.build_up * (1.0 - ops.exp(-speed / f.build_up_rate))
               + speed * by_direction(f.viscous_positive, f.viscous_negative))
    factor = 1.0 + along * (by_direction(f.slope_positive, f.slope_negative)
                            + along * by_direction(f.curvature_positive, f.curvature_negative))
    return ops.maximum(sliding * factor, 0.0) + by_direction(f.load_positive, f.load_negative) * ops.fabs(x.force)


def derivatives(ops, p, x, u):
    """Return d/dt of every state; the force of a disabled amplifier decays to 0."""
    force = x.force - p.axis.offset + em.fin_port.hinge_torque(ops, p, x.fin_angle, u) - u.friction
    reference = p.drive.gain * ops.where(u.enabled, u.reference, 0.0)
    return {"fin_angle": x.fin_rate, "fin_rate": force / em.fin_port.hinge_inertia(p),
            "force": (reference - x.force) / p.drive.lag}


def initial(ops, p, start):
    """Return the states at a start in motion; the positions before it are those of a constant speed."""
    step = p.start.rate * p.controller.sample_time
    return {"fin_rate": p.start.rate, "force": p.drive.gain * p.start.voltage,
            "previous": start.fin_angle - step, "before": start.fin_angle - 2.0 * step}


ACTUATOR = em.Actuator(
    name="emps",
    title="ball-screw axis with position and velocity loops, as a fin with an arm of 1 m",
    states=(*em.FIN, em.State("force", "N.m")),
    controller_states=(em.State("previous", "rad"), em.State("before", "rad")),
    parameters=PARAMETERS,
    values=OF_THE_RIG | ESTIMATES,
    outputs=(DRIVE_VOLTAGE,),
    further_inputs=(ADDED_VOLTAGE,),
    descriptions={"fin_command": "commanded position, 1 rad for 1 m", "aero_torque": "external force, 1 N.m for 1 N"},
    provides=frozenset({em.capabilities.POSITION_LOOP}),
    initial=initial,
    sample=sample,
    derivatives=derivatives,
    discontinuities=(em.Coulomb("friction", "fin_rate", dry_friction),
                     em.Stop("fin_angle", "fin_rate", "fin.stop_angle")),
    output_values=lambda ops, p, x, u: {"drive_voltage": u.sampled_reference},
)
