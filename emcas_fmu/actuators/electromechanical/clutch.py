"""Dual-clutch actuator: a motor that turns one way, two contra-rotating clutches, screw, lever and fin.

    J_s w' = F_1 + F_2 - C_s sgn w - b_s w + T/n     J_m m' = K_t i_m - C_m sgn m - b_m m - F_1 + F_2
    F_1 = C_1 sgn(m - w)       F_2 = -C_2 sgn(m + w)        i_m = max(V - K_e m, 0)/R
    i_1,ref = I_b + max(i_ref, 0)                            i_2,ref = I_b + max(-i_ref, 0)

w and m are the speeds of screw and motor, with inertia J, dry friction C and viscous friction b each (s, m); F_k is the
torque of clutch k on the screw while it slips, C_k its capacity (:mod:`emcas_fmu.physics.clutch`), T the external
moment about the hinge, n the ratio. Clutch 1 turns the screw with the motor, clutch 2, through a gear, against it. The
reference u of the loops of :mod:`emcas_fmu.control.controllers` is a net coil current i_ref, drive.current_gain times u
plus drive.current_offset within +-drive.current_limit: for the loops the slipping clutches are a motor with a constant
torque per ampere. The bias I_b in both coils avoids a dead band of the torque. The supply feeds the motor through a
diode, without control and inductance. Rotor and screw are two bodies with four dry frictions
(:mod:`emcas_fmu.physics.coupled`), two of them the clutches: a clutch slips, or is locked, with w = m or w = -m to the
bit. Without `enable` both coils are off, and the motor keeps turning: only loads, friction and the clutches' residual
torques act on the screw. No power returns to the supply: the motor's diode blocks its current, and suppressors
dissipate the coils' energy.

Events (:mod:`emcas_fmu.steppers.events`): a clutch locks or slips, screw or motor comes to rest or starts, the fin
meets a stop, a coil's amplifier reaches or leaves a limit, the motor's diode opens or closes.
"""

from __future__ import annotations

import sys
from typing import Any

from ...control import controllers, sensors
from ...namespace import Record, with_values
from ...ops.base import Ops, Value
from ...physics import clutch, coupled, drive, friction, kinematics, loads, mechanics
from ...physics.coupled import Bodies, Dry
from ...physics.stick import WALL
from ...steppers import events, rigid
from ...variables import parameter, real_output
from .. import capabilities, fin_port
from ..composition import Group, Output
from ..declaration import Actuator, PlantFault, PlantInputs, SampleInputs, State, Supply, Values
from . import clutches, groups, interface, nonlinear
from .nonlinear import as_built

STATES = (*clutches.SCREW, State("coil_current_1", "A"), State("coil_current_2", "A"),
          *(State(f"flux_{k}", "A", "as the steady coil current that holds it") for k in (1, 2)),
          clutches.TEMPERATURE)
SUPPLY_POWER = real_output("supply_power", "W", "electrical power from the supply to motor and coils; never negative",
                           1000.0, minimum=0.0)
_WAYS = ((1, "with"), (2, "against"))
_CLUTCHES = Group((
    parameter("motor.start_speed", "rad/s", 0.0, 1e5, "motor speed at the start", display="rpm"),
    *clutches.CLUTCH.parameters,
    *(parameter(f"clutch.share_{k}", "1", 0.0, 10.0, f"ratio of the torque of the clutch that turns the screw {way} "
                "the motor to the rated torque") for k, way in _WAYS),
    parameter("clutch.bias_current", "A", 0.0, 1e3, "smallest reference of each coil current while enabled, I_b"),
    parameter("coil.connected_1", "1", 0.0, 1.0, "share of its reference current in the coil of the clutch that "
              "turns the screw with the motor (0: open coil)")), (
    *(Output(real_output(f"coil_current_{k}", "A",
                         f"coil current of the clutch that turns the screw {way} the motor", 1.0)) for k, way in _WAYS),
    *(Output(real_output(f"clutch_torque_{k}", "N.m",
                         f"torque on the screw by the clutch that turns it {way} the motor", 1.0)) for k, way in _WAYS),
    *(Output(real_output(f"slip_power_{k}", "W", f"slip heat of the clutch that turns the screw {way} the motor",
                         1000.0, minimum=0.0)) for k, way in _WAYS),
    clutches.CLUTCH_TEMPERATURE))
_AMPLIFIERS = Group(fin_port.described({
    "drive.current_limit": "largest net reference current of both coils",
    "drive.current_gain": "net coil current demanded per volt of reference",
    "drive.current_offset": "net coil current demanded at zero reference",
    "drive.kp": "proportional gain of the coils' amplifiers",
}, (*groups.CURRENT_GAIN.parameters, *groups.CURRENT_LIMIT.parameters, groups.KP)),
    imperfections=groups.CURRENT_LIMIT.imperfections)
FAULTS = (
    *clutches.faults("the motor keeps turning in its clutches",
                     ("coil.connected_1", "the clutch that turns the screw with the motor"),
                     ("clutch.share_1", "clutch.share_2")),
    PlantFault("both_engaged", "both clutches are engaged", lambda ops, p, amounts: {
        "clutch.bias_current": p.clutch.rated_current}),
)
MODULES = (coupled, clutch, kinematics, mechanics, friction, loads, sensors, controllers, events)


def _screw_side(p: Any) -> Any:
    """Return the parameters of screw and loops: the rotor is the clutches' driven side, with their torque constant."""
    return with_values(p, {"inertia.motor": p.clutch.driven_inertia,
                           "motor.torque_constant": clutch.torque_per_ampere(p)})


def initial(ops: Ops, p: Any, start: Record) -> Values:
    """Return the states with the fin at rest, the motor at its start speed and the bias current in both coils."""
    at_rest = dict(nonlinear.initial(ops, _screw_side(p), start))
    angle, bias = at_rest.pop("motor_angle"), p.clutch.bias_current
    return {**at_rest, "screw_angle": angle, "motor_speed": p.motor.start_speed,
            **dict.fromkeys(("coil_current_1", "coil_current_2", "flux_1", "flux_2"), bias),
            "clutch_temperature": p.friction.temperature}


def sample(ops: Ops, p: Any, x: Record, inputs: SampleInputs) -> Values:
    """Return the reference and the states of the controllers after a sample; while disabled they are held in reset."""
    # The net current of both coils causes the torque, as a motor's current does.
    cascade = clutches.as_cascade(x, x.coil_current_1 - x.coil_current_2)
    return nonlinear.sample(ops, _screw_side(p), cascade, inputs)


def _coils(ops: Ops, p: Any, x: Record, u: PlantInputs) -> tuple[clutch.Coil, clutch.Coil]:
    """Return both coils: a net current reference [A] goes to the coil of its sign; the bias is added to both."""
    net = drive.current_reference(ops, p, u.reference)
    # |net| instead of a maximum: its slope at 0 is the mean of both sides, as linear analysis needs it.
    half_size, bias = 0.5 * ops.fabs(net), p.clutch.bias_current
    first = ops.where(u.enabled, p.coil.connected_1 * (bias + (half_size + 0.5 * net)), 0.0)
    second = ops.where(u.enabled, bias + (half_size - 0.5 * net), 0.0)
    return (clutch.coil(ops, p, first, p.drive.kp, x.coil_current_1, u.supply),
            clutch.coil(ops, p, second, p.drive.kp, x.coil_current_2, u.supply))


def _surplus(ops: Ops, p: Any, speed: Value, u: PlantInputs) -> Value:
    """Return supply minus back-EMF [V] at a motor speed [rad/s]; below 0 the diode blocks."""
    return ops.maximum(u.supply, 0.0) - drive.back_emf(p, speed)


def _bodies(ops: Ops, p: Any, x: Record, u: PlantInputs, m: Record) -> Bodies:
    """Return screw and rotor as two bodies in a mode."""
    c = m.mechanics
    viscous = ops.where(x.screw_speed > 0.0, m.viscous[0], m.viscous[1])
    screw = c.load - viscous * x.screw_speed + c.centrifugal * x.screw_speed * x.screw_speed
    current = ops.where(m.feeds, _surplus(ops, p, x.motor_speed, u) / p.motor.resistance, 0.0)
    motor = drive.torque(p, current) - p.motor.viscous_friction * x.motor_speed
    share_at_temperature = clutch.share_at(ops, p, x.clutch_temperature)
    capacities = (clutch.capacity(p, flux, share_at_temperature * share) for flux, share in (
        (x.flux_1, p.clutch.share_1), (x.flux_2, p.clutch.share_2)))
    return Bodies((c.inertia, clutches.rotor_inertia(p)), (screw, motor),
                  (m.dry, Dry(p.motor.coulomb_friction, p.motor.coulomb_friction), *(Dry(t, t) for t in capacities)))


def _surroundings(ops: Ops, p: Any, x: Record, u: PlantInputs, angle: Value) -> Record:
    """Return the mode at a screw angle [rad], without the directions of sliding."""
    side = _screw_side(p)
    c = mechanics.coefficients(ops, side, angle, u)
    low, high = rigid.stops(ops, p)
    dry = Dry(ops.where(x.screw_angle >= high, WALL, mechanics.breakaway(ops, p, c, 1.0)),
              ops.where(x.screw_angle <= low, WALL, mechanics.breakaway(ops, p, c, -1.0)))
    viscous = tuple(mechanics.damping(ops, p, c, direction) for direction in (1.0, -1.0))
    return Record(mechanics=c, dry=dry, viscous=viscous, stops=(low, high), coils=_coils(ops, p, x, u),
                  feeds=_surplus(ops, p, x.motor_speed, u) > 0.0,
                  signs=(0.0,) * len(coupled.NAMES))


def mode(ops: Ops, p: Any, x: Record, u: PlantInputs, h: Value) -> Record:
    """Return the mode of a step of `h` [s]; its mechanics are those of mid-step."""
    m = _surroundings(ops, p, x, u, x.screw_angle + 0.5 * h * x.screw_speed)
    return m.replace(signs=coupled.directions(ops, _bodies(ops, p, x, u, m), x.screw_speed, x.motor_speed))


def _slip_powers(ops: Ops, b: Bodies, signs: tuple[Value, ...], x: Record) -> tuple[Value, Value]:
    """Return the powers [W] that both clutches dissipate."""
    speeds = coupled.slips(x.screw_speed, x.motor_speed)
    first, second = (b.dry[k].high * signs[k] * speeds[k] for k in (coupled.WITH, coupled.AGAINST))
    return first, second


def _rates(ops: Ops, p: Any, x: Record, u: PlantInputs, m: Record) -> Values:
    b = _bodies(ops, p, x, u, m)
    screw, motor = coupled.accelerations(ops, b, m.signs)
    first, second = (coil.rate(ops, p, current)
                     for coil, current in zip(m.coils, (x.coil_current_1, x.coil_current_2), strict=True))
    return {"screw_angle": x.screw_speed, "screw_speed": screw, "motor_speed": motor, "coil_current_1": first,
            "coil_current_2": second, "flux_1": clutch.flux_rate(p, x.coil_current_1, x.flux_1),
            "flux_2": clutch.flux_rate(p, x.coil_current_2, x.flux_2),
            "clutch_temperature": clutch.warming(p, sum(_slip_powers(ops, b, m.signs, x)), x.clutch_temperature)}


def derivatives(ops: Ops, p: Any, x: Record, u: PlantInputs) -> Values:
    """Return d/dt of the states with slipping clutches, amplifiers within their limits and a constant temperature.

    The screw has no dry friction, the motor turns forward, and its diode conducts. The screw's viscous friction is the
    mean of both directions.
    """
    p = as_built(ops, p)
    m = _surroundings(ops, p, x, u, x.screw_angle)
    viscous, none = 0.5 * (m.viscous[0] + m.viscous[1]), Dry(0.0, 0.0)
    free = tuple(coil._replace(side=0.0) for coil in m.coils)
    m = m.replace(viscous=(viscous, viscous), dry=none, coils=free, feeds=True, signs=(1.0, 1.0, 1.0, -1.0))
    return {**_rates(ops, p, x, u, m), "clutch_temperature": 0.0}


def _margins(ops: Ops, p: Any, x: Record, u: PlantInputs, m: Record) -> Values:
    surplus = _surplus(ops, p, x.motor_speed, u)
    first, second = m.coils
    return {**coupled.margins(ops, _bodies(ops, p, x, u, m), m.signs, x.screw_speed, x.motor_speed),
            "stop": clutches.stop_margin(ops, m.signs[coupled.SCREW], m.stops, x.screw_angle),
            "diode": ops.where(m.feeds, surplus, -surplus),
            "coil_1": first.margin(ops, p, x.coil_current_1), "coil_2": second.margin(ops, p, x.coil_current_2)}


def _landed(ops: Ops, p: Any, begin: Record, x: Record, u: PlantInputs, m: Record, events: Values) -> Values:
    screw, motor = coupled.landed(ops, m.signs, (begin.screw_speed, begin.motor_speed),
                                  (x.screw_speed, x.motor_speed), events)
    return clutches.stopped(ops, events["stop"], m.signs[coupled.SCREW], m.stops, x, screw, motor)


def moment(ops: Ops, p: Any, x: Record, u: PlantInputs) -> tuple[Any, Record]:
    """Return the parameters as built, and the values from which the outputs follow."""
    p = as_built(ops, p)
    m = mode(ops, p, x, u, 0.0)
    b, supply = _bodies(ops, p, x, u, m), ops.maximum(u.supply, 0.0)
    current = ops.maximum(_surplus(ops, p, x.motor_speed, u), 0.0) / p.motor.resistance
    power, limited = supply * current, u.limited > 0.0
    for coil, coil_current in zip(m.coils, (x.coil_current_1, x.coil_current_2), strict=True):
        power = power + coil.power(ops, p, coil_current)
        limited = ops.either(limited, ops.negate(ops.equal(coil.side, 0.0)))
    # With both bodies at rest the friction torques are not unique: the outputs are limited to the capacities.
    torques = [ops.clip(torque, -dry.low, dry.high)
               for torque, dry in zip(coupled.friction_torques(ops, b, m.signs), b.dry, strict=True)]
    slip_power_1, slip_power_2 = _slip_powers(ops, b, m.signs, x)
    return p, interface.moment(
        ops, p, x, u, x.screw_angle, x.screw_speed, motor_current=current, limited=limited, supply_power=power,
        clutch_torque_1=torques[coupled.WITH], clutch_torque_2=torques[coupled.AGAINST], slip_power_1=slip_power_1,
        slip_power_2=slip_power_2)


_POWER = Group(outputs=(Output(SUPPLY_POWER),), terminal="", provides=(capabilities.SUPPLY_VOLTAGE,))
COMPOSITION = interface.composed(
    moment, *clutches.SCREW_SIDE,
    groups.HINGE.reworded({"DAC, current or voltage": "DAC or an amplifier's voltage"}), _POWER,
    groups.DELAY.reworded({"current reference": "the reference of the coil current"}), _AMPLIFIERS, clutches.FRICTION,
    _CLUTCHES)
ACTUATOR = Actuator(
    **COMPOSITION.declared(motor="motor, clutches and screw"),
    name="clutch",
    title="clutch actuator: motor that turns one way, two contra-rotating clutches, ball screw, lever and fin",
    origin="Section 1.1.1.2 of the thesis of Yerlikaya (2016) mentions an actuator with a clutch, without equations. "
           "This form, two clutches on a motor that turns one way, is an engineering estimate, with its numbers; "
           "screw, lever and other entries are those of the thesis's actuator where their source says so.",
    states=STATES,
    controller_states=interface.CONTROLLER,
    encoder=("screw_angle", "screw_speed"),
    controllers_read=("screw_speed", "coil_current_1", "coil_current_2"),
    supply=Supply(interface.SUPPLY_VOLTAGE, SUPPLY_POWER, lambda ops, p, interval: (
        1.0 / (p.motor.resistance * interval) + 2.0 / p.coil.inductance)),
    descriptions={**interface.INPUT_DESCRIPTIONS, "angular_acceleration.x": interface.rolling(
                      "clutch.driven_inertia + inertia.screw", "the torque on the screw"),
                  "enable": "false switches both clutches off; the motor keeps turning"},
    faults=FAULTS,
    equal_parameters=interface.EQUAL,
    as_built=as_built,
    initial=initial,
    sample=sample,
    derivatives=derivatives,
    step=events.Switched(mode, _rates, _margins, _landed).step(as_built),
    transport_delay=fin_port.transport_delay,
    reference="emcas_fmu.reference.clutch",
    modules=(sys.modules[__name__], *MODULES),
)
