"""States, supply, order of variables and moment of all electromechanical actuators.

Each actuator is composed of groups (:mod:`emcas_fmu.actuators.electromechanical.groups`,
:mod:`emcas_fmu.actuators.composition`).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from ...namespace import Record
from ...ops.base import Ops, Value
from ...physics import kinematics, mechanics
from ...variables import real_input, real_output
from ..composition import Composition, Group
from ..declaration import PlantInputs, State, Supply

MOTOR_STATES = (State("motor_angle", "rad"), State("motor_speed", "rad/s"))
DRIVE = (State("motor_current", "A"), State("drive_integral", "V", "integral of the current controller, xi"))
CONTROLLER = (State("integral", "rad/s", "integral of the position controller"),
              State("velocity_integral", "V", "integral of the velocity controller"),
              State("target", "rad", "requested motor angle, lagged by the update time of the command"),
              State("momentum", "N.m.s", "momentum of the load observer"),
              State("counts", "1", "counts of the encoder of position at the last sample"),
              State("motor_counts", "1", "counts of the motor's encoder at the last sample"))

SUPPLY_VOLTAGE = real_input("supply_voltage", "V", "bus voltage of the drive", minimum=0.0, maximum=1000.0,
                            nominal=30.0, start=None, key="drive.supply_voltage",
                            sheet="drive: supply (DC-link) voltage")
SUPPLY_POWER = real_output("supply_power", "W", "electrical power from the supply to the motor; negative while "
                           "regenerating", 1000.0)


def rolling(inertia: str, torque: str = "the motor's torque") -> str:
    """Return the description of ``angular_acceleration.x``, which reduces a torque by its product with an inertia."""
    return (f"vehicle angular acceleration about body x, d/dt of angular_rate.x; times {inertia} it reduces {torque}, "
            "whose positive angle is right-handed about body x")


INPUT_DESCRIPTIONS = {
    "acceleration.x": "vehicle acceleration along body x (forward, along the screw), at the point from which "
                      "mounting.station is measured",
    "angular_acceleration.x": rolling("inertia.motor + inertia.screw"),
    "enable": "false opens the drive's bridge: only loads and friction act on the fin",
}

# K_e w i = K_t i w: the power that leaves the circuit is the power on the shaft.
EQUAL = (("motor.torque_constant", "motor.back_emf_constant"),)
SUPPLY = Supply(SUPPLY_VOLTAGE, SUPPLY_POWER, lambda ops, p: 1.0 / p.motor.inductance)
TICK_REMEDY = "raise solver.max_tick or motor.inductance, or lower drive.ki"

PARAMETER_ORDER = (
    "worm.", "inertia.worm", "kinematics.", "screw.", "inertia.motor", "inertia.screw", "inertia.", "mass.nut",
    "mass.", "center_of_mass.", "motor.torque_constant", "motor.back_emf_constant", "motor.resistance",
    "motor.inductance", "drive.current_limit", "drive.current_gain", "drive.current_offset",
    "drive.transport_delay", "drive.kp", "drive.ki", "drive.reference_limit", "controller.sample_time",
    "controller.position.", "controller.velocity.", "controller.load_observer", "controller.antiwindup",
    "controller.drive_antiwindup", "controller.speed_limit", "command.limit", "fin.", "friction.viscous.",
    "friction.coulomb.", "friction.table.temperature", "friction.table.viscous", "friction.table.coulomb",
    "friction.identified_", "friction.temperature", "friction.fin_viscous", "friction.fin_coulomb",
    "compensation.", "encoder.", "loads.", "mounting.", "deviation.kinematics.", "deviation.screw.",
    "deviation.motor.", "deviation.mass.", "deviation.friction.coulomb", "deviation.friction.viscous",
    "command.", "solver.", "motor.pole_pairs", "deviation.worm.", "pwm.", "load.", "drive_line.")
OUTPUT_ORDER = (
    "fin_angle", "fin_rate", "motor_angle", "screw_angle", "screw_speed", "motor_speed", "motor_current",
    "motor_voltage", "motor_torque", "drive_reference", "nut_position", "hinge_torque", "supply_power",
    "braking_power", "tracking_error", "measured_fin_angle", "saturated", "at_stop", "current_error", "coil_current",
    "clutch_torque", "slip_power", "clutch_temperature", "worm_loss", "screw_loss")


def composed(moment: Callable[[Ops, Any, Record, PlantInputs], tuple[Any, Record]], *groups: Group) -> Composition:
    """Return the composition of groups, with the variables in the order of electromechanical actuators."""
    return Composition(groups, moment, PARAMETER_ORDER, OUTPUT_ORDER)


def moment(ops: Ops, p: Any, x: Record, u: PlantInputs, angle: Value, speed: Value, **further: Value) -> Record:
    """Return the values from which the groups compute their outputs, with parameters as built.

    `angle` [rad] and `speed` [rad/s] are the fin's, referred to the motor. The result also has `tangent`, that of the
    lever's angle, `fin`, the fin's angle [rad], and `hinge_torque`, the external moment [N.m]. `further` values are
    `limited`, whether a limit is active; `nut`, the screw angle at the nut [rad], if it differs from `angle`; values
    that only some groups use, such as `motor_current` [A] and `motor_voltage` [V].
    """
    tangent = kinematics.lever_tangent(ops, p, angle)
    fin, hinge_torque = kinematics.fin_angle(ops, p, tangent), mechanics.external_moment(ops, p, tangent, u)
    return Record(**{"x": x, "u": u, "nut": angle, "speed": speed, "tangent": tangent, "fin": fin,
                     "hinge_torque": hinge_torque, **further})
