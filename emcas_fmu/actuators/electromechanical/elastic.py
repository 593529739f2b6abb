"""The nonlinear actuator with an elastic drive line and a gap between nut and fork.

The rotor and the fin have an angle each (:mod:`emcas_fmu.physics.drive_line`), the fin's referred to the motor. Without
compliance and gap it is the nonlinear actuator, step for step.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from typing import Any

from ...namespace import Record
from ...ops.base import Ops, Value
from ...physics import drive, drive_line, friction, loads, mechanics
from ...physics.structure import Structure
from ...rules import Rule, when
from ...steppers import elastic as elastic_stepper
from ...steppers import rigid
from ...steppers.elastic import Pair
from ...steppers.electrical import Plant
from ...variables import Variable, in_group, parameter
from .. import capabilities, fin_port
from ..declaration import PlantInputs, State, Values
from . import groups, interface, nonlinear
from .as_built import as_built
from .interface import Group

FIN_SIDE = ("fin_side_angle", "fin_side_speed")
STATES = (*interface.MOTION, *interface.DRIVE,
          State(FIN_SIDE[0], "rad", "of the fin, referred to the motor"),
          State(FIN_SIDE[1], "rad/s", "of the fin, referred to the motor"))
_LIMPEST = 1e100  # rad/(N.m): far beyond any part, and what is computed from it stays finite
SHAFT = groups.shaft("angle of the rotor (indirect fin angle, by lever and screw)")


def _group(*parameters: Variable, **absent: float) -> Group:
    return Group(in_group("drive_line", *parameters), absent={
        **{f"drive_line.{v.name}": 0.0 for v in parameters}, **{f"drive_line.{k}": v for k, v in absent.items()}})


def axial(parts: str = "screw, nut and thrust bearing", along: str = "in tension",
          sheet: str = "screw: compliance, 1 over the axial rigidity of screw, nut and bearing") -> Group:
    """Return the give of these parts along the screw's axis."""
    return _group(
        parameter("axial_compliance", "m/N", 0.0, 1e-3, f"compliance of {parts} {along} (0: rigid)", sheet=sheet),
        parameter("axial_damping", "N.s/m", 0.0, 1e7, f"structural damping of {parts}"))


AXIAL = axial()
TORSIONAL = _group(
    parameter("torsional_compliance", "rad/(N.m)", 0.0, 1e3, "compliance of motor shaft and screw in torsion (0: "
              "rigid)"),
    parameter("torsional_damping", "N.m.s/rad", 0.0, 10.0, "structural damping of motor shaft and screw in torsion"))


def hinge(fork: str = "fork", screw: str = "screw") -> Group:
    """Return the give of what turns about the hinge, by the names of its parts."""
    return _group(
        parameter("fork_stiffness", "N.m/rad", 0.0, 1e9, f"stiffness of the {fork} about the hinge (0: rigid)"),
        parameter("shaft_stiffness", "N.m/rad", 0.0, 1e9, "stiffness of the fin shaft in torsion (0: rigid)",
                  sheet="drawing: stiffness of the fin's shaft in torsion"),
        parameter("structure_stiffness", "N.m/rad", 0.0, 1e9,
                  f"stiffness about the hinge of what bears shaft and {screw} (0: rigid)"),
        parameter("hinge_damping", "N.m.s/rad", 0.0, 1e6,
                  f"structural damping of {fork}, shaft and structure about the hinge"))


def gap(flanks: str = "nut and fork", along: str = "screw", sheet: str = "screw: axial play") -> Group:
    """Return the gap between two parts."""
    return _group(
        parameter("backlash", "m", 0.0, 0.01,
                  f"whole gap between {flanks} along the {along} (0: preloaded, no contact)", sheet=sheet),
        parameter("contact_stiffness", "N/m", 1e4, 1e10, f"stiffness of the flanks of {flanks}"),
        parameter("contact_damping", "N.s/m", 0.0, 1e7, f"damping of the flanks of {flanks}"), contact_stiffness=1.0)


HINGE, GAP = hinge(), gap()
LINE = (AXIAL, TORSIONAL, GAP, HINGE)
SCREW = groups.screw("nut displacement from the assembly position, before the gap")
PARTS = interface.Parts((*groups.lever_and_screw(SCREW), SHAFT, *groups.SERVO, *LINE))


def _limp(ops: Ops, p: Any, _: Value) -> tuple[Value, ...]:
    line = p.drive_line
    compliance = drive_line.hinge_compliance(ops, p)
    limp = ops.negate(compliance <= _LIMPEST)
    return when(ops, limp), line.fork_stiffness, line.shaft_stiffness, line.structure_stiffness, compliance


LINE_RULE = Rule(_limp, (
    "drive_line.fork_stiffness = %.6g, drive_line.shaft_stiffness = %.6g and drive_line.structure_stiffness = %.6g "
    "N.m/rad: the compliance about the hinge is %.6g rad/(N.m), over 1e+100; raise the least, or give 0, which is "
    "rigid"))


def sides(x: Record) -> Pair:
    """Return rotor and fin."""
    return Pair(x.motor_angle, x.motor_speed, x.motor_current, x.drive_integral, x.fin_side_angle, x.fin_side_speed)


def _states(values: Pair) -> Values:
    return dict(zip((s.name for s in STATES), values, strict=True))


def initial(ops: Ops, p: Any, start: Record) -> Values:
    """Return plant and controller at rest at a fin angle, the nut amid its gap."""
    begun = nonlinear.initial(ops, p, start)
    return {**begun, FIN_SIDE[0]: begun["motor_angle"]}


def derivatives(ops: Ops, p: Any, x: Record, u: PlantInputs) -> Values:
    """Return d/dt of the states: nut and fork are bonded where there is a gap, as a load presses them."""
    p = as_built(ops, p)

    def as_one() -> tuple[Value, ...]:
        rates = nonlinear.derivatives(ops, p, x, u)
        return *rates.values(), rates["motor_angle"], rates["motor_speed"]

    def as_two() -> tuple[Value, ...]:
        s = sides(x)
        line = drive_line.line(ops, p, s.fin_angle)
        torque = drive_line.torque(line, s.angle - s.fin_angle, s.speed - s.fin_speed, 0.0)
        driving = drive.torque(p, drive.flowing(p, u.reference, s.current)) + mechanics.rotor_torque(p, u)
        rotor = (driving + p.screw.lead * loads.nut_force(ops, p, u) - torque
                 - friction.mean_viscous(ops, p) * s.speed)
        m = drive_line.fin_side(ops, p, s.fin_angle, u)
        fin = (torque + m.load - mechanics.hinge_damping(p, m) * s.fin_speed
               + m.centrifugal * s.fin_speed * s.fin_speed)
        rates = drive.rates(p, u.reference, s.speed, s.current, s.integral)
        return s.speed, rotor / mechanics.screw_inertia(p), *rates, s.fin_speed, fin / m.inertia

    return _states(Pair(*ops.branch(drive_line.rigid(ops, p), as_one, as_two)))


def yielding(ops: Ops, p: Any, x: Record, u: PlantInputs, h: Value) -> tuple[Values, Value]:
    """Return :func:`step` of a drive line that is not rigid."""
    moved, used = elastic_stepper.advance(ops, as_built(ops, p), sides(x), u, h)
    return _states(moved), used


def step(ops: Ops, p: Any, x: Record, u: PlantInputs, h: Value) -> tuple[Values, Value]:
    """Return the plant after h [s] or at the first event before, and the time that took."""
    def as_one() -> tuple[Value, ...]:
        now = Plant(x.motor_angle, x.motor_speed, x.motor_current, x.drive_integral)
        plant, used = rigid.advance(ops, as_built(ops, p), now, u, h)
        return *plant, plant.angle, plant.speed, used

    def as_two() -> tuple[Value, ...]:
        moved, used = yielding(ops, p, x, u, h)
        return *moved.values(), used

    *moved, used = ops.branch(drive_line.rigid(ops, p), as_one, as_two)
    return _states(Pair(*moved)), used


def shown(parts: interface.Parts, ops: Ops, p: Any, x: Record, u: PlantInputs) -> Values:
    """Return the outputs of an actuator of such parts: the fin's of the fin, the others of the motor."""
    p = as_built(ops, p)
    voltage, current, clipped = nonlinear.electrical(ops, p, x.motor_speed, x, u)
    now = interface.moment(ops, p, x, u, x.fin_side_angle, x.fin_side_speed)
    lag = drive_line.nut_lag(ops, drive_line.line(ops, p, x.fin_side_angle), x.motor_angle - x.fin_side_angle)
    return parts.shown(ops, p, Record(**vars(now), nut=x.motor_angle - lag, voltage=voltage, current=current,
                                      stop=fin_port.stop_edge(p),
                                      saturated=lambda: ops.either(clipped > 0.0, u.limited > 0.0)))


def output_values(ops: Ops, p: Any, x: Record, u: PlantInputs) -> Values:
    """Return every output."""
    return shown(PARTS, ops, p, x, u)


ACTUATOR = replace(
    nonlinear.ACTUATOR,
    name="elastic",
    title="nonlinear electromechanical actuator with elastic drive line and backlash",
    states=STATES,
    fin_side=FIN_SIDE,
    outputs=PARTS.outputs,
    parameters=PARTS.parameters,
    rules=(*nonlinear.ACTUATOR.rules, LINE_RULE),
    provides=nonlinear.ACTUATOR.provides - {capabilities.RIGID_DRIVE_LINE} | {capabilities.BACKLASH},
    structure=Structure(drive_line=True),
    initial=initial,
    derivatives=derivatives,
    step=step,
    output_values=output_values,
    reference=None,
    modules=(sys.modules[__name__], drive_line, elastic_stepper, *nonlinear.EQUATIONS),
)
