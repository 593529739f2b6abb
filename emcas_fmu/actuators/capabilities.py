"""What an actuator may provide, in words that stand in messages: extensions and tools ask for it by name."""

from __future__ import annotations

MOTOR_CURRENT = "a motor current"
CURRENT_LOOP = "a current loop"
CURRENT_LIMIT = "a limit of the motor current"
VOLTAGE_LIMIT = "a supply that limits the motor voltage"
COULOMB_FRICTION = "Coulomb friction at the motor"
RIGID_DRIVE_LINE = "a rigid drive line"
DRIVE_LINE = "an elastic drive line"
BACKLASH = "backlash"
SCREW_LOAD = "a load on the screw"
REFERENCE_LIMIT = "a drive whose reference has a limit"
ENCODER = "an encoder on motor or fin"
SCREW_DRIVE = "motor, screw, lever and hinge with their inertia and friction"
COMMAND_REFERENCE = "a drive that takes the fin command itself"
POSITION_LOOP = "a sampled position loop"
SUPPLY_VOLTAGE = "a supply voltage"
