"""States, groups, and order of the outputs of the hydraulic actuators."""

from __future__ import annotations

from collections.abc import Callable
from math import inf
from typing import Any

from ...control import fluid_power
from ...namespace import Record
from ...ops.base import Ops, Value
from ...physics import cylinder, mechanics
from ...rules import SLACK, rule, when
from ...variables import only, parameter, real_output, tunable
from .. import as_built, capabilities, fin_port
from ..composition import Composition, Group, Output, port
from ..declaration import PlantInputs, State, Values
from ..electromechanical import groups

CHAMBERS = (State("pressure_1", "Pa", "in the chamber that turns the fin to positive angles"),
            State("pressure_2", "Pa", "in the chamber that turns the fin to negative angles"))
CONTROLLER = (State("integral", "m/s", "integral of the position controller"),
              State("piston", "m", "piston displacement as read at the last sample"))

LEVER = groups.LEVER.reworded({"the screw axis": "the piston's axis"})
POSITION_LOOP = Group(only(groups.POSITION_LOOP.parameters, "controller.position.kp", "controller.position.ki",
                           "controller.position.setpoint_weight"), provides=(capabilities.POSITION_LOOP,)).reworded(
    {"the thesis's PI": "PI control"})
HINGE = port(measured_fin_angle="fin angle that the controllers read from the transducer at the last sample")


def friction(coulomb: tuple[str, ...] = (), viscous: tuple[str, ...] = ()) -> Group:
    """Return the group of friction about the hinge, with deviations of fin and friction.

    The deviations of friction also scale the parameters `coulomb` and `viscous`. Other parameters of oil, cylinder and
    line have no deviations: studies vary them directly, as the feedback uses none of them but cylinder.area.
    """
    return Group(only((*groups.HINGE.parameters, *groups.HINGE_FRICTION.parameters), "friction."), deviations=(
        as_built.FIN, as_built.COULOMB.scaling(*mechanics.HINGE_DRY, "cylinder.coulomb_friction", *coulomb),
        as_built.VISCOUS.scaling(*mechanics.HINGE_VISCOUS, "cylinder.viscous_friction", *viscous)))


@rule("cylinder.dead_volume = %.6g m3 must be more than the volume that the piston sweeps to a stop, %.6g m3 with "
      "cylinder.area = %.6g m2; raise it, or lower cylinder.area, kinematics.moment_arm or fin.stop_angle",
      scanned=True)
def _stroke(ops: Ops, p: Any, share: Value) -> tuple[Value, ...]:
    swept = p.cylinder.area * ops.fabs(cylinder.piston_position(ops, p, share * p.fin.stop_angle))
    dead = p.cylinder.dead_volume
    return when(ops, swept >= dead * (1.0 - SLACK)) * swept, dead, swept, p.cylinder.area


def filled_cylinder(least: float = -inf) -> Group:
    """Return the group of cylinder, oil and transducer; `least` is the smallest possible pressure [Pa] of a chamber."""
    return Group((
        parameter("cylinder.area", "m2", 1e-7, 1.0, "area of the piston on each side, A",
                  sheet="cylinder: effective piston area"),
        parameter("cylinder.dead_volume", "m3", 1e-9, 1.0, "volume of a chamber with its line at fin_angle 0, V_0",
                  sheet="cylinder: volume of a chamber with its line, at mid-stroke"),
        parameter("cylinder.moving_mass", "kg", 0.0, 1e3, "mass that moves with the piston",
                  sheet="cylinder: mass of piston, rod and parts that move with them"),
        parameter("cylinder.viscous_friction", "N.s/m", 0.0, 1e7, "viscous friction of the piston, b_p"),
        parameter("cylinder.coulomb_friction", "N", 0.0, 1e6, "dry friction of the piston's seals",
                  sheet="cylinder: breakaway force, without pressure"),
        parameter("cylinder.internal_leakage", "m3/(s.Pa)", 0.0, 1e-6, "leakage across the piston, C_ip",
                  sheet="cylinder: leakage across the piston over pressure"),
        parameter("oil.bulk_modulus", "Pa", 1e6, 1e11, "effective bulk modulus of oil, air and walls, beta",
                  sheet="oil: bulk modulus, including air and walls", quantity="BulkModulus"),
        parameter("check_valve.conductance", "m3/(s.Pa)", 0.0, 1e-6,
                  "conductance of the check valve that refills a chamber, K_cv"),
        parameter("transducer.resolution", "rad", 0.0, 0.1, "resolution of the fin angle's transducer (0: ideal)",
                  sheet="encoder: resolution of the fin's angle")), (
        Output(real_output("piston_position", "m", "piston displacement from its position at fin_angle 0", 0.01),
               lambda ops, p, m: cylinder.piston_position(ops, p, m.fin)),
        Output(real_output("pressure_1", "Pa", "pressure in the chamber that turns the fin to positive angles", 1e7,
                           minimum=least)),
        Output(real_output("pressure_2", "Pa", "pressure in the chamber that turns the fin to negative angles", 1e7,
                           minimum=least))),
        (_stroke,), terminal="hydraulics", imperfections={as_built.ENCODER: {"transducer.resolution": 0.0}})


AIR = tunable("share", "1", 1e-3, 1.0, "share of the bulk modulus that is left")  # amount of the fault `air`
_OUTPUT_ORDER = (*(v.name for v in fin_port.OUTPUTS), "piston_position", "pressure_", "motor_speed", "motor_current",
                 "motor_voltage", "motor_torque", "drive_reference", "valve_", "supply_", "current_error")


def composed(moment: Callable[[Ops, Any, Record, PlantInputs], tuple[Any, Record]], delay: Group, friction: Group,
             *further: Group) -> Composition:
    """Return the composition of groups, with the outputs in the order of hydraulic actuators."""
    return Composition((LEVER, delay, POSITION_LOOP, friction, HINGE, *further), moment, (), _OUTPUT_ORDER)


def initial(ops: Ops, p: Any, start: Record, pressure: Value) -> Values:
    """Return the states at rest at a fin angle, with both chambers at a `pressure` [Pa]."""
    measured = fluid_power.measured(ops, p, start.fin_angle)
    return {"fin_angle": start.fin_angle, "pressure_1": pressure, "pressure_2": pressure,
            "integral": fluid_power.at_rest(ops, p, measured),
            "piston": cylinder.piston_position(ops, p, measured), "measured_fin_angle": measured}
