"""Capabilities of actuators, each a phrase for messages: extensions and tools name the capabilities that they need.

An actuator that provides a capability declares the variables and states below. Some capabilities also need parameters
of shared equations (:mod:`emcas_fmu.physics`), which the actuator declares or its ``equation_parameters`` return.
"""

from __future__ import annotations

NEEDED_VARIABLES: dict[str, tuple[str, ...]] = {}
"""For every capability the inputs, outputs and entries of the parameter file that an actuator with it declares."""
NEEDED_STATES: dict[str, tuple[str, ...]] = {}
"""For every capability the states that an actuator with it declares."""
NEEDED_PARAMETERS: dict[str, tuple[str, ...]] = {}
"""For every capability the parameters of shared equations that an actuator with it has."""


def _capability(words: str, *variables: str, states: tuple[str, ...] = (), shared: tuple[str, ...] = ()) -> str:
    """Register a capability, and return its phrase."""
    NEEDED_VARIABLES[words], NEEDED_STATES[words], NEEDED_PARAMETERS[words] = variables, states, shared
    return words


_MECHANICS = ("kinematics.moment_arm", "screw.lead", "inertia.motor", "friction.viscous.positive",
              "friction.viscous.negative", "friction.fin_viscous")
OF_LOOP = ("motor.inductance", "drive.kp", "drive.ki", "drive.current_gain")
"""Parameters that a capability implies only for a drive whose structure has a current loop."""

MOTOR_CURRENT = _capability("a motor current that follows from winding parameters", "motor_current",
                            "motor.resistance", "motor.torque_constant", "motor.back_emf_constant")
PROPORTIONAL_TORQUE = _capability("a torque in proportion to the motor current", "motor_current", "motor_torque",
                                  "motor.torque_constant")
CURRENT_LOOP = _capability("a current loop", "drive.kp", "drive.ki", "drive.current_gain", "motor_voltage",
                           shared=("drive.current_gain",))
CURRENT_LIMIT = _capability("a limit of the motor current", "drive.current_limit")
VOLTAGE_LIMIT = _capability("a current loop whose voltage the supply limits", "supply_voltage", "drive.supply_voltage",
                            "motor_voltage", "motor.inductance")
RETURNS_POWER = _capability("a motor that returns power to its supply", "motor_current", "motor_voltage")
COULOMB_FRICTION = _capability("friction.coulomb at the motor", "friction.coulomb.positive[0]",
                               "friction.coulomb.negative[0]")
DRY_FRICTION = _capability("friction.coulomb at the motor and friction.fin_coulomb at the hinge",
                           "friction.coulomb.positive[0]", "friction.table.coulomb[0]", "friction.fin_coulomb",
                           "motor_speed",
                           states=("motor_angle", "motor_speed"))
RIGID_DRIVE_LINE = _capability("a rigid drive line", "motor_angle", "motor_speed", states=("motor_angle",))
MOTOR_SHAFT = _capability("a motor shaft fixed to its screw or worm", "motor_angle", "motor_speed")
BACKLASH = _capability("backlash", "drive_line.backlash")
SCREW_LOAD = _capability("a screw without losses", "screw.lead", "motor_speed", "motor_torque", shared=_MECHANICS)
REFERENCE_LIMIT = _capability("a drive whose analogue reference has a limit", "drive.reference_limit")
ENCODER = _capability("an incremental encoder on motor or fin", "encoder.pulses", "encoder.multiplier",
                      "encoder.enabled", states=("counts",))
SCREW_DRIVE = _capability("motor, gear and hinge with their inertia and friction", "inertia.motor", "inertia.fin",
                          shared=_MECHANICS)
SCREW_AND_LEVER = _capability("a screw and a lever", "screw.lead", "kinematics.moment_arm", shared=_MECHANICS)
COMMAND_REFERENCE = _capability("a drive whose reference is the fin command")
DUTY_REFERENCE = _capability("a drive whose reference is the duty cycle of a PWM", "pwm.limit", "pwm.full")
POSITION_LOOP = _capability("a sampled position loop")
CASCADE = _capability("loops of position and velocity in cascade", "controller.position.kp", "controller.position.ki",
                      "controller.velocity.kp")
SUPPLY_VOLTAGE = _capability("a supply voltage", "supply_voltage")
SUPPLY_PRESSURE = _capability("a supply pressure", "supply_pressure")
AMBIENT_TEMPERATURE = _capability("an ambient temperature", "friction.temperature")
DRIVE_STEP = _capability("a motor current stepped by the shared equations of the drive", "motor.resistance",
                         "motor.torque_constant", "motor.back_emf_constant", "motor_speed", "motor_torque",
                         states=("motor_speed", "motor_current", "drive_integral"),
                         shared=OF_LOOP)
PHASES = _capability("motor phases on a bridge, the only part that `enable` switches", "motor.resistance",
                     "motor.inductance", "motor.torque_constant", "motor.back_emf_constant",
                     states=("motor_angle", "motor_speed", "motor_current", "drive_integral"), shared=OF_LOOP)
SCREW_EQUATIONS = _capability("loops and equation parameters of motor, screw and lever", "drive.transport_delay",
                              "drive_reference", "inertia.motor", states=("integral", "velocity_integral"),
                              shared=(*_MECHANICS, "controller.position.kp", "controller.position.ki",
                                      "controller.velocity.kp", "motor.torque_constant"))
