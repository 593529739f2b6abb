"""Series clutch actuator: the nonlinear actuator's motor, one electromagnetic clutch, and a screw with a no-back.

    J_m m' = K_t i - C_m sgn m - b_m m - F              |F| <= C(phi), F = C sgn(m - w) while the clutch slips
    J_s w' = F - C_s sgn w - b_s w - e L                e = 1/forward where L w > 0, else backward = 0

m and w are the speeds of motor and screw, with inertia J, dry friction C and viscous friction b each (m, s); F is the
torque of the clutch, C(phi) its capacity at the flux phi, L the load at the screw. The motor with its current loop
turns the screw through a friction clutch (:mod:`emcas_fmu.physics.clutch`). The coil has its rated current while the
drive is enabled, otherwise none. The clutch limits the torque: under a shock from stop, jam or load it slips, and the
rotor keeps turning. A no-back prevents the load from driving the motor. Its torque is proportional to the load, as on
the screws of flaps and stabilisers: the nut's axial force presses friction discs between screw and housing, and a
ratchet lets them turn freely while the load opposes the motion. The discs balance the torque of a load that acts with
the motion, at once and without power; for the motor this is a screw with a backward efficiency of 0
(:mod:`emcas_fmu.physics.screw`). Loads that act with the motor return no energy, as in the thesis. Without power the
fin resists any load.

The drive is fed through a diode. A resistor dissipates the power that the motor returns and the coil does not consume;
its chopper keeps the DC link at the supply's voltage. v i is the power of the motor, v_c i_c that of the coil, 0 while
the suppressor dissipates the coil's energy:

    supply_power = max(v i + v_c i_c, 0)                braking_power = max(-(v i + v_c i_c), 0)

The link has no capacitance; diode and chopper change no trajectory. Encoder and loops are the nonlinear actuator's, on
the screw instead of the motor.

Events (:mod:`emcas_fmu.steppers.events`): the clutch locks or slips, screw or rotor comes to rest or starts, the load
begins to drive the screw or to oppose it, the fin meets a stop, the coil's amplifier or the drive's voltage reaches or
leaves a limit.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from typing import Any

from ...control import controllers, sensors
from ...namespace import Record, with_values
from ...ops.base import Ops, Value
from ...physics import clutch, clutched_screw, drive, friction, kinematics, loads, mechanics, screw
from ...physics.clutched_screw import Train
from ...physics.stick import WALL
from ...rules import rule, when
from ...steppers import electrical, events, rigid
from ...variables import parameter, real_output, tunable
from .. import capabilities
from ..composition import Group, Output
from ..declaration import PlantFault, PlantInputs, SampleInputs, State, Supply, Values
from . import clutches, groups, interface, nonlinear, plausibility, rules
from .nonlinear import as_built

STATES = (*clutches.SCREW, *interface.DRIVE, State("coil_current", "A"),
          State("flux", "A", "as the steady coil current that holds it"), clutches.TEMPERATURE)
SUPPLY_POWER = real_output("supply_power", "W", "electrical power from the supply to motor and coil; never negative",
                           1000.0, minimum=0.0)
_CLUTCH = Group((
    *clutches.CLUTCH.parameters,
    parameter("clutch.share", "1", 0.0, 10.0, "ratio of the clutch's torque to the rated torque"),
    parameter("coil.kp", "V/A", 1e-6, 1e4, "proportional gain of the coil's amplifier"),
    parameter("coil.connected", "1", 0.0, 1.0, "share of its reference current in the coil (0: open coil)")), (
    Output(real_output("coil_current", "A", "coil current of the clutch", 1.0)),
    Output(real_output("clutch_torque", "N.m", "torque on the screw by the clutch", 1.0),
           lambda ops, p, m: clutched_screw.torque(ops, m.train, m.motion)),
    Output(real_output("slip_power", "W", "slip heat of the clutch", 1000.0, minimum=0.0),
           lambda ops, p, m: _slip_power(m.train, m.motion, m.x)),
    clutches.CLUTCH_TEMPERATURE))
_POWERS = Group(groups.EFFICIENCY.parameters, (
    Output(SUPPLY_POWER, lambda ops, p, m: ops.maximum(m.power, 0.0)),
    Output(real_output("braking_power", "W", "power to the drive's braking resistor: the motor's return less the "
                       "coil's consumption", 100.0, minimum=0.0), lambda ops, p, m: ops.maximum(-m.power, 0.0)),
    Output(real_output("screw_loss", "W", "power that no-back and screw turn into heat under load", 100.0, minimum=0.0),
           lambda ops, p, m: (m.motion.felt - 1.0) * clutched_screw.transmitted(ops, m.train, m.motion)
           * m.x.screw_speed)), terminal="", provides=(capabilities.SUPPLY_VOLTAGE,))
FAULTS = (
    *clutches.faults("the clutch slips", ("coil.connected", "the clutch"), ("clutch.share",)),
    PlantFault("clutch_engaged", "the no-back fails: through the engaged clutch the load drives the motor",
               lambda ops, p, amounts: {"efficiency.backward": amounts.share}, (
                   tunable("share", "1", 0.0, 1.0, "share of the load's torque that the screw transmits"),)),
)
MODULES = (clutched_screw, screw, clutch, kinematics, mechanics, friction, loads, drive, sensors, controllers, events)


def _screw_side(p: Any) -> Any:
    """Return the parameters of the screw, with the driven side of the clutch as its rotor."""
    return with_values(p, {"inertia.motor": p.clutch.driven_inertia})


def _as_one(p: Any) -> Any:
    """Return the parameters of motor, locked clutch and screw as one rotor, for the loops."""
    dry, viscous, motor = p.friction.coulomb, p.friction.viscous, p.motor
    return with_values(p, {
        "inertia.motor": p.inertia.motor + p.clutch.driving_inertia + p.clutch.driven_inertia,
        **{f"friction.coulomb.{way}": (c[0] + motor.coulomb_friction, *c[1:]) for way, c in vars(dry).items()},
        **{f"friction.viscous.{way}": b + motor.viscous_friction for way, b in vars(viscous).items()}})


def initial(ops: Ops, p: Any, start: Record) -> Values:
    """Return the states of plant and controllers at rest at a fin angle, with the clutch engaged."""
    at_rest = dict(nonlinear.initial(ops, _as_one(p), start))
    angle, current = at_rest.pop("motor_angle"), p.coil.connected * p.clutch.rated_current
    return {**at_rest, "screw_angle": angle, "coil_current": current, "flux": current,
            "clutch_temperature": p.friction.temperature}


def sample(ops: Ops, p: Any, x: Record, inputs: SampleInputs) -> Values:
    """Return the reference and the states of the controllers after a sample; while disabled they are held in reset."""
    return nonlinear.sample(ops, _as_one(p), clutches.as_cascade(x, x.motor_current), inputs)


def _surroundings(ops: Ops, p: Any, x: Record, u: PlantInputs, angle: Value) -> Record:
    """Return the mode at a screw angle [rad], without the directions of sliding."""
    c = mechanics.coefficients(ops, _screw_side(p), angle, u)
    high, low = (way * mechanics.breakaway(ops, p, c, way) for way in (1.0, -1.0))
    high, low = screw.held(ops, p, c, high, low)
    least, most = rigid.stops(ops, p)
    reference = ops.where(u.enabled, p.coil.connected * p.clutch.rated_current, 0.0)
    return Record(mechanics=c, stops=(least, most), alpha_x=u.alpha_x,
                  coil=clutch.coil(ops, p, reference, p.coil.kp, x.coil_current, u.supply),
                  sliding=tuple(friction.coulomb(ops, p, way, c.fin) for way in (1.0, -1.0)),
                  viscous=tuple(friction.viscous(ops, p, way) for way in (1.0, -1.0)),
                  high=ops.where(x.screw_angle >= most, WALL, high), low=ops.where(x.screw_angle <= least, -WALL, low))


def _train(ops: Ops, p: Any, x: Record, m: Record) -> Train:
    """Return rotor, clutch and screw in a mode."""
    side, c, rotor = _screw_side(p), m.mechanics, clutches.rotor_inertia(p)
    viscous = ops.where(x.screw_speed > 0.0, m.viscous[0], m.viscous[1])
    share = p.clutch.share * clutch.share_at(ops, p, x.clutch_temperature)
    return Train(
        rotor=rotor, screw=screw.rotor_inertia(side), behind_inertia=screw.load_inertia(side, c.gain),
        rotor_torque=drive.torque(p, x.motor_current) - p.motor.viscous_friction * x.motor_speed - rotor * m.alpha_x,
        screw_torque=c.rotor - viscous * x.screw_speed, dry=p.motor.coulomb_friction,
        capacity=clutch.capacity(p, x.flux, share), sliding=m.sliding,
        load=(screw.load(p, c, x.screw_speed, 1.0), screw.load(p, c, x.screw_speed, -1.0)), behind=screw.behind(c),
        high=m.high, low=m.low, forward=screw.forward(ops, p), backward=screw.backward(ops, p))


def mode(ops: Ops, p: Any, x: Record, u: PlantInputs, h: Value) -> Record:
    """Return the mode of a step of `h` [s]; its mechanics are those of mid-step."""
    m = _surroundings(ops, p, x, u, x.screw_angle + 0.5 * h * x.screw_speed)
    t = _train(ops, p, x, m)
    motion = clutched_screw.motion(ops, t, x.screw_speed, x.motor_speed)
    return Record(**vars(m), motion=motion, drive=electrical.electrical_mode(
        ops, p, x, u, h, lambda: clutched_screw.accelerations(ops, t, motion)[1]))


def _slip_power(t: Train, motion: clutched_screw.Directions, x: Record) -> Value:
    return motion.clutch * t.capacity * (x.motor_speed - x.screw_speed)


def _mechanical(ops: Ops, p: Any, x: Record, m: Record) -> Values:
    """Return d/dt of the states of screw, rotor and clutch."""
    t = _train(ops, p, x, m)
    turning, rotor = clutched_screw.accelerations(ops, t, m.motion)
    return {"screw_angle": x.screw_speed, "screw_speed": turning, "motor_speed": rotor,
            "coil_current": m.coil.rate(ops, p, x.coil_current), "flux": clutch.flux_rate(p, x.coil_current, x.flux),
            "clutch_temperature": clutch.warming(p, _slip_power(t, m.motion, x), x.clutch_temperature)}


def _rates(ops: Ops, p: Any, x: Record, u: PlantInputs, m: Record) -> Values:
    return {**_mechanical(ops, p, x, m), **electrical.rates(ops, p, m.drive, x)}


def derivatives(ops: Ops, p: Any, x: Record, u: PlantInputs) -> Values:
    """Return d/dt of the states, (2.17), (2.46), (2.47), for a locked clutch, without no-back and dry friction.

    Viscous friction is the mean of both directions.
    """
    rates = dict(nonlinear.derivatives(ops, _as_one(p), clutches.as_cascade(x, x.motor_current), u))
    angle = rates.pop("motor_angle")
    return {**rates, "screw_angle": angle, "screw_speed": rates["motor_speed"]}


def _margins(ops: Ops, p: Any, x: Record, u: PlantInputs, m: Record) -> Values:
    return {**clutched_screw.margins(ops, _train(ops, p, x, m), m.motion, x.screw_speed, x.motor_speed),
            "stop": clutches.stop_margin(ops, m.motion.screw, m.stops, x.screw_angle),
            "coil": m.coil.margin(ops, p, x.coil_current),
            "voltage": electrical.reserve(ops, p, m.drive, x)}


def _landed(ops: Ops, p: Any, begin: Record, x: Record, u: PlantInputs, m: Record, events: Values) -> Values:
    turning, rotor = clutched_screw.landed(ops, m.motion, (begin.screw_speed, begin.motor_speed),
                                           (x.screw_speed, x.motor_speed), events)
    return {**clutches.stopped(ops, events["stop"], m.motion.screw, m.stops, x, turning, rotor),
            "drive_integral": electrical.integral_end(ops, p, m.drive, x)}


def moment(ops: Ops, p: Any, x: Record, u: PlantInputs) -> tuple[Any, Record]:
    """Return the parameters as built, and the values from which the outputs follow."""
    p = as_built(ops, p)
    voltage, current, clipped = nonlinear.electrical(ops, p, x.motor_speed, x, u)
    x = x.replace(motor_current=current)
    m = _surroundings(ops, p, x, u, x.screw_angle)
    t = _train(ops, p, x, m)
    motion = clutched_screw.motion(ops, t, x.screw_speed, x.motor_speed)
    limited = ops.either(u.limited > 0.0, ops.negate(ops.equal(m.coil.side, 0.0)))
    return p, interface.moment(
        ops, p, x, u, x.screw_angle, x.screw_speed, motor_voltage=voltage, motor_current=current,
        limited=ops.either(clipped > 0.0, limited), train=t, motion=motion,
        power=voltage * current + m.coil.power(ops, p, x.coil_current))


COMPOSITION = interface.composed(
    moment, *clutches.SCREW_SIDE, groups.HINGE.reworded(
        {"current or voltage": "current, the drive's voltage or the coil amplifier's"}),
    groups.CURRENT, groups.VOLTAGE_LIMIT, groups.INDUCTANCE, groups.DELAY, groups.CURRENT_GAIN, groups.CURRENT_LIMIT,
    groups.CURRENT_LOOP, groups.POLE_PAIRS, clutches.FRICTION, _CLUTCH, _POWERS)


@rule("inertia.screw + clutch.driven_inertia = %.6g kg.m2 must be above 0: the screw turns freely while the clutch "
      "slips; raise one of them")
def _screw_inertia(ops: Ops, p: Any, _: Value) -> tuple[Value, ...]:
    inertia = p.inertia.screw + p.clutch.driven_inertia
    return when(ops, inertia <= 0.0), inertia


_JAMMING = rules.jamming("clutch and screw", lambda ops, p: _screw_side(p), nonlinear.longest_tick)
ACTUATOR = replace(
    nonlinear.ACTUATOR,
    **COMPOSITION.declared((_screw_inertia, _JAMMING, *plausibility.of_screw(lambda ops, p: _as_one(p))),
                           motor="motor, clutch and screw"),
    name="series-clutch",
    title="clutch actuator: the nonlinear one with a clutch between motor and screw, and a no-back on the screw",
    origin="Section 1.1.1.2 of the thesis of Yerlikaya (2016) mentions an electromechanical actuator with a clutch: "
           "loads that act with the motor return no energy. It gives no numbers: those of clutch, no-back and friction "
           "are engineering estimates, the gains are tuned, the others are the nonlinear set's.",
    states=STATES,
    encoder=("screw_angle", "screw_speed"),
    controllers_read=("screw_speed", "motor_current"),
    supply=Supply(interface.SUPPLY_VOLTAGE, SUPPLY_POWER, interface.SUPPLY.inverse_inductance),
    descriptions={**interface.INPUT_DESCRIPTIONS, "angular_acceleration.x": interface.rolling(
                      "inertia.motor + clutch.driving_inertia + clutch.driven_inertia + inertia.screw"),
                  "enable": "false opens the drive's bridge and the clutch: the no-back holds the fin under any load"},
    faults=FAULTS,
    initial=initial,
    sample=sample,
    derivatives=derivatives,
    # The sign of a load near 0 is rounding: `least` keeps the steps to its event so long that the current changes.
    step=events.Switched(mode, _rates, _margins, _landed, electrical.begun, least={"load": 1e-3}).step(as_built),
    reference="emcas_fmu.reference.series_clutch",
    modules=(sys.modules[__name__], *MODULES),
)
