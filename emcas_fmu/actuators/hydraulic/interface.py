"""States, variables, deviations, rules and outputs that the hydraulic actuators share."""

from __future__ import annotations

from typing import Any

from ...control import fluid_power
from ...namespace import Record
from ...ops.base import Ops, Value
from ...physics import cylinder
from ...rules import SLACK, Rule, when
from ...variables import only, parameter, real_output, tunable
from .. import as_built, fin_port
from ..declaration import PlantInputs, State, Values
from ..electromechanical import nonlinear

FIN = (State("fin_angle", "rad"), State("fin_rate", "rad/s"))
CHAMBERS = (State("pressure_1", "Pa", "in the chamber that turns the fin to positive angles"),
            State("pressure_2", "Pa", "in the other one"))
CONTROLLER = (State("integral", "m/s", "of the position controller"),
              State("piston", "m", "as read at the last sample"))

PRESSURES = (
    real_output("pressure_1", "Pa", "pressure in the chamber that turns the fin to positive angles", 1e7),
    real_output("pressure_2", "Pa", "pressure in the chamber that turns the fin to negative angles", 1e7),
)
OUTPUTS = (
    *fin_port.described({
        "measured_fin_angle": "fin angle the controllers read from its transducer at the last sample"}),
    real_output("piston_position", "m", "piston displacement from its position at fin_angle 0", 0.01),
    *PRESSURES,
)
# The controllers know nothing of oil, cylinder and line: these have no deviations: their values vary.
DEVIATIONS = (as_built.MOMENT_ARM, as_built.INITIAL_ANGLE, as_built.FIN,
              as_built.COULOMB.scaling("friction.fin_coulomb", "cylinder.coulomb_friction"),
              as_built.VISCOUS.scaling("friction.fin_viscous", "cylinder.viscous_friction"))
CYLINDER = (
    parameter("cylinder.area", "m2", 1e-7, 1.0, "area of the piston on both sides, A",
              sheet="cylinder: effective piston area"),
    parameter("cylinder.dead_volume", "m3", 1e-9, 1.0, "volume of a chamber with its line at fin_angle 0, V_0",
              sheet="cylinder: volume of a chamber with its line, at mid-stroke"),
    parameter("cylinder.moving_mass", "kg", 0.0, 1e3, "mass that moves with the piston",
              sheet="cylinder: mass of piston, rod and what moves along"),
    parameter("cylinder.viscous_friction", "N.s/m", 0.0, 1e7, "viscous friction of the piston, b_p"),
    parameter("cylinder.coulomb_friction", "N", 0.0, 1e6, "dry friction of the piston's seals",
              sheet="cylinder: breakaway force, without pressure"),
    parameter("cylinder.internal_leakage", "m3/(s.Pa)", 0.0, 1e-6, "leakage across the piston, C_ip",
              sheet="cylinder: leakage across the piston over pressure"),
    parameter("oil.bulk_modulus", "Pa", 1e6, 1e11, "effective bulk modulus of oil, air and walls, beta",
              sheet="oil: bulk modulus, with the air and the walls", quantity="BulkModulus"),
)
AIR = tunable("share", "1", 1e-3, 1.0, "of the bulk modulus that is left")  # amount of the fault `air`
CHECK_VALVE = parameter("check_valve.conductance", "m3/(s.Pa)", 0.0, 1e-6,
                        "conductance of the check valve that refills a chamber, K_cv")
TRANSDUCER = parameter("transducer.resolution", "rad", 0.0, 0.1, "step of the transducer of the fin angle (0: none)",
                       sheet="encoder: resolution of the fin's angle")
PARAMETERS = (
    *fin_port.described(
        {"kinematics.moment_arm": "distance of the hinge from the piston's axis, d"},
        only(nonlinear.COMPOSITION.parameters, "kinematics.", "friction.fin_", "drive.transport_delay",
             "controller.position.kp", "controller.position.ki", "controller.position.setpoint_weight")),
    *fin_port.PARAMETERS,
    *CYLINDER,
    CHECK_VALVE,
    TRANSDUCER,
)


def _stroke(ops: Ops, p: Any, share: Value) -> tuple[Value, ...]:
    swept = p.cylinder.area * ops.fabs(cylinder.piston_position(ops, p, share * p.fin.stop_angle))
    dead = p.cylinder.dead_volume
    return when(ops, swept >= dead * (1.0 - SLACK)) * swept, dead, swept, p.cylinder.area


STROKE_RULE = Rule(_stroke, "cylinder.dead_volume = %.6g m3 must be more than the piston sweeps up to a stop of the "
                            "fin, %.6g m3 with cylinder.area = %.6g m2; raise it, or lower cylinder.area, "
                            "kinematics.moment_arm or fin.stop_angle", scanned=True)


def initial(ops: Ops, p: Any, start: Record, pressure: Value) -> Values:
    """Return the states of fin, chambers and controller at rest at a fin angle, with a `pressure` [Pa]."""
    measured = fluid_power.measured(ops, p, start.fin_angle)
    return {"fin_angle": start.fin_angle, "pressure_1": pressure, "pressure_2": pressure,
            "integral": fluid_power.at_rest(ops, p, measured),
            "piston": cylinder.piston_position(ops, p, measured), "measured_fin_angle": measured}


def output_values(ops: Ops, p: Any, x: Record, u: PlantInputs, limited: Value) -> Values:
    """Return the values of :data:`OUTPUTS`, with parameters as built; `limited` says whether a limit is active."""
    return {
        "fin_angle": x.fin_angle,
        "fin_rate": x.fin_rate,
        "hinge_torque": fin_port.hinge_torque(ops, p, x.fin_angle, u),
        "tracking_error": fin_port.clipped_command(ops, p, u.command) - x.fin_angle,
        "measured_fin_angle": u.measured_fin_angle,
        "saturated": limited,
        "at_stop": ops.fabs(x.fin_angle) >= fin_port.stop_edge(p),
        "piston_position": cylinder.piston_position(ops, p, x.fin_angle),
        "pressure_1": x.pressure_1,
        "pressure_2": x.pressure_2,
    }
