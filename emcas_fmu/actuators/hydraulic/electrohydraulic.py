"""Electrohydraulic actuator: pressure line, servovalve, cylinder, lever and fin.

Cylinder: :mod:`emcas_fmu.physics.cylinder`, valve: :mod:`emcas_fmu.physics.servovalve`, position loop:
:mod:`emcas_fmu.control.fluid_power`. The loop's speed reference, relative to the speed with the open valve at its rated
pressure, is the valve's command. Without `enable` the spool returns to its null, and the oil in the chambers holds the
fin. A check valve refills a chamber below the tank's pressure. If its flow is too small, a void forms: the pressure
stays 0 until the inflow exceeds the flow that the piston's motion demands. The volume of the void is neglected.

Events (:mod:`emcas_fmu.steppers.events`): the fin starts, comes to rest or meets a stop, the spool reaches the end of
its stroke, or reaches or leaves its largest speed, a check valve opens or closes, a void forms. The end of a void is
not an event, as no rate jumps there.
"""

from __future__ import annotations

import sys
from typing import Any

from ...control import fluid_power
from ...control.trajectory import Ahead, Motion
from ...namespace import Record
from ...ops.base import Ops, Value
from ...physics import cylinder, servovalve
from ...steppers import events
from ...variables import parameter, real_input, real_output, tunable
from .. import as_built as deviations
from .. import capabilities, fin_port
from ..composition import Group, Output
from ..declaration import FIN, Actuator, PlantFault, PlantInputs, SampleInputs, State, Supply, Values
from ..electromechanical import groups
from . import fin, interface

SUPPLY_PRESSURE = real_input("supply_pressure", "Pa", "pressure of the line that feeds the valve", minimum=0.0,
                             maximum=1e9, nominal=1e7, start=None, key="hydraulic_supply.pressure",
                             sheet="supply: line pressure")
SUPPLY_POWER = real_output("supply_power", "W", "hydraulic power from the pressure line", 1000.0)
VALVE = (State("spool_position", "1", "as a share of the stroke"), State("spool_speed", "1/s", "strokes per second"))
_DELAY = Group(fin_port.described({"drive.transport_delay": "delay from a sample to the coil of the valve"},
                                  groups.DELAY.parameters))
_VALVE = Group((
    parameter("cylinder.start_pressure", "Pa", 0.0, 1e9, "pressure in both chambers at the start"),
    parameter("tank.pressure", "Pa", 0.0, 1e8, "pressure of the return line, p_t", sheet="supply: return pressure"),
    parameter("valve.rated_flow", "m3/s", 1e-9, 1.0, "flow of the open valve at valve.rated_pressure, Q_r",
              sheet="servovalve: rated flow"),
    parameter("valve.rated_pressure", "Pa", 1e3, 1e9, "pressure drop across both edges for valve.rated_flow",
              sheet="servovalve: pressure drop of the rated flow, across both edges"),
    parameter("valve.natural_frequency", "rad/s", 1.0, 1e5, "natural frequency of the spool",
              sheet="servovalve: natural frequency of the spool", quantity="AngularFrequency"),
    parameter("valve.damping", "1", 0.0, 100.0, "damping ratio of the spool",
              sheet="servovalve: damping ratio of the spool"),
    parameter("valve.stroke_time", "s", 1e-5, 10.0, "shortest time from the centre to the end of the stroke",
              sheet="servovalve: least time to full stroke", display="ms"),
    parameter("valve.lap", "1", 0.0, 1.0, "underlap of the rounded edges, as a share of the stroke; it causes the "
              "leakage at null"),
    parameter("valve.laminar_pressure", "Pa", 1.0, 1e8, "pressure drop below which an edge's flow is laminar"),
    parameter("valve.null_shift", "1", -2.0, 2.0, "spool position without a command, as a share of the stroke (2: at "
              "its end at any command)")), (
    Output(real_output("valve_reference", "1", "commanded spool position, as a share of the stroke", 1.0, minimum=-1.0,
                       maximum=1.0), lambda ops, p, m: m.u.sampled_reference),
    Output(real_output("valve_position", "1", "spool position, as a share of the stroke", 1.0, minimum=-1.0,
                       maximum=1.0), lambda ops, p, m: m.x.spool_position),
    Output(real_output("supply_flow", "m3/s", "flow from the pressure line", 1e-4))),
    deviations=(deviations.RATED_FLOW,), terminal="hydraulics",
    imperfections={"null of the valve": {"valve.null_shift": 0.0}})
_POWER = Group(outputs=(Output(SUPPLY_POWER, lambda ops, p, m: m.u.supply * m.supply_flow),), terminal="",
               provides=(capabilities.SUPPLY_PRESSURE,))
FAULTS = (
    PlantFault("hard_over", "the spool stays at one end of its stroke, whatever the command",
               lambda ops, p, amounts: {"valve.null_shift": 2.0}),
    PlantFault("silting", "dirt in the valve shifts its null and fills its clearance", lambda ops, p, amounts: {
        "valve.null_shift": p.valve.null_shift + amounts.shift, "valve.lap": amounts.lap}, (
            tunable("shift", "1", -2.0, 2.0, "shift of the null, as a share of the stroke"),
            tunable("lap", "1", 0.0, 1.0, "value of valve.lap under the fault"))),
    PlantFault.scaling("internal_leakage", "the seal of the piston leaks more",
                       tunable("factor", "1", 1.0, 1e4, "factor by which the leakage across the piston rises"),
                       "cylinder.internal_leakage"),
    PlantFault.scaling("air", "air in the oil makes it softer", interface.AIR, "oil.bulk_modulus"),
)


def initial(ops: Ops, p: Any, start: Record) -> Values:
    """Return the states of plant and controller at rest at a fin angle."""
    return interface.initial(ops, p, start, p.cylinder.start_pressure)


def sample(ops: Ops, p: Any, x: Record, inputs: SampleInputs) -> Values:
    """Return the reference and the states of the controller after a sample; while disabled they are held in reset."""
    measured = fluid_power.measured(ops, p, inputs.position)
    full = p.valve.rated_flow / p.cylinder.area  # piston speed [m/s] with the open valve at its rated pressure
    out = fluid_power.sample(ops, p, x.integral, x.piston, measured, inputs.command, full, inputs.ahead)
    at_rest = fluid_power.at_rest(ops, p, measured)
    return {"reference": ops.where(inputs.enable, out.speed / full, 0.0),
            "integral": ops.where(inputs.enable, out.integral, at_rest),
            "piston": cylinder.piston_position(ops, p, measured),
            "measured_fin_angle": measured, "limited": ops.where(inputs.enable, out.limited, 0.0)}


def feed_forward(ops: Ops, p: Any, motion: Motion, memory: Value) -> tuple[Ahead, Value, Value]:
    """Return the feed-forward of a motion of the fin, the unchanged memory, and the delay [s] with the spool's lag.

    The speed [m/s] refers to the valve's rated pressure; without load the drop at an edge is the start pressure minus
    the tank's.
    """
    share = ops.sqrt(0.5 * p.valve.rated_pressure / ops.maximum(p.cylinder.start_pressure - p.tank.pressure, 1.0))
    speed = share * fluid_power.piston_motion(ops, p, motion)[0]
    return Ahead(speed, 0.0), memory, p.drive.transport_delay + 2.0 * p.valve.damping / p.valve.natural_frequency


def mode(ops: Ops, p: Any, x: Record, u: PlantInputs, h: Value) -> Record:
    """Return the mode of a step of `h` [s]; its linkage is that of mid-step."""
    linkage, motion = fin.mode(ops, p, x, u, h)
    command = ops.clip(ops.where(u.enabled, u.reference, 0.0) + p.valve.null_shift, -1.0, 1.0)
    faster = servovalve.spool_acceleration(p, x.spool_position, x.spool_speed, command) * x.spool_speed > 0.0
    at_limit = ops.fabs(x.spool_speed) >= servovalve.fastest(p) * fin_port.AT_LIMIT
    slows = ops.both(at_limit, ops.negate(faster))
    m = Record(linkage=linkage, fin=motion, command=command, at_speed=ops.both(at_limit, faster),
               slows=ops.where(slows, ops.sign(x.spool_speed), 0.0),  # the sign of the limit that the spool leaves
               refill_1=x.pressure_1 < p.tank.pressure, refill_2=x.pressure_2 < p.tank.pressure,
               void_1=False, void_2=False)
    rates = _rates(ops, p, x, u, m)
    return m.replace(void_1=ops.both(x.pressure_1 <= 0.0, rates["pressure_1"] <= 0.0),
                     void_2=ops.both(x.pressure_2 <= 0.0, rates["pressure_2"] <= 0.0))


def _rates(ops: Ops, p: Any, x: Record, u: PlantInputs, m: Record) -> Values:
    c, tank = m.linkage, p.tank.pressure
    flow_1, flow_2, _ = servovalve.flows(ops, p, x.spool_position, u.supply, x.pressure_1, x.pressure_2)
    flow_1 = flow_1 + cylinder.makeup(ops, p, x.pressure_1, tank, m.refill_1)
    flow_2 = flow_2 + cylinder.makeup(ops, p, x.pressure_2, tank, m.refill_2)
    rise_1, rise_2 = cylinder.pressure_rates(p, c, x.fin_rate, x.pressure_1, x.pressure_2, flow_1, flow_2)
    spool = servovalve.spool_acceleration(p, x.spool_position, x.spool_speed, m.command)
    return {**fin.rates(ops, p, x, m),
            "pressure_1": ops.where(m.void_1, 0.0, rise_1), "pressure_2": ops.where(m.void_2, 0.0, rise_2),
            "spool_position": x.spool_speed, "spool_speed": ops.where(m.at_speed, 0.0, spool)}


def derivatives(ops: Ops, p: Any, x: Record, u: PlantInputs) -> Values:
    """Return d/dt of the states, without dry friction, with closed check valves and the spool within its limits."""
    p = as_built(ops, p)
    c = cylinder.linkage(ops, p, x.fin_angle, u)
    return _rates(ops, p, x, u, Record(linkage=c._replace(dry=0.0), fin=fin.FREE,
                                       command=u.reference + p.valve.null_shift, at_speed=False, slows=0.0,
                                       refill_1=False, refill_2=False, void_1=False, void_2=False))


def _margins(ops: Ops, p: Any, x: Record, u: PlantInputs, m: Record) -> Values:
    tank, fastest = p.tank.pressure, servovalve.fastest(p)
    faster = servovalve.spool_acceleration(p, x.spool_position, x.spool_speed, m.command) * x.spool_speed

    def refilling(pressure: Value, open_: Value) -> Value:
        return ops.where(open_, tank - pressure, pressure - tank)

    return {**fin.margins(ops, p, x, m),
            "speed": ops.where(m.at_speed, faster, fastest + ops.where(
                ops.equal(m.slows, 0.0), -ops.fabs(x.spool_speed), m.slows * x.spool_speed)),
            "stroke": 1.0 - ops.fabs(x.spool_position),
            "refill_1": refilling(x.pressure_1, m.refill_1), "refill_2": refilling(x.pressure_2, m.refill_2),
            "void_1": ops.where(m.void_1, 1.0, x.pressure_1), "void_2": ops.where(m.void_2, 1.0, x.pressure_2)}


def _landed(ops: Ops, p: Any, begin: Record, x: Record, u: PlantInputs, m: Record, events: Values) -> Values:
    fastest, side = servovalve.fastest(p), ops.where(x.spool_position > 0.0, 1.0, -1.0)
    at_end = ops.fabs(x.spool_position) >= 1.0
    end = ops.either(events["stroke"], at_end)
    outward = ops.either(events["stroke"], x.spool_speed * side > 0.0)
    met = ops.both(events["speed"], ops.negate(m.at_speed))
    speed = ops.where(met, ops.where(x.spool_speed > 0.0, fastest, -fastest), x.spool_speed)
    return {**fin.landed(ops, p, begin, x, m, events),
            "pressure_1": ops.where(events["void_1"], 0.0, ops.maximum(x.pressure_1, 0.0)),
            "pressure_2": ops.where(events["void_2"], 0.0, ops.maximum(x.pressure_2, 0.0)),
            "spool_position": ops.where(end, side, x.spool_position),
            "spool_speed": ops.where(ops.both(end, outward), 0.0, speed)}


def moment(ops: Ops, p: Any, x: Record, u: PlantInputs) -> tuple[Any, Record]:
    """Return the parameters as built, and the values from which the outputs follow."""
    p = as_built(ops, p)
    _, _, supply_flow = servovalve.flows(ops, p, x.spool_position, u.supply, x.pressure_1, x.pressure_2)
    at_speed = ops.fabs(x.spool_speed) >= servovalve.fastest(p) * fin_port.AT_LIMIT
    limited = ops.either(at_speed, ops.either(ops.fabs(x.spool_position) >= 1.0, u.limited > 0.0))
    return p, fin_port.at_fin(ops, p, x, u, limited, supply_flow=supply_flow)


COMPOSITION = interface.composed(moment, _DELAY, interface.friction(), interface.filled_cylinder(least=0.0), _VALVE,
                                 _POWER)
as_built = COMPOSITION.as_built
ACTUATOR = Actuator(
    **COMPOSITION.declared(hydraulics="cylinder and valve"),
    name="electrohydraulic",
    title="electrohydraulic actuator: pressure line, servovalve, cylinder, lever and fin",
    origin="Section 1.1.3 of the thesis of Yerlikaya (2016) describes the structure, without numbers. Entries are "
           "engineering estimates where their source says so.",
    controllers_read=(),
    reference_output="valve_reference",
    states=(*FIN, *interface.CHAMBERS, *VALVE),
    controller_states=interface.CONTROLLER,
    supply=Supply(SUPPLY_PRESSURE, SUPPLY_POWER),
    descriptions={"enable": "false: the valve centres itself, and the oil in the chambers holds the fin"},
    as_built=as_built,
    reference="emcas_fmu.reference.electrohydraulic",
    initial=initial,
    sample=sample,
    feed_forward=feed_forward,
    derivatives=derivatives,
    step=events.Switched(mode, _rates, _margins, _landed).step(as_built),
    transport_delay=fin_port.transport_delay,
    faults=FAULTS,
    modules=(sys.modules[__name__], cylinder, servovalve, fluid_power, events),
)
