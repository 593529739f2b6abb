"""Electrohydrostatic actuator: servomotor with its drive, pump, valves and reservoir, cylinder, lever and fin.

Pump and valves: :mod:`emcas_fmu.physics.pump`, cylinder: :mod:`emcas_fmu.physics.cylinder`, motor and drive:
:mod:`emcas_fmu.physics.drive`. The position loop (:mod:`emcas_fmu.control.fluid_power`) uses the transducer of the fin:
the motor's angle does not determine the fin's, as the pump leaks. The velocity loop uses the motor's speed w from an
ideal resolver; its reference follows from that of the piston's speed, v_ref, as in a pump without leakage:

    w_ref = A/D v_ref        u = clip(K_v (w_ref - w) + u_fc, +-u_max)

A is the piston's area, D the pump's displacement, K_v controller.velocity.kp and u_max drive.reference_limit. The
position loop's integral is also held while the drive cannot follow u and the integral would drive it further beyond its
limit. u_fc feeds the Coulomb friction of pump, piston and fin forward
(:func:`emcas_fmu.control.controllers.fed_forward`): the friction without load, as no pressure is measured.

Without `enable` the bridge opens, and friction and leakage of the pump hold the fin, unless the bypass valve opens.

Events (:mod:`emcas_fmu.steppers.events`): the fin starts, comes to rest or meets a stop, the pump starts or comes to
rest, a check valve or a relief valve opens or closes, a void begins or ends, the drive's voltage reaches or leaves its
limit.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from typing import Any

from ...control import controllers, fluid_power
from ...control.trajectory import Ahead, Motion, added
from ...namespace import Record, with_values
from ...ops.base import Ops, Value
from ...physics import cylinder, drive, loads, pump, stick
from ...steppers import electrical, events
from ...variables import only, parameter, switch, tunable
from .. import capabilities, fin_port
from ..composition import Group
from ..declaration import FIN, PlantFault, PlantInputs, SampleInputs, State, Values
from ..electromechanical import groups, nonlinear, plausibility
from ..electromechanical import interface as electromechanical
from . import fin, interface

_ROUNDING = 1e-9  # V: a smaller part of the reference beyond a limit is rounding
_LOOPS = Group(
    only(nonlinear.COMPOSITION.parameters, "drive.current_", "drive.k", "drive.reference_limit",
         "controller.velocity.kp", "controller.speed_limit"), groups.CURRENT_LOOP.outputs, provides=(
        capabilities.CURRENT_LOOP, capabilities.CURRENT_LIMIT, capabilities.REFERENCE_LIMIT, capabilities.CASCADE),
    imperfections=groups.CURRENT_LIMIT.imperfections)
_PUMP = Group((
    parameter("pump.displacement", "m3/rad", 1e-10, 1e-3, "displacement of the pump per radian, D_p",
              sheet="pump: displacement per revolution"),
    parameter("pump.leakage", "m3/(s.Pa)", 0.0, 1e-6, "leakage of the pump between its sides, xi_p",
              sheet="pump: leakage over pressure, from the volumetric efficiency"),
    parameter("pump.case_leakage", "m3/(s.Pa)", 0.0, 1e-6, "leakage of each side to the case, C_ep"),
    parameter("pump.coulomb_friction", "N.m", 0.0, 1e3, "dry friction of pump and motor without pressure, T_c"),
    parameter("pump.pressure_friction", "N.m/Pa", 0.0, 1e-3, "dry friction per pressure difference, k"),
    parameter("pump.viscous_friction", "N.m.s/rad", 0.0, 10.0, "viscous friction of pump and motor, B_m"),
    parameter("reservoir.pressure", "Pa", 0.0, 1e8, "absolute pressure of reservoir and case, p_a",
              sheet="reservoir: charge pressure, absolute"),
    parameter("check_valve.cracking_pressure", "Pa", 0.0, 1e8, "pressure difference at which a check valve opens"),
    parameter("relief_valve.pressure", "Pa", 1e3, 1e9, "pressure difference at which a relief valve opens, p_rv",
              sheet="relief valve: setting"),
    parameter("relief_valve.conductance", "m3/(s.Pa)", 0.0, 1e-6, "conductance of an open relief valve, K_rv"),
    parameter("bypass_valve.conductance", "m3/(s.Pa)", 0.0, 1e-6, "conductance of the open bypass valve"),
    tunable("bypass_valve.opening", "1", 0.0, 1.0, "opening of the bypass valve (0: closed, 1: fully open)"),
    switch("bypass_valve.opens_disabled", "true: the bypass valve opens while the drive is disabled, and loads move "
           "the fin"),
    parameter("oil.cavitation_pressure", "Pa", 0.0, 1e6, "absolute pressure at which a void forms in the oil"),
    parameter("oil.cavitated_modulus", "Pa", 1.0, 1e9, "bulk modulus of a chamber with a void",
              quantity="BulkModulus")))
_SEIZED = 1e6  # N.m: dry friction of a pump that nothing turns

FAULTS = (
    PlantFault.scaling("leakage", "seals of pump and piston are worn",
                       tunable("factor", "1", 1.0, 1e4, "factor by which leakage rises"),
                       "pump.leakage", "pump.case_leakage", "cylinder.internal_leakage"),
    PlantFault.scaling("reservoir_loss", "the reservoir has permanently lost its pressure",
                       tunable("share", "1", 0.0, 1.0, "share of the pressure that is left"), "reservoir.pressure",
                       lasting=True),
    PlantFault.scaling("air", "there is air in the oil", interface.AIR, "oil.bulk_modulus"),
    PlantFault.scaling("relief_open", "the relief valves open too early",
                       tunable("share", "1", 0.0, 1.0, "share of the setting that is left"), "relief_valve.pressure"),
    PlantFault("bypass_open", "the bypass valve is open", lambda ops, p, amounts: {
        "bypass_valve.opening": amounts.share,
    }, (tunable("share", "1", 0.0, 1.0, "opening of the bypass valve"),)),
    PlantFault("pump_seized", "rotor and pump are seized", lambda ops, p, amounts: {
        "pump.coulomb_friction": _SEIZED,
    }),
)


def initial(ops: Ops, p: Any, start: Record) -> Values:
    """Return the states of plant and controller at rest at a fin angle, both chambers at the reservoir's pressure."""
    return interface.initial(ops, p, start, pump.at_rest(ops, p))


def sample(ops: Ops, p: Any, x: Record, inputs: SampleInputs) -> Values:
    """Return the reference and the states of the controllers after a sample; while disabled they are held in reset."""
    measured = fluid_power.measured(ops, p, inputs.position)
    at_rest = fluid_power.at_rest(ops, p, measured)

    def running() -> tuple[Value, ...]:
        per_speed = p.pump.displacement / p.cylinder.area
        out = fluid_power.sample(ops, p, x.integral, x.piston, measured, inputs.command,
                                 p.controller.speed_limit * per_speed, inputs.ahead)
        speed_reference = out.speed / per_speed
        compensation = controllers.fed_forward(ops, p, _dry_at_motor(ops, p, measured), speed_reference)
        raw = p.controller.velocity.kp * (speed_reference - x.motor_speed) + compensation
        raw = added(ops, raw, inputs.ahead, "reference")
        largest = p.drive.reference_limit
        reference = ops.clip(raw, -largest, largest)
        # The part of the reference that is beyond the limit of DAC or current.
        beyond = raw - drive.followed(ops, p, reference)
        held = ops.both(ops.fabs(beyond) > _ROUNDING, beyond * (out.integral - x.integral) > 0.0)
        limited = ops.either(out.limited > 0.0, ops.fabs(raw) > largest)
        return reference, ops.where(held, out.held, out.integral), ops.where(limited, 1.0, 0.0)

    reference, integral, limited = ops.branch(inputs.enable, running, lambda: (0.0, at_rest, 0.0))
    return {"reference": reference, "integral": integral, "piston": cylinder.piston_position(ops, p, measured),
            "measured_fin_angle": measured, "limited": limited}


def feed_forward(ops: Ops, p: Any, motion: Motion, integral: Value) -> tuple[Ahead, Value, Value]:
    """Return the feed-forward of a motion of the fin with stiff oil; see :func:`.controllers.feed_forward`."""
    per_speed = p.pump.displacement / p.cylinder.area
    piston, piston_acceleration = fluid_power.piston_motion(ops, p, motion)
    speed, acceleration = piston / per_speed, piston_acceleration / per_speed
    linkage = cylinder.linkage(ops, p, motion.angle, loads.NONE)
    reflected = per_speed / linkage.ratio
    torque = (p.inertia.motor + linkage.inertia * reflected * reflected) * acceleration
    reference, integral = drive.inverse(p, (torque + p.pump.viscous_friction * speed) / p.motor.torque_constant, speed,
                                        integral)
    late = p.drive.transport_delay + drive.lag(p)
    return Ahead(piston - piston_acceleration * late, reference), integral, late  # speed of the delayed motion


def _dry_at_motor(ops: Ops, p: Any, fin_angle: Value) -> Value:
    """Return the Coulomb friction [N.m] of pump, piston and fin at the motor, without load."""
    drop = cylinder.dry_drop(ops, p, fin_angle)
    return p.pump.displacement * drop + pump.dry(ops, p, drop)


def mode(ops: Ops, p: Any, x: Record, u: PlantInputs, h: Value) -> Record:
    """Return the mode of a step of `h` [s], with the linkage of mid-step."""
    linkage, motion = fin.mode(ops, p, x, u, h)
    drop = x.pressure_1 - x.pressure_2
    driving, dry = pump.driving(p, x.motor_current, drop), pump.dry(ops, p, drop)
    shaft = stick.slide(ops, x.motor_speed, driving, dry, 0.0, stick.WALL)
    valves = pump.valves(ops, p, x.pressure_1, x.pressure_2)

    def accelerating() -> Value:
        return stick.moves(ops, shaft, pump.acceleration(p, x.motor_speed, driving - shaft.direction * dry))

    return Record(linkage=linkage, fin=motion, shaft=shaft, valves=valves,
                  lines=pump.lines(ops, p, valves, pump.bypass(ops, p, u.enabled)),
                  drive=electrical.electrical_mode(ops, p, x, u, h, accelerating))


def _mechanical(ops: Ops, p: Any, x: Record, m: Record) -> Values:
    """Return d/dt of the states of fin, chambers and shaft."""
    one, two, drop = x.pressure_1, x.pressure_2, x.pressure_1 - x.pressure_2
    flow_1, flow_2 = pump.flows(p, m.lines, x.motor_speed, one, two)
    rise_1, rise_2 = cylinder.pressure_rates(p, m.linkage, x.fin_rate, one, two, flow_1, flow_2)
    torque = pump.driving(p, x.motor_current, drop) - m.shaft.direction * pump.dry(ops, p, drop)
    shaft = pump.acceleration(p, x.motor_speed, torque)
    return {**fin.rates(ops, p, x, m),
            "pressure_1": m.lines.share_1 * rise_1, "pressure_2": m.lines.share_2 * rise_2,
            "motor_speed": stick.moves(ops, m.shaft, shaft)}


def _rates(ops: Ops, p: Any, x: Record, u: PlantInputs, m: Record) -> Values:
    return {**_mechanical(ops, p, x, m), **electrical.rates(ops, p, m.drive, x)}


def derivatives(ops: Ops, p: Any, x: Record, u: PlantInputs) -> Values:
    """Return d/dt of the states, without dry friction, with closed check and relief valves and an unlimited drive."""
    p = as_built(ops, p)
    smooth = with_values(p, {"pump.coulomb_friction": 0.0, "pump.pressure_friction": 0.0})
    m = Record(linkage=cylinder.linkage(ops, p, x.fin_angle, u)._replace(dry=0.0), fin=fin.FREE, shaft=fin.FREE,
               lines=pump.lines(ops, p, pump.SHUT, pump.bypass(ops, p, u.enabled)))
    rise, integral = drive.rates(p, u.reference, x.motor_speed, x.motor_current, x.drive_integral)
    return {**_mechanical(ops, smooth, x, m), "motor_current": rise, "drive_integral": integral}


def _margins(ops: Ops, p: Any, x: Record, u: PlantInputs, m: Record) -> Values:
    drop = x.pressure_1 - x.pressure_2
    # The friction of the shaft changes with the pressure.
    dry = pump.dry(ops, p, drop)
    shaft = m.shaft._replace(high=dry, low=-dry)
    return {**fin.margins(ops, p, x, m),
            "shaft": stick.margin(ops, shaft, x.motor_speed, pump.driving(p, x.motor_current, drop)),
            **pump.margins(ops, p, m.valves, x.pressure_1, x.pressure_2),
            "voltage": electrical.reserve(ops, p, m.drive, x)}


def _landed(ops: Ops, p: Any, begin: Record, x: Record, u: PlantInputs, m: Record, events: Values) -> Values:
    def floored(pressure: Value, void: Value) -> Value:
        # A void begins at exactly this pressure, with a volume of 0. Its modulus is thousands of times lower than the
        # oil's: an undershoot would be a large volume.
        return ops.where(void, pressure, ops.maximum(pressure, p.oil.cavitation_pressure))

    shaft = ops.both(ops.negate(ops.equal(m.shaft.direction, 0.0)), events["shaft"])
    return {**fin.landed(ops, p, begin, x, m, events),
            "pressure_1": floored(x.pressure_1, m.valves.void_1), "pressure_2": floored(x.pressure_2, m.valves.void_2),
            "motor_speed": stick.speed_after(ops, m.shaft, begin.motor_speed, x.motor_speed, shaft),
            "drive_integral": electrical.integral_end(ops, p, m.drive, x)}


def moment(ops: Ops, p: Any, x: Record, u: PlantInputs) -> tuple[Any, Record]:
    """Return the parameters as built, and the values from which the outputs follow."""
    p = as_built(ops, p)
    voltage, current, clipped = nonlinear.electrical(ops, p, x.motor_speed, x, u)
    limited = ops.either(clipped > 0.0, u.limited > 0.0)
    return p, fin_port.at_fin(ops, p, x, u, limited, motor_voltage=voltage, motor_current=current)


COMPOSITION = interface.composed(
    moment, groups.DELAY, interface.friction(("pump.coulomb_friction", "pump.pressure_friction"),
                                             ("pump.viscous_friction",)),
    interface.filled_cylinder(), groups.MOTOR, groups.CURRENT, groups.INDUCTANCE, groups.VOLTAGE_LIMIT, groups.POWER,
    _LOOPS, groups.COMPENSATION, groups.POLE_PAIRS, _PUMP)
as_built = COMPOSITION.as_built


ACTUATOR = replace(
    nonlinear.ACTUATOR,
    **COMPOSITION.declared(
        (plausibility.reachable_current, plausibility.stable_velocity(lambda p: p.inertia.motor),
         plausibility.plausible_winding(lambda p: p.inertia.motor)), motor="motor and drive", hydraulics="cylinder"),
    name="electrohydrostatic",
    title="electrohydrostatic actuator: servomotor, pump, cylinder, lever and fin",
    origin="Section 1.1.2 of the thesis of Yerlikaya (2016) describes the structure, without numbers. Motor, drive and "
           "supply are those of the default actuator, with the pump's inertia on the motor; the gains are tuned. Other "
           "entries are engineering estimates where their source says so.",
    states=(*FIN, *interface.CHAMBERS, State("motor_speed", "rad/s"), *electromechanical.DRIVE),
    controller_states=interface.CONTROLLER,
    encoder=("fin_angle", "fin_rate"),
    controllers_read=("motor_speed",),
    descriptions={"enable": "false opens the drive's bridge: friction and leakage of the pump hold the fin, unless the "
                            "bypass valve opens"},
    faults=FAULTS,
    as_built=as_built,
    initial=initial,
    sample=sample,
    feed_forward=feed_forward,
    derivatives=derivatives,
    step=events.Switched(mode, _rates, _margins, _landed, electrical.begun).step(as_built),
    reference="emcas_fmu.reference.electrohydrostatic",
    modules=(sys.modules[__name__], cylinder, pump, drive, fluid_power, events),
)
