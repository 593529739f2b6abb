"""Capabilities of actuators, in words for messages: extensions and tools name those that they need."""

from __future__ import annotations

from collections.abc import Mapping

MOTOR_CURRENT = "a motor current"
CURRENT_LOOP = "a current loop"
CURRENT_LIMIT = "a limit of the motor current"
VOLTAGE_LIMIT = "a supply that limits the motor voltage"
RETURNS_POWER = "a motor that returns power to its supply"
COULOMB_FRICTION = "Coulomb friction at the motor"
RIGID_DRIVE_LINE = "a rigid drive line"
BACKLASH = "backlash"
SCREW_LOAD = "a screw without losses"
REFERENCE_LIMIT = "a drive whose reference has a limit"
ENCODER = "an encoder on motor or fin"
SCREW_DRIVE = "motor, gear and hinge with their inertia and friction"
SCREW_AND_LEVER = "a screw and a lever"
COMMAND_REFERENCE = "a drive whose reference is the fin command"
POSITION_LOOP = "a sampled position loop"
CASCADE = "loops of position and velocity in cascade"
SUPPLY_VOLTAGE = "a supply voltage"
SUPPLY_PRESSURE = "a supply pressure"
AMBIENT_TEMPERATURE = "an ambient temperature"
DRIVE_STEP = "a motor current that the shared equations of the drive step"
SCREW_EQUATIONS = "loops and equation parameters of motor, screw and lever"

NEEDED_VARIABLES: Mapping[str, tuple[str, ...]] = {
    MOTOR_CURRENT: ("motor_current", "motor.resistance", "motor.torque_constant", "motor.back_emf_constant"),
    CURRENT_LOOP: ("drive.kp", "drive.ki", "drive.current_gain"),
    CURRENT_LIMIT: ("drive.current_limit",),
    VOLTAGE_LIMIT: ("supply_voltage", "motor_voltage", "motor.inductance"),
    RETURNS_POWER: ("motor_current", "motor_voltage"),
    COULOMB_FRICTION: ("friction.coulomb.positive[0]", "friction.coulomb.negative[0]"),
    RIGID_DRIVE_LINE: (),
    BACKLASH: ("drive_line.backlash",),
    SCREW_LOAD: ("screw.lead",),
    REFERENCE_LIMIT: ("drive.reference_limit",),
    ENCODER: ("encoder.pulses", "encoder.multiplier", "encoder.enabled"),
    SCREW_DRIVE: ("inertia.motor", "inertia.fin"),
    SCREW_AND_LEVER: ("screw.lead", "kinematics.moment_arm"),
    COMMAND_REFERENCE: (),
    POSITION_LOOP: (),
    CASCADE: ("controller.position.kp", "controller.velocity.kp"),
    SUPPLY_VOLTAGE: ("supply_voltage",),
    SUPPLY_PRESSURE: ("supply_pressure",),
    AMBIENT_TEMPERATURE: ("friction.temperature",),
    DRIVE_STEP: ("motor.resistance", "motor.torque_constant", "motor.back_emf_constant"),
    SCREW_EQUATIONS: ("drive.transport_delay", "inertia.motor"),
}
"""Every capability, with the inputs, outputs and parameters that an actuator with it has."""
NEEDED_STATES: Mapping[str, tuple[str, ...]] = {
    RIGID_DRIVE_LINE: ("motor_angle",),
    ENCODER: ("counts",),
    DRIVE_STEP: ("motor_speed", "motor_current", "drive_integral"),
    SCREW_EQUATIONS: ("integral", "velocity_integral"),
}
"""States that an actuator with the capability has."""
