"""A torque motor on the hinge, without gear, against a spring that centres the fin.

    J d2(delta)/dt2 = K_t i - k delta - b d(delta)/dt + T        L di/dt = v - R i - K_e d(delta)/dt

J is the inertia of rotor, fin, shaft and fork; T is the hinge moment of aerodynamics and of the vehicle's motion
(gravity, acceleration, rotation). A PI controller with damping computes the demand u:

    u = k_p (b_c delta_c - delta) + I - k_d d(delta)/dt          dI/dt = k_i (delta_c - delta)

The voltage v is u, clipped at the supply and held for a sample time; while u is clipped, I is constant. The extension
faults can demagnetise the motor: the magnets then have only a share of their flux. Every value is an estimate for a
hinge moment of 100 N.m on 39 V.
"""

from pathlib import Path

import emcas_fmu.declare as em

PARAMETERS = (
    em.parameter("hinge.damping", "N.m.s/rad", 0.0, 1e3, "viscous friction about the hinge, b"),
    em.parameter("spring.stiffness", "N.m/rad", 0.0, 1e5, "stiffness of the centring spring, k"),
    em.parameter("motor.inertia", "kg.m2", 0.0, 1e3, "inertia of the rotor about the hinge"),
    em.parameter("motor.torque_constant", "N.m/A", 1e-6, 1e3, "torque constant, K_t"),
    em.parameter("motor.back_emf_constant", "V.s/rad", 0.0, 1e3, "back-EMF constant, K_e"),
    em.parameter("motor.resistance", "Ohm", 1e-6, 1e4, "winding resistance, R"),
    em.parameter("motor.inductance", "H", 1e-7, 10.0, "winding inductance, L"),
    em.tunable("controller.kp", "V/rad", 0.0, 1e6, "proportional gain, k_p"),
    em.tunable("controller.ki", "V/(rad.s)", 0.0, 1e7, "integral gain, k_i"),
    em.tunable("controller.kd", "V.s/rad", 0.0, 1e5, "damping gain, k_d"),
    em.tunable("controller.setpoint_weight", "1", 0.0, 1.0, "weight of the command in the proportional part, b_c"),
)
ESTIMATES = {
    "hinge.damping": "0.2 N*m*s/rad", "spring.stiffness": "20 N*m/rad", "inertia.fin": "0.05 kg*m^2",
    "mass.fin": "3 kg", "center_of_mass.fin.x": "-30 mm", "motor.inertia": "0.01 kg*m^2",
    "motor.torque_constant": "4 N*m/A", "motor.back_emf_constant": "4 V*s/rad", "motor.resistance": "0.5 Ohm",
    "motor.inductance": "0.5 mH", "controller.kp": "400 V/rad", "controller.ki": "6000 V/(rad*s)",
    "controller.kd": "0 V*s/rad", "controller.setpoint_weight": 0.92, "drive.supply_voltage": "39 V",
    "fault.demagnetised.share": 0.6,
    "solver.max_tick": "0.1 ms"}  # a tenth of L/R: within 0.0001 deg of the independent integration
MOTOR_CURRENT = em.real_output("motor_current", "A", "motor current", 10.0)
MOTOR_VOLTAGE = em.real_output("motor_voltage", "V", "voltage on the winding", 10.0)


def sample(ops, p, x, inputs):
    """Return the voltage reference, the integral and the flag of a limit at a sample; 0 V while disabled."""
    c = p.controller
    command = em.fin_port.clipped_command(ops, p, inputs.command)
    demand = c.kp * (c.setpoint_weight * command - x.fin_angle) + x.integral - c.kd * x.fin_rate
    voltage = ops.clip(demand, -inputs.supply, inputs.supply)
    clipped = ops.fabs(demand) > inputs.supply
    moved = x.integral + ops.where(clipped, 0.0, c.sample_time * c.ki * (command - x.fin_angle))
    limited = ops.either(clipped, ops.fabs(inputs.command) > p.command.limit)
    return {"reference": ops.where(inputs.enable, voltage, 0.0), "integral": ops.where(inputs.enable, moved, 0.0),
            "limited": ops.where(ops.both(inputs.enable, limited), 1.0, 0.0)}


def voltage(ops, u):
    """Return the voltage on the winding: the reference within the supply's limits, 0 V while disabled."""
    return ops.where(u.enabled, ops.clip(u.reference, -u.supply, u.supply), 0.0)


def derivatives(ops, p, x, u):
    """Return d/dt of every state. A disabled amplifier shorts the winding, which brakes the fin."""
    load = em.fin_port.hinge_torque(ops, p, x.fin_angle, u) - p.motor.inertia * u.alpha_y  # the rotor turns, too
    torque = (p.motor.torque_constant * x.current + load - p.spring.stiffness * x.fin_angle
              - p.hinge.damping * x.fin_rate)
    rise = voltage(ops, u) - p.motor.resistance * x.current - p.motor.back_emf_constant * x.fin_rate
    inertia = p.motor.inertia + em.fin_port.hinge_inertia(p)
    return {"fin_angle": x.fin_rate, "fin_rate": torque / inertia, "current": rise / p.motor.inductance}


def output_values(ops, p, x, u):
    """Return the outputs in addition to the port's."""
    return {"motor_current": x.current, "motor_voltage": voltage(ops, u), "supply_power": voltage(ops, u) * x.current}


ACTUATOR = em.Actuator(
    name="direct-drive",
    title="direct-drive torque motor on the hinge, against a spring",
    states=(*em.FIN, em.State("current", "A")),
    controller_states=(em.State("integral", "V"),),
    parameters=PARAMETERS,
    values=ESTIMATES,
    outputs=(MOTOR_CURRENT, MOTOR_VOLTAGE),
    supply=em.Supply.voltage(inverse_inductance=lambda ops, p: 1.0 / p.motor.inductance),
    equal_parameters=(("motor.torque_constant", "motor.back_emf_constant"),),
    provides=frozenset({em.capabilities.POSITION_LOOP}),
    sample=sample,
    derivatives=derivatives,
    output_values=output_values,
    faults=(em.PlantFault.scaling("demagnetised", "the magnets have permanently lost a share of their flux",
                                  em.tunable("share", "1", 0.0, 1.0, "of the flux that is left"),
                                  "motor.torque_constant", "motor.back_emf_constant", lasting=True),),
    reference=Path(__file__).with_name("direct_drive_reference.py"),
)
