"""What electromechanical actuators share: states, supply, and the groups that an actuator is put together from.

An actuator is a tuple of groups (:class:`Parts`). A group (:mod:`.groups`) has what goes together: parameters, their
rules, outputs with their equations. The order of groups is that of their rules; variables stand in the order of the
interface (:data:`PARAMETER_ORDER`, :data:`OUTPUT_ORDER`), those that are not in it behind, as the groups have them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property, wraps
from typing import Any, NamedTuple

from ...namespace import Record, with_values
from ...ops.base import Ops, Value
from ...physics import kinematics
from ...rules import Rule
from ...variables import Terminal, Variable, real_input, real_output
from ..declaration import PlantInputs, State, Supply, Values

# -- states ------------------------------------------------------------------------

MOTION = (State("motor_angle", "rad"), State("motor_speed", "rad/s"))
DRIVE = (State("motor_current", "A"), State("drive_integral", "V", "integral of the current controller, xi"))
CONTROLLER = (State("integral", "rad/s", "integral of the position controller"),
              State("velocity_integral", "V", "integral of the velocity controller"),
              State("target", "rad", "motor angle asked for, lagged by the update time of the command"),
              State("momentum", "N.m.s", "of the load observer"),
              State("counts", "1", "counts of the encoder of position at the last sample"),
              State("motor_counts", "1", "counts of the motor's encoder at the last sample"))

# -- supply ------------------------------------------------------------------------

SUPPLY_VOLTAGE = real_input("supply_voltage", "V", "bus voltage of the drive", minimum=0.0, maximum=1000.0,
                            nominal=30.0, start=None, key="drive.supply_voltage",
                            sheet="drive: supply (DC-link) voltage")
SUPPLY_POWER = real_output("supply_power", "W", "electrical power drawn by the motor; negative while regenerating",
                           1000.0)
INPUT_DESCRIPTIONS = {
    "acceleration.x": "vehicle acceleration along body x (forward, along the screw), where mounting.station "
                      "counts from",
    "angular_acceleration.x":
        "vehicle angular acceleration about body x, d/dt of angular_rate.x; times inertia.motor + inertia.screw it "
        "takes from the motor's torque, whose positive angle is right-handed about body x",
    "enable": "false opens the drive's bridge: the fin is driven by loads and friction only",
}

def _inverse_inductance(ops: Ops, p: Any) -> Value:
    return 1.0 / p.motor.inductance


def transport_delay(ops: Ops, p: Any) -> Value:
    """Return the time [s] from the DAC to the current reference."""
    return p.drive.transport_delay


# K_t i w = K_e w i: the power that leaves the circuit and the one on the shaft.
EQUAL = (("motor.torque_constant", "motor.back_emf_constant"),)
SUPPLY = Supply(SUPPLY_VOLTAGE, SUPPLY_POWER, _inverse_inductance)
TICK_REMEDY = "raise solver.max_tick or motor.inductance, or lower drive.ki"

# -- groups ------------------------------------------------------------------------


class Output(NamedTuple):
    """An output, and its equation of a moment (:func:`moment`); None of one that the actuator gives itself."""

    variable: Variable
    value: Callable[[Ops, Any, Record], Value] | None = None


@dataclass(frozen=True, eq=False)
class Group:
    """Parameters, rules and outputs that an actuator has together.

    `absent` are the values of its parameters with which equations are those of an actuator without the group.
    `wired` says whether its outputs are of the motor's terminal.
    """

    parameters: tuple[Variable, ...] = ()
    outputs: tuple[Output, ...] = ()
    rules: tuple[Rule, ...] = ()
    absent: Mapping[str, Any] = field(default_factory=dict)
    wired: bool = True


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
    "command.", "solver.")
OUTPUT_ORDER = (
    "fin_angle", "fin_rate", "motor_angle", "screw_angle", "screw_speed", "motor_speed", "motor_current",
    "motor_voltage", "motor_torque", "drive_reference", "nut_position", "hinge_torque", "supply_power",
    "braking_power", "tracking_error", "measured_fin_angle", "saturated", "at_stop")


def _place(name: str, order: tuple[str, ...]) -> int:
    return next((i for i, prefix in enumerate(order) if name.startswith(prefix)), len(order))


@dataclass(frozen=True, eq=False)
class Parts:
    """The groups of an actuator."""

    groups: tuple[Group, ...]

    @cached_property
    def parameters(self) -> tuple[Variable, ...]:
        """The parameters in the interface's order."""
        return tuple(sorted((v for group in self.groups for v in group.parameters),
                            key=lambda v: _place(v.name, PARAMETER_ORDER)))

    @cached_property
    def _outputs(self) -> tuple[Output, ...]:
        return tuple(sorted((out for group in self.groups for out in group.outputs),
                            key=lambda out: _place(out.variable.name, OUTPUT_ORDER)))

    @property
    def outputs(self) -> tuple[Variable, ...]:
        """The outputs in the interface's order."""
        return tuple(out.variable for out in self._outputs)

    @property
    def rules(self) -> tuple[Rule, ...]:
        """The rules, group by group."""
        return tuple(rule for group in self.groups for rule in group.rules)

    def terminals(self, description: str = "motor and drive") -> tuple[Terminal, ...]:
        """Return the terminal of the motor's side."""
        wired = {out.variable for group in self.groups if group.wired for out in group.outputs}
        return (Terminal("motor", description, tuple(v.name for v in self.outputs if v in wired)),)

    def shown(self, ops: Ops, p: Any, s: Record) -> Values:
        """Return the outputs that have an equation, at a moment `s`."""
        return {out.variable.name: out.value(ops, p, s) for out in self._outputs if out.value is not None}

    def completed(self, p: Any, optional: tuple[Group, ...]) -> Any:
        """Return parameters with the absent values of those that only `optional` groups have."""
        there = {v.name.partition("[")[0] for v in self.parameters}
        return with_values(p, {name: value for group in optional for name, value in group.absent.items()
                               if name not in there})


def moment(ops: Ops, p: Any, x: Record, u: PlantInputs, angle: Value, speed: Value, **further: Value) -> Record:
    """Return what outputs follow from: states `x`, what acts `u`, and of the fin, whose `angle` [rad] and `speed`
    [rad/s] are those referred to the motor, tan(phi) and angle.

    Further, `nut` [rad] is the angle of the screw at the nut, `current` [A] and `voltage` [V] are the motor's, and
    `saturated()` says whether a limit is met, and `stop` [rad] is the angle of the stop; an actuator gives what its
    outputs ask for.
    """
    tangent = kinematics.lever_tangent(ops, p, angle)
    return Record(x=x, u=u, speed=speed, tangent=tangent, fin=kinematics.fin_angle(ops, p, tangent), **further)


def with_parameters(equation: Callable[..., Any], change: Callable[[Ops, Any], Any]) -> Callable[..., Any]:
    """Return an actuator's equation with the parameters that `change` makes of those it is given."""
    @wraps(equation)
    def changed(ops: Ops, p: Any, *arguments: Value) -> Any:
        return equation(ops, change(ops, p), *arguments)

    return changed
