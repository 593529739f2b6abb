"""A servo motor on a strain-wave gear that winds up under load; motor and fin have dry friction and may stick.

    J_m dw/dt = K_t i - C_m - T/N      w = motor rate       T = k_2 a + (k_1 - k_2) a' + b da/dt
    J_f d2(delta)/dt2 = T + T_h - C_f                       a = motor angle/N - delta, the wind-up; |a'| <= a_1
    L di/dt = v - R i - K_e w                               v = k_c (i_r - i) + K_e w, within the supply

C_m and C_f are Coulomb friction, T_h is the hinge moment; the gear has the stiffness k_1 up to a_1, and k_2 beyond. A
PI controller with speed feedback computes the current reference i_r from the motor's angle; while i_r is limited, the
integral is constant. All values are estimates for a hinge moment of 100 N.m on 48 V.
"""

from pathlib import Path

import emcas_fmu.declare as em

PARAMETERS = (
    em.parameter("gear.ratio", "1", 30.0, 320.0, "turns of the motor per turn of the fin, N"),
    em.parameter("gear.stiffness", "N.m/rad", 1.0, 1e6, "stiffness of the gear under a small torque, k_1"),
    em.parameter("gear.stiffness_loaded", "N.m/rad", 1.0, 1e6, "stiffness of the gear under a large torque, k_2"),
    em.parameter("gear.soft_windup", "rad", 0.0, 0.1, "wind-up to which the small stiffness applies, a_1"),
    em.parameter("gear.damping", "N.m.s/rad", 0.0, 1e4, "damping of the wind-up, b"),
    em.parameter("friction.motor", "N.m", 0.0, 10.0, "Coulomb friction of motor and wave generator, C_m"),
    em.parameter("friction.fin", "N.m", 0.0, 1e3, "Coulomb friction of the hinge, C_f"),
    em.parameter("inertia.motor", "kg.m2", 1e-9, 1.0, "inertia of rotor and wave generator, J_m"),
    em.parameter("motor.torque_constant", "N.m/A", 1e-6, 1e3, "torque constant, K_t"),
    em.parameter("motor.back_emf_constant", "V.s/rad", 1e-6, 1e3, "back-EMF constant, K_e"),
    em.parameter("motor.resistance", "Ohm", 1e-6, 1e4, "winding resistance, R"),
    em.parameter("motor.inductance", "H", 1e-7, 10.0, "winding inductance, L"),
    em.parameter("drive.kp", "V/A", 0.0, 1e3, "gain of the current loop, k_c"),
    em.parameter("drive.current_limit", "A", 0.1, 1e3, "largest current reference"),
    em.tunable("controller.kp", "A/rad", 0.0, 1e6, "proportional gain from the error of the fin angle"),
    em.tunable("controller.ki", "A/(rad.s)", 0.0, 1e7, "integral gain from the error of the fin angle"),
    em.tunable("controller.kd", "A.s/rad", 0.0, 1e5, "gain of the speed feedback, from the fin rate"),
)
ESTIMATES = {
    "gear.ratio": 100, "gear.stiffness": "8000 N*m/rad", "gear.stiffness_loaded": "14000 N*m/rad",
    "gear.soft_windup": "0.002 rad", "gear.damping": "8 N*m*s/rad", "friction.motor": "0.05 N*m",
    "friction.fin": "3 N*m", "inertia.fin": "0.05 kg*m^2", "inertia.motor": "1.2e-4 kg*m^2",
    "motor.torque_constant": "0.09 N*m/A", "motor.back_emf_constant": "0.09 V*s/rad", "motor.resistance": "0.3 Ohm",
    "motor.inductance": "0.4 mH", "drive.kp": "2 V/A", "drive.current_limit": "30 A", "drive.supply_voltage": "48 V",
    "controller.kp": "1200 A/rad", "controller.ki": "6000 A/(rad*s)", "controller.kd": "26 A*s/rad",
    "solver.max_tick": "0.1 ms",
}
MOTOR_CURRENT = em.real_output("motor_current", "A", "motor current", 10.0)
WINDUP = em.real_output("windup", "rad", "wind-up of the gear", 1e-3)


def windup(ops, p, x, u):
    return x.motor_angle / p.gear.ratio - x.fin_angle


def demand(ops, p, x, u):
    """Return the current loop's voltage before the limit; a disabled drive shorts the winding."""
    loop = p.drive.kp * (u.reference - x.motor_current) + p.motor.back_emf_constant * x.motor_rate
    return ops.where(u.enabled, loop, 0.0)


def sample(ops, p, x, inputs):
    """Return the current reference, the measured angle, the integral and the flag of a limit at a sample."""
    c, limit, angle = p.controller, p.drive.current_limit, x.motor_angle / p.gear.ratio
    error = em.fin_port.clipped_command(ops, p, inputs.command) - angle
    current = c.kp * error + x.integral - c.kd * x.motor_rate / p.gear.ratio
    limited = ops.fabs(current) > limit
    moved = x.integral + ops.where(limited, 0.0, c.sample_time * c.ki * error)
    return {"reference": ops.where(inputs.enable, ops.clip(current, -limit, limit), 0.0), "measured_fin_angle": angle,
            "integral": ops.where(inputs.enable, moved, 0.0), "limited": ops.where(limited, 1.0, 0.0)}


def derivatives(ops, p, x, u):
    torque = (p.gear.stiffness_loaded * windup(ops, p, x, u) + (p.gear.stiffness - p.gear.stiffness_loaded) * u.soft
              + p.gear.damping * (x.motor_rate / p.gear.ratio - x.fin_rate))
    motor = p.motor.torque_constant * x.motor_current - u.motor_friction - torque / p.gear.ratio
    fin = torque + em.fin_port.hinge_torque(ops, p, x.fin_angle, u) - u.fin_friction
    rise = u.voltage - p.motor.resistance * x.motor_current - p.motor.back_emf_constant * x.motor_rate
    return {"motor_angle": x.motor_rate, "motor_rate": motor / p.inertia.motor - u.alpha_y, "fin_angle": x.fin_rate,
            "fin_rate": fin / em.fin_port.hinge_inertia(p), "motor_current": rise / p.motor.inductance}


ACTUATOR = em.Actuator(
    name="strain-wave", title="servo motor on a strain-wave gear with wind-up and sticking",
    states=(*em.FIN, em.State("motor_angle", "rad"), em.State("motor_rate", "rad/s"), em.State("motor_current", "A")),
    controller_states=(em.State("integral", "A"),),
    parameters=PARAMETERS, values=ESTIMATES, outputs=(MOTOR_CURRENT, WINDUP),
    supply=em.Supply.voltage(inverse_inductance=lambda ops, p: 1.0 / p.motor.inductance),
    provides=frozenset({em.capabilities.POSITION_LOOP, em.capabilities.CURRENT_LIMIT}),
    initial=lambda ops, p, start: {"motor_angle": p.gear.ratio * start.fin_angle},
    sample=sample, derivatives=derivatives,
    imperfections={"compliance": {"gear.stiffness": 1e6, "gear.stiffness_loaded": 1e6}},
    discontinuities=(
        em.Limit("voltage", demand, lambda ops, p, x, u: u.supply),
        em.Limit("soft", windup, "gear.soft_windup", saturates=False),
        em.Coulomb("motor_friction", "motor_rate", "friction.motor"),
        em.Coulomb("fin_friction", "fin_rate", "friction.fin")),
    output_values=lambda ops, p, x, u: {
        "motor_current": x.motor_current, "windup": windup(ops, p, x, u), "supply_power": u.voltage * x.motor_current},
    reference=Path(__file__).with_name("strain_wave_reference.py"),
)
