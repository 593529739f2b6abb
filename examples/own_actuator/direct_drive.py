"""A torque motor on the hinge, without gear, against a spring that centres the fin.

    J d2(delta)/dt2 = K_t i - k delta - b d(delta)/dt + T        L di/dt = v - R i - K_e d(delta)/dt

J is that of rotor, fin, shaft and fork, and T the hinge moment of aerodynamics and of the vehicle's motion: gravity,
acceleration, rotation. A PI controller with damping asks for the voltage v:

    u = k_p (b_c delta_c - delta) + I - k_d d(delta)/dt          dI/dt = k_i (delta_c - delta)

It is held for a sample time and clipped at the supply; while it is clipped, the integral waits. A fault of its kind,
for the extension faults: magnets that have lost a share of their flux.
"""

from pathlib import Path

from emcas_fmu.actuators import capabilities, fin_port
from emcas_fmu.actuators.declaration import Actuator, PlantFault, State, Supply
from emcas_fmu.variables import parameter, real_input, real_output, tunable

PARAMETERS = (
    *fin_port.PARAMETERS,
    parameter("hinge.damping", "N.m.s/rad", 0.0, 1e3, "viscous friction about the hinge, b"),
    parameter("spring.stiffness", "N.m/rad", 0.0, 1e5, "stiffness of the centring spring, k"),
    parameter("motor.inertia", "kg.m2", 0.0, 1e3, "inertia of the rotor about the hinge"),
    parameter("motor.torque_constant", "N.m/A", 1e-6, 1e3, "torque constant, K_t"),
    parameter("motor.back_emf_constant", "V.s/rad", 0.0, 1e3, "back-EMF constant, K_e"),
    parameter("motor.resistance", "Ohm", 1e-6, 1e4, "winding resistance, R"),
    parameter("motor.inductance", "H", 1e-7, 10.0, "winding inductance, L"),
    tunable("controller.kp", "V/rad", 0.0, 1e6, "proportional gain, k_p"),
    tunable("controller.ki", "V/(rad.s)", 0.0, 1e7, "integral gain, k_i"),
    tunable("controller.kd", "V.s/rad", 0.0, 1e5, "damping gain, k_d"),
    tunable("controller.setpoint_weight", "1", 0.0, 1.0, "weight of the command in the proportional part, b_c"),
)
SUPPLY_VOLTAGE = real_input("supply_voltage", "V", "bus voltage of the amplifier", minimum=0.0, maximum=1000.0,
                            nominal=10.0, start=None, key="drive.supply_voltage")
SUPPLY_POWER = real_output("supply_power", "W", "electrical power drawn by the motor; negative while regenerating",
                           100.0)
MOTOR_CURRENT = real_output("motor_current", "A", "motor current", 10.0)
MOTOR_VOLTAGE = real_output("motor_voltage", "V", "voltage on the winding", 10.0)


def sample(ops, p, x, inputs):
    """Ask for a voltage, once a sample time; nothing while disabled."""
    c = p.controller
    command = fin_port.clipped_command(ops, p, inputs.command)
    demand = c.kp * (c.setpoint_weight * command - x.fin_angle) + x.integral - c.kd * x.fin_rate
    voltage = ops.clip(demand, -inputs.supply, inputs.supply)
    clipped = ops.fabs(demand) > inputs.supply
    moved = x.integral + ops.where(clipped, 0.0, c.sample_time * c.ki * (command - x.fin_angle))
    limited = ops.either(clipped, ops.fabs(inputs.command) > p.command.limit)
    return {"reference": ops.where(inputs.enable, voltage, 0.0), "integral": ops.where(inputs.enable, moved, 0.0),
            "limited": ops.where(ops.both(inputs.enable, limited), 1.0, 0.0)}


def voltage(ops, u):
    """Return the voltage on the winding: that asked for, as far as the supply reaches; none while disabled."""
    return ops.where(u.enabled, ops.clip(u.reference, -u.supply, u.supply), 0.0)


def derivatives(ops, p, x, u):
    """Return d/dt of every state. A disabled amplifier shorts the winding, which brakes the fin."""
    load = fin_port.hinge_torque(ops, p, x.fin_angle, u) - p.motor.inertia * u.alpha_y  # the rotor turns, too
    torque = (p.motor.torque_constant * x.current + load - p.spring.stiffness * x.fin_angle
              - p.hinge.damping * x.fin_rate)
    rise = voltage(ops, u) - p.motor.resistance * x.current - p.motor.back_emf_constant * x.fin_rate
    inertia = p.motor.inertia + fin_port.hinge_inertia(p)
    return {"fin_angle": x.fin_rate, "fin_rate": torque / inertia, "current": rise / p.motor.inductance}


def output_values(ops, p, x, u):
    """Return every output."""
    return {
        "fin_angle": x.fin_angle,
        "fin_rate": x.fin_rate,
        "hinge_torque": fin_port.hinge_torque(ops, p, x.fin_angle, u),
        "tracking_error": fin_port.clipped_command(ops, p, u.command) - x.fin_angle,
        "measured_fin_angle": u.measured_fin_angle,
        "saturated": u.limited > 0.0,
        "at_stop": ops.fabs(x.fin_angle) >= fin_port.stop_edge(p),
        "motor_current": x.current,
        "motor_voltage": voltage(ops, u),
        "supply_power": voltage(ops, u) * x.current,
    }


def demagnetised(ops, p, amounts):
    """Return the constants of a motor whose magnets have lost flux."""
    return {"motor.torque_constant": amounts.share * p.motor.torque_constant,
            "motor.back_emf_constant": amounts.share * p.motor.back_emf_constant}


ACTUATOR = Actuator(
    name="direct-drive",
    title="direct-drive torque motor on the hinge, against a spring",
    states=(State("fin_angle", "rad"), State("fin_rate", "rad/s"), State("current", "A")),
    controller_states=(State("integral", "V"),),
    parameters=PARAMETERS,
    outputs=(*fin_port.OUTPUTS, MOTOR_CURRENT, MOTOR_VOLTAGE, SUPPLY_POWER),
    supply=Supply(SUPPLY_VOLTAGE, SUPPLY_POWER, lambda ops, p: 1.0 / p.motor.inductance),
    equal_parameters=(("motor.torque_constant", "motor.back_emf_constant"),),
    provides=frozenset({capabilities.POSITION_LOOP}),
    sample=sample,
    derivatives=derivatives,
    output_values=output_values,
    faults=(PlantFault("demagnetised", "the magnets have permanently lost a share of their flux", demagnetised, (
        tunable("share", "1", 0.0, 1.0, "of the flux that is left"),), lasting=True),),
    reference=Path(__file__).with_name("direct_drive_reference.py"),
)
