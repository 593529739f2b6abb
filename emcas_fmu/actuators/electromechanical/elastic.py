"""The nonlinear actuator with an elastic drive line and a gap between nut and fork.

Rotor and fin have an angle each; the fin's angle is referred to the motor (:mod:`emcas_fmu.physics.drive_line`).
Without compliance and gap every step is that of the nonlinear actuator.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable
from dataclasses import replace
from typing import Any

from ...namespace import Record
from ...ops.base import Ops, Value
from ...physics import drive, drive_line, friction, loads, mechanics
from ...physics.structure import Structure
from ...rules import rule, when
from ...steppers import elastic as elastic_stepper
from ...steppers import rigid
from ...steppers.elastic import Pair
from ...steppers.electrical import Motor, states
from ...variables import Variable, in_group, parameter
from .. import capabilities
from ..as_built import BACKLASH, COMPLIANCE
from ..composition import Group
from ..declaration import PlantInputs, State, Values
from . import groups, interface, nonlinear, plausibility
from .nonlinear import as_built

FIN_SIDE = ("fin_side_angle", "fin_side_speed")
STATES = (*interface.MOTOR_STATES, *interface.DRIVE,
          State(FIN_SIDE[0], "rad", "of the fin, referred to the motor"),
          State(FIN_SIDE[1], "rad/s", "of the fin, referred to the motor"))
_MOST_COMPLIANT = 1e100  # rad/(N.m), far beyond any real part; results computed from it stay finite
SHAFT = replace(groups.SHAFT, provides=(capabilities.MOTOR_SHAFT,)).reworded(
    {"motor angle": "angle of the rotor (indirect fin angle, by lever and screw)"})


@rule("drive_line.fork_stiffness = %.6g, drive_line.shaft_stiffness = %.6g and drive_line.structure_stiffness = %.6g "
      "N.m/rad: the compliance about the hinge is %.6g rad/(N.m), more than 1e+100; raise the smallest stiffness, "
      "or set it to 0 (rigid)")
def stiff_hinge(ops: Ops, p: Any, _: Value) -> tuple[Value, ...]:
    line = p.drive_line
    compliance = drive_line.hinge_compliance(ops, p)
    too_soft = ops.negate(compliance <= _MOST_COMPLIANT)
    return when(ops, too_soft), line.fork_stiffness, line.shaft_stiffness, line.structure_stiffness, compliance


def _group(imperfection: str, *parameters: Variable, provides: Iterable[str] = (), **absent: float) -> Group:
    """Return a group of parameters ``drive_line``; without the group they have the values `absent`, by default 0.

    The `imperfection` vanishes with those values that are 0; damping is left out, as it has no effect at rest.
    """
    values = {f"drive_line.{v.name}": absent.get(v.name, 0.0) for v in parameters}
    return Group(in_group("drive_line", *parameters), provides=tuple(provides), absent=values, imperfections={
        imperfection: {name: value for name, value in values.items() if not (value or name.endswith("damping"))}})
AXIAL = _group(
    COMPLIANCE,
    parameter("axial_compliance", "m/N", 0.0, 1e-3, "compliance of screw, nut and thrust bearing in tension (0: rigid)",
              sheet="screw: compliance, 1 over the axial rigidity of screw, nut and bearing"),
    parameter("axial_damping", "N.s/m", 0.0, 1e7, "structural damping of screw, nut and thrust bearing"))
TORSIONAL = _group(
    COMPLIANCE,
    parameter("torsional_compliance", "rad/(N.m)", 0.0, 1e3, "compliance of motor shaft and screw in torsion (0: "
              "rigid)"),
    parameter("torsional_damping", "N.m.s/rad", 0.0, 10.0, "structural damping of motor shaft and screw in torsion"))
HINGE = _group(
    COMPLIANCE,
    parameter("fork_stiffness", "N.m/rad", 0.0, 1e9, "stiffness of the fork about the hinge (0: rigid)"),
    parameter("shaft_stiffness", "N.m/rad", 0.0, 1e9, "stiffness of the fin shaft in torsion (0: rigid)",
              sheet="drawing: stiffness of the fin's shaft in torsion"),
    parameter("structure_stiffness", "N.m/rad", 0.0, 1e9,
              "stiffness about the hinge of the structure that carries shaft and screw (0: rigid)"),
    parameter("hinge_damping", "N.m.s/rad", 0.0, 1e6,
              "structural damping of fork, shaft and structure about the hinge"))
GAP = _group(
    BACKLASH,
    parameter("backlash", "m", 0.0, 0.01,
              "whole gap between nut and fork along the screw (0: preloaded, without a gap)",
              sheet="screw: axial play"),
    parameter("contact_stiffness", "N/m", 1e4, 1e10, "stiffness of the flanks of nut and fork"),
    parameter("contact_damping", "N.s/m", 0.0, 1e7, "damping of the flanks of nut and fork"),
    provides=(capabilities.BACKLASH,), contact_stiffness=1.0)
LINE = (AXIAL, TORSIONAL, GAP, HINGE)
SCREW = groups.SCREW.reworded({"assembly position": "assembly position, before the gap"})


def initial(ops: Ops, p: Any, start: Record) -> Values:
    """Return the states of plant and controllers at rest at a fin angle, with nut and fork in the middle of the gap."""
    at_rest = nonlinear.initial(ops, p, start)
    return {**at_rest, FIN_SIDE[0]: at_rest["motor_angle"]}


def derivatives(ops: Ops, p: Any, x: Record, u: PlantInputs) -> Values:
    """Return d/dt of the states with nut and fork in contact, without dry friction and limits of the drive.

    Viscous friction is the mean of both directions.
    """
    p = as_built(ops, p)

    def as_one() -> tuple[Value, ...]:
        rates = nonlinear.derivatives(ops, p, x, u)
        return *rates.values(), rates["motor_angle"], rates["motor_speed"]

    def as_two() -> tuple[Value, ...]:
        speed, fin_speed = x.motor_speed, x.fin_side_speed
        line = drive_line.line(ops, p, x.fin_side_angle)
        torque = drive_line.torque(line, x.motor_angle - x.fin_side_angle, speed - fin_speed, 0.0)
        driving = drive.torque(p, drive.flowing(p, u.reference, x.motor_current)) + mechanics.rotor_torque(p, u)
        rotor = driving + p.screw.lead * loads.nut_force(ops, p, u) - torque - friction.mean_viscous(ops, p) * speed
        m = drive_line.fin_side(ops, p, x.fin_side_angle, u)
        fin = torque + m.load - mechanics.hinge_damping(p, m) * fin_speed + m.centrifugal * fin_speed * fin_speed
        rates = drive.rates(p, u.reference, speed, x.motor_current, x.drive_integral)
        return speed, rotor / mechanics.screw_inertia(p), *rates, fin_speed, fin / m.inertia

    return Pair(*ops.branch(drive_line.rigid(ops, p), as_one, as_two))._asdict()


def yielding(ops: Ops, p: Any, x: Record, u: PlantInputs, h: Value) -> tuple[Values, Value]:
    """Return the result of :func:`step` for a drive line that is not rigid."""
    moved, used = elastic_stepper.advance(ops, as_built(ops, p), states(Pair, x), u, h)
    return moved._asdict(), used


def step(ops: Ops, p: Any, x: Record, u: PlantInputs, h: Value) -> tuple[Values, Value]:
    """Return the plant's states after `h` [s] or at the first event, and the time [s] until then."""
    def as_one() -> tuple[Value, ...]:
        plant, used = rigid.advance(ops, as_built(ops, p), states(Motor, x), u, h)
        return *plant, plant.motor_angle, plant.motor_speed, used

    def as_two() -> tuple[Value, ...]:
        moved, used = yielding(ops, p, x, u, h)
        return *moved.values(), used

    *moved, used = ops.branch(drive_line.rigid(ops, p), as_one, as_two)
    return Pair(*moved)._asdict(), used


def moment(ops: Ops, p: Any, x: Record, u: PlantInputs) -> tuple[Any, Record]:
    """Return the parameters as built, and the values from which the outputs follow.

    Outputs of the fin follow from the fin's angle, the nut's position from the motor angle minus the deflection of
    shaft and screw.
    """
    p = as_built(ops, p)
    voltage, current, clipped = nonlinear.electrical(ops, p, x.motor_speed, x, u)
    lag = drive_line.nut_lag(ops, drive_line.line(ops, p, x.fin_side_angle), x.motor_angle - x.fin_side_angle)
    return p, interface.moment(
        ops, p, x, u, x.fin_side_angle, x.fin_side_speed, nut=x.motor_angle - lag, motor_voltage=voltage,
        motor_current=current, limited=ops.either(clipped > 0.0, u.limited > 0.0))


COMPOSITION = interface.composed(moment, *groups.with_screw(SCREW), groups.LOSSLESS, SHAFT, *groups.SERVO, *LINE)
ACTUATOR = replace(
    nonlinear.ACTUATOR,
    **COMPOSITION.declared((*plausibility.RULES, stiff_hinge)),
    name="elastic",
    title="nonlinear electromechanical actuator with elastic drive line and backlash",
    origin="The rigid model is that of Ü. Yerlikaya, Dynamic modeling and control of an electromechanical control "
           "actuation system, M.S. thesis, METU, 2016; numbers in brackets are its equations. The separate motions of "
           "rotor and fin, compliance and backlash between them are additions. The compliances of the rod are computed "
           "from Table 1 of the thesis; other numbers of the drive line, and those that the thesis does not "
           "contain, are engineering estimates, marked as such, not measurements of the thesis's prototype.",
    states=STATES,
    fin_side=FIN_SIDE,
    structure=Structure(drive_line=True),
    initial=initial,
    derivatives=derivatives,
    step=step,
    reference=None,
    modules=(sys.modules[__name__], drive_line, elastic_stepper, *nonlinear.MODULES),
)
