"""Electrohydrostatic actuator: servomotor with its drive, pump, valves and reservoir, cylinder, lever and fin.

Pump and valves: :mod:`emcas_fmu.physics.pump`, cylinder: :mod:`emcas_fmu.physics.cylinder`, motor and drive:
:mod:`emcas_fmu.physics.drive`. The position loop (:mod:`emcas_fmu.control.fluid_power`) uses the transducer of the fin,
as a pump that leaks keeps turning under load; its speed reference of the piston is that of a pump without leakage. The
velocity loop uses the motor's speed from an ideal resolver:

    w_ref = A/D v_ref        u = clip(K_v (w_ref - w) + u_fc, +-u_max)

The position loop's integral is also held while the drive cannot follow u. u_fc feeds forward the Coulomb friction of
pump, piston and fin at the motor without load (:func:`emcas_fmu.control.controllers.fed_forward`), as no pressure is
measured.

Without `enable` the bridge opens, and friction and leakage of the pump hold the fin, unless the bypass valve opens.

Events (:mod:`emcas_fmu.steppers.events`): the fin starts, comes to rest or meets a stop, the pump starts or comes to
rest, a check valve or a relief valve opens or closes, a void begins or ends, the drive's voltage reaches or leaves its
limit.
"""

from __future__ import annotations

import sys
from typing import Any

from ...control import controllers, fluid_power
from ...namespace import Record, with_values
from ...ops.base import Ops, Value
from ...physics import cylinder, drive, pump, stick
from ...steppers import current_loop, electrical, events
from ...variables import Terminal, only, parameter, switch, tunable
from .. import as_built, capabilities
from ..declaration import Actuator, PlantInputs, SampleInputs, State, Values
from ..electromechanical import interface as electromechanical
from ..electromechanical import nonlinear, plausibility
from ..electromechanical.rules import LEVER_RULE
from . import fin, interface
from .electrohydrostatic_faults import FAULTS

_ARM, _ANGLE, _FIN, _COULOMB, _VISCOUS = interface.DEVIATIONS
DEVIATIONS = (_ARM, _ANGLE, _FIN,
              _COULOMB.scaling(*_COULOMB.scales, "pump.coulomb_friction", "pump.pressure_friction"),
              _VISCOUS.scaling(*_VISCOUS.scales, "pump.viscous_friction"), as_built.FLUX)
with_deviations = as_built.plant(*DEVIATIONS)
_ROUNDING = 1e-9  # V
PARAMETERS = (
    *interface.PARAMETERS,
    *only(nonlinear.COMPOSITION.parameters, "inertia.motor", "motor.", "drive.current_", "drive.k",
          "drive.reference_limit", "controller.velocity.kp", "controller.speed_limit", "compensation."),
    parameter("pump.displacement", "m3/rad", 1e-10, 1e-3, "displacement of the pump per radian, D_p",
              sheet="pump: displacement per revolution"),
    parameter("pump.leakage", "m3/(s.Pa)", 0.0, 1e-6, "leakage of the pump from side to side, xi_p",
              sheet="pump: leakage over pressure, from the volumetric efficiency"),
    parameter("pump.case_leakage", "m3/(s.Pa)", 0.0, 1e-6, "leakage of each side to the case, C_ep"),
    parameter("pump.coulomb_friction", "N.m", 0.0, 1e3, "dry friction of pump and motor without pressure, T_c"),
    parameter("pump.pressure_friction", "N.m/Pa", 0.0, 1e-3, "dry friction for each unit of pressure difference, k"),
    parameter("pump.viscous_friction", "N.m.s/rad", 0.0, 10.0, "viscous friction of pump and motor, B_m"),
    parameter("reservoir.pressure", "Pa", 0.0, 1e8, "absolute pressure of reservoir and case, p_a",
              sheet="reservoir: charge pressure, absolute"),
    parameter("check_valve.cracking_pressure", "Pa", 0.0, 1e8, "pressure difference at which a check valve opens"),
    parameter("relief_valve.pressure", "Pa", 1e3, 1e9, "pressure difference at which a relief valve opens, p_rv",
              sheet="relief valve: setting"),
    parameter("relief_valve.conductance", "m3/(s.Pa)", 0.0, 1e-6, "conductance of an open relief valve, K_rv"),
    parameter("bypass_valve.conductance", "m3/(s.Pa)", 0.0, 1e-6, "conductance of the open bypass valve"),
    tunable("bypass_valve.opening", "1", 0.0, 1.0, "share by which the bypass valve is open (0: closed)"),
    switch("bypass_valve.opens_disabled", "true: the bypass valve opens while the drive is disabled, and the fin "
           "yields"),
    parameter("oil.cavitation_pressure", "Pa", 0.0, 1e6, "absolute pressure at which a void opens in the oil"),
    parameter("oil.cavitated_modulus", "Pa", 1.0, 1e9, "bulk modulus of a chamber with a void",
              quantity="BulkModulus"),
    *(deviation.variable for deviation in DEVIATIONS),
)


def initial(ops: Ops, p: Any, start: Record) -> Values:
    """Return the states of plant and controller at rest at a fin angle, both chambers at the reservoir's pressure."""
    return interface.initial(ops, p, start, pump.at_rest(ops, p))


def sample(ops: Ops, p: Any, x: Record, inputs: SampleInputs) -> Values:
    """Return the reference and states of the controllers after a sample; they are held in reset while disabled."""
    measured = fluid_power.measured(ops, p, inputs.position)
    at_rest = fluid_power.at_rest(ops, p, measured)

    def running() -> tuple[Value, ...]:
        per_speed = p.pump.displacement / p.cylinder.area
        out = fluid_power.sample(ops, p, x.integral, x.piston, measured, inputs.command,
                                 p.controller.speed_limit * per_speed)
        speed_reference = out.speed / per_speed
        compensation = controllers.fed_forward(ops, p, _dry_at_motor(ops, p, measured), speed_reference)
        raw = p.controller.velocity.kp * (speed_reference - x.motor_speed) + compensation
        largest = p.drive.reference_limit
        reference = ops.clip(raw, -largest, largest)
        # The part of the reference beyond the limits of DAC or current.
        beyond = raw - drive.followed(ops, p, reference)
        held = ops.both(ops.fabs(beyond) > _ROUNDING, beyond * (out.integral - x.integral) > 0.0)
        limited = ops.either(out.limited > 0.0, ops.fabs(raw) > largest)
        return reference, ops.where(held, out.held, out.integral), ops.where(limited, 1.0, 0.0)

    reference, integral, limited = ops.branch(inputs.enable, running, lambda: (0.0, at_rest, 0.0))
    return {"reference": reference, "integral": integral, "piston": cylinder.piston_position(ops, p, measured),
            "measured_fin_angle": measured, "limited": limited}


def _dry_at_motor(ops: Ops, p: Any, fin_angle: Value) -> Value:
    """Return the Coulomb friction [N.m] of pump, piston and fin at the motor, without load."""
    drop = cylinder.dry_drop(ops, p, fin_angle)
    return p.pump.displacement * drop + pump.dry(ops, p, drop)


def _electrical(x: Record) -> electrical.Plant:
    return electrical.Plant(0.0, x.motor_speed, x.motor_current, x.drive_integral)


def mode(ops: Ops, p: Any, x: Record, u: PlantInputs, h: Value) -> Record:
    """Return the mode of a step of `h` [s]; its linkage is that of mid-step."""
    linkage, motion = fin.mode(ops, p, x, u, h)
    drop = x.pressure_1 - x.pressure_2
    driving, dry = pump.driving(p, x.motor_current, drop), pump.dry(ops, p, drop)
    shaft = stick.slide(ops, x.motor_speed, driving, dry, 0.0, stick.WALL)
    valves = pump.valves(ops, p, x.pressure_1, x.pressure_2)

    def accelerating() -> Value:
        return stick.moves(ops, shaft, pump.acceleration(p, x.motor_speed, driving - shaft.direction * dry))

    return Record(linkage=linkage, fin=motion, shaft=shaft, valves=valves,
                  lines=pump.lines(ops, p, valves, pump.bypass(ops, p, u.enabled)),
                  drive=electrical.electrical_mode(ops, p, _electrical(x), u, h, accelerating))


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
    rise, integral = current_loop.rates(ops, p, m.drive, x.motor_speed, x.motor_current, x.drive_integral)
    return {**_mechanical(ops, p, x, m), "motor_current": rise, "drive_integral": integral}


def derivatives(ops: Ops, p: Any, x: Record, u: PlantInputs) -> Values:
    """Return d/dt of the states, moving without dry friction, with closed valves and the drive within its limits."""
    p = with_deviations(ops, p)
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
            "voltage": current_loop.reserve(ops, p, m.drive, x.motor_speed, x.motor_current, x.drive_integral)}


def _landed(ops: Ops, p: Any, begin: Record, x: Record, u: PlantInputs, m: Record, events: Values) -> Values:
    def borne(pressure: Value, void: Value) -> Value:
        # A void begins at no volume: with its modulus an overshoot of the pressure would be thousands of times as much.
        return ops.where(void, pressure, ops.maximum(pressure, p.oil.cavitation_pressure))

    shaft = ops.both(ops.negate(ops.equal(m.shaft.direction, 0.0)), events["shaft"])
    return {**fin.landed(ops, p, begin, x, m, events),
            "pressure_1": borne(x.pressure_1, m.valves.void_1), "pressure_2": borne(x.pressure_2, m.valves.void_2),
            "motor_speed": stick.speed_after(ops, m.shaft, begin.motor_speed, x.motor_speed, shaft),
            "drive_integral": current_loop.integral_end(ops, p, m.drive, x.motor_speed, x.motor_current,
                                                        x.drive_integral)}


_SYSTEM = events.Switched(mode, _rates, _margins, _landed)


def step(ops: Ops, p: Any, x: Record, u: PlantInputs, h: Value) -> tuple[Values, Value]:
    """Return the plant's states after `h` [s] or at the first event, and the time [s] until then."""
    p = with_deviations(ops, p)
    now = electrical.switched(ops, _electrical(x), u.enabled)
    x = x.replace(motor_current=now.current, drive_integral=now.integral)
    moved, used = events.advance(ops, p, _SYSTEM, x, u, electrical.resolved(ops, p, now, u, h))
    return vars(moved), used


def output_values(ops: Ops, p: Any, x: Record, u: PlantInputs) -> Values:
    """Return every output."""
    p = with_deviations(ops, p)
    voltage, current, clipped = nonlinear.electrical(ops, p, x.motor_speed, x, u)
    error = drive.current_reference(ops, p, u.reference) - current
    return {
        **interface.output_values(ops, p, x, u, ops.either(clipped > 0.0, u.limited > 0.0)),
        "motor_speed": x.motor_speed,
        "motor_current": current,
        "motor_voltage": voltage,
        "motor_torque": drive.torque(p, current),
        "drive_reference": u.sampled_reference,
        "supply_power": voltage * current,
        "current_error": ops.where(u.enabled, error, 0.0),
    }


def _rotor(p: Any) -> Value:
    return p.inertia.motor


ACTUATOR = Actuator(
    name="electrohydrostatic",
    title="electrohydrostatic actuator: servomotor, pump, cylinder, lever and fin",
    origin="The structure is that of section 1.1.2 of the thesis of Yerlikaya (2016), which gives no numbers: motor, "
           "drive and supply are those of the electromechanical actuator, all other values are engineering estimates.",
    states=(*interface.FIN, *interface.CHAMBERS, State("motor_speed", "rad/s"), *electromechanical.DRIVE),
    controller_states=interface.CONTROLLER,
    outputs=(*interface.OUTPUTS,
             *only(nonlinear.COMPOSITION.outputs, "motor_speed", "motor_current", "motor_voltage", "motor_torque",
                   "drive_reference", "supply_power", "current_error")),
    parameters=PARAMETERS,
    supply=electromechanical.SUPPLY,
    descriptions={"enable": "false opens the drive's bridge: the fin is held by friction and leakage of the pump, "
                            "unless the bypass valve opens"},
    terminals=(Terminal("motor", "motor and drive", ("motor_speed", "motor_current", "motor_voltage", "motor_torque",
                                                     "drive_reference", "current_error")),
               Terminal("hydraulics", "cylinder", ("piston_position", "pressure_1", "pressure_2"))),
    rules=(LEVER_RULE, interface.STROKE_RULE, plausibility.CURRENT_RULE,
           plausibility.velocity_rule(_rotor), plausibility.winding_rule(_rotor)),
    supply_rules=plausibility.SUPPLY_RULES,
    faults=FAULTS,
    equal_parameters=electromechanical.EQUAL,
    provides=frozenset({
        capabilities.MOTOR_CURRENT, capabilities.CURRENT_LOOP, capabilities.CURRENT_LIMIT, capabilities.SUPPLY_VOLTAGE,
        capabilities.VOLTAGE_LIMIT, capabilities.RETURNS_POWER, capabilities.REFERENCE_LIMIT,
        capabilities.POSITION_LOOP, capabilities.CASCADE, capabilities.DRIVE_STEP}),
    as_built=with_deviations,
    nominal={deviation.variable.name: 0.0 for deviation in DEVIATIONS},
    initial=initial,
    sample=sample,
    derivatives=derivatives,
    step=step,
    output_values=output_values,
    longest_tick=nonlinear.longest_tick,
    tick_remedy=electromechanical.TICK_REMEDY,
    transport_delay=electromechanical.transport_delay,
    reference="emcas_fmu.reference.electrohydrostatic",
    modules=(sys.modules[__name__], cylinder, pump, drive, fluid_power, events),
)
