"""Groups, faults and stops of the actuators with electromagnetic clutches between motor and screw."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from ...namespace import Record, value_of
from ...ops.base import Ops, Value
from ...variables import parameter, real_output, tunable
from ..composition import Group, Output
from ..declaration import PlantFault, State, Values
from . import groups

SCREW = (State("screw_angle", "rad"), State("screw_speed", "rad/s"), State("motor_speed", "rad/s"))
TEMPERATURE = State("clutch_temperature", "degC")
SHAFT = Group(outputs=(
    Output(real_output("screw_angle", "rad", "screw angle", 10.0)),
    Output(real_output("screw_speed", "rad/s", "screw speed", 100.0, display="rpm"))))
CLUTCH_TEMPERATURE = Output(real_output("clutch_temperature", "degC", "temperature of the slipping surfaces", 100.0))
# The groups behind the clutches: screw and fin, with loops that control the screw.
_AT_SCREW = {"motor": "screw"}
SCREW_SIDE = (
    groups.LEVER, replace(groups.COULOMB, provides=()).reworded(_AT_SCREW), groups.ENCODER.reworded(_AT_SCREW),
    groups.SCREW, *groups.LOOPS, groups.VISCOUS.reworded(_AT_SCREW), groups.HINGE_FRICTION, SHAFT, groups.MOTOR,
    groups.COMPENSATION)
FRICTION = Group((
    parameter("motor.coulomb_friction", "N.m", 0.0, 10.0, "dry friction on the motor's side of the clutch"),
    parameter("motor.viscous_friction", "N.m.s/rad", 0.0, 10.0, "viscous friction on the motor's side of the clutch")))
CLUTCH = Group((
    parameter("clutch.rated_torque", "N.m", 1e-6, 1e4, "torque at which a clutch slips at its rated current, T_r",
              sheet="clutch: rated torque"),
    parameter("clutch.rated_current", "A", 1e-6, 1e3, "coil current for the rated torque, I_r",
              sheet="clutch: rated coil current"),
    parameter("clutch.residual", "1", 0.0, 0.99, "share of the rated torque that remains without current, r"),
    parameter("clutch.eddy_time", "s", 1e-6, 10.0, "time constant of eddy currents, t_e", display="ms"),
    parameter("clutch.driving_inertia", "kg.m2", 0.0, 10.0, "inertia of the driving side without the rotor",
              sheet="clutch: inertia of the driving side, with the gear"),
    parameter("clutch.driven_inertia", "kg.m2", 0.0, 10.0, "inertia of the driven side without the screw",
              sheet="clutch: inertia of the driven side"),
    parameter("clutch.temperature_coefficient", "1/K", -0.1, 0.1, "relative rise of the torque with temperature, a"),
    parameter("clutch.reference_temperature", "degC", -100.0, 1e3, "temperature for which the rated torque holds, T_0"),
    parameter("clutch.heat_capacity", "J/K", 1e-3, 1e6, "heat capacity of the slipping parts, C_th"),
    parameter("clutch.thermal_resistance", "K/W", 1e-6, 1e6,
              "thermal resistance from the slipping parts to the ambient, R_th"),
    parameter("coil.resistance", "Ohm", 1e-6, 1e6, "coil resistance", sheet="clutch: coil resistance"),
    parameter("coil.inductance", "H", 1e-7, 1e3, "coil inductance", sheet="clutch: coil inductance"),
    parameter("coil.suppression_voltage", "V", 0.0, 1e4, "clamping voltage of the coil's suppressor, V_c",
              sheet="drive: clamping voltage of the coil's suppressor")))
_BLOCKED = 1e6  # N.m: dry friction that no torque overcomes


def faults(jammed: str, opened: tuple[str, str], shares: tuple[str, ...]) -> tuple[PlantFault, ...]:
    """Return the faults of all actuators with clutches.

    `jammed` describes the effect of a blocked screw; `opened` contains the parameter that an open coil sets to 0, and
    the name of the coil's clutch; `shares` are the parameters that scale the clutches' torques.
    """
    def shorted(ops: Ops, p: Any, amounts: Any) -> Mapping[str, Value]:
        return {"coil.resistance": amounts.share * p.coil.resistance,
                "coil.inductance": amounts.share * amounts.share * p.coil.inductance,
                **{name: amounts.share * value_of(p, name) for name in shares}}

    return (
        PlantFault("jam", f"the screw is blocked; {jammed}", lambda ops, p, amounts: {
            "friction.fin_coulomb": _BLOCKED}),
        PlantFault("drag", "an open clutch drags", lambda ops, p, amounts: {"clutch.residual": amounts.share}, (
            tunable("share", "1", 0.0, 0.9, "share of the rated torque that remains without current"),)),
        PlantFault.scaling("powder_loss", "friction surfaces are permanently worn, or powder is lost",
                           tunable("share", "1", 0.0, 1.0, "share of the torque that is left"), *shares, lasting=True),
        PlantFault("coil_open", f"the coil of {opened[1]} is open: only the residual torque is left",
                   lambda ops, p, amounts: {opened[0]: 0.0}),
        PlantFault("coil_short", "turns of every coil are shorted", shorted, (
            tunable("share", "1", 0.05, 1.0, "share of the turns that are left"),)),
        PlantFault("overheating", "clutches lose torque as they heat", lambda ops, p, amounts: {
            "clutch.temperature_coefficient": -amounts.slope,
            "clutch.heat_capacity": amounts.capacity * p.clutch.heat_capacity}, (
                tunable("slope", "1/K", 0.0, 0.1, "relative fall of the torque with temperature"),
                tunable("capacity", "1", 0.01, 1.0, "share of the heat capacity that is effective"))),
    )


def rotor_inertia(p: Any) -> Value:
    """Return the inertia [kg.m2] of the motor and the driving side of its clutches."""
    return p.inertia.motor + p.clutch.driving_inertia


def as_cascade(x: Record, current: Value) -> Record:
    """Return the states that the loops use: the screw's as the motor's, and `current` [A] as the motor current."""
    return Record(**{**vars(x), "motor_angle": x.screw_angle, "motor_speed": x.screw_speed, "motor_current": current})


def stop_margin(ops: Ops, direction: Value, stops: tuple[Value, Value], angle: Value) -> Value:
    """Return the angle [rad] between the screw and the stop ahead of it; 1 while the screw is at rest."""
    low, high = stops
    ahead = ops.where(direction > 0.0, high - angle, angle - low)
    return ops.where(ops.equal(direction, 0.0), 1.0, ahead)


def stopped(ops: Ops, struck: Value, direction: Value, stops: tuple[Value, Value], x: Record, screw: Value,
            motor: Value) -> Values:
    """Return speeds and screw angle at the end of a step; `screw` and `motor` are the speeds [rad/s] without a stop.

    A stop that is `struck` brings the screw to rest at once; the motor keeps its speed, and the clutches slip. The
    screw may also have passed its stop at the end of a step without this event, or of a step to another event.
    """
    low, high = stops
    met = ops.either(struck, stop_margin(ops, direction, stops, x.screw_angle) <= 0.0)
    return {"screw_speed": ops.where(met, 0.0, screw), "motor_speed": ops.where(met, x.motor_speed, motor),
            "screw_angle": ops.where(met, ops.where(direction > 0.0, high, low), ops.clip(x.screw_angle, low, high))}
