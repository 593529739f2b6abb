"""Supply: a source with resistance, a DC link with brake chopper, losses of the inverter, and an under-voltage trip.

The equations are those of :mod:`emcas_fmu.physics.supply`. The drive's voltage limit is the voltage of the link, in a
step the voltage at mid-step, predicted from the power at the start. The link then supplies the step's mean power.
Motor voltage and current follow the same exponential, or a line if the motor is not stepped by the package's equations.
The error is of second order in the tick. A step ends where the link is predicted to fall to the trip voltage. While
tripped, the bridge is open and the controllers are reset, as if enable were false; the trip ends at the end of a tick.

The link starts at the voltage of the source.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from ..actuators import capabilities, fin_port
from ..actuators.declaration import Actuator, PlantInputs, SampleInputs, State, Values
from ..namespace import Record
from ..ops.base import Ops, Value
from ..physics import drive, inverter, step_means, supply
from ..rules import rule, when
from ..steppers.electrical import electrical_mode
from ..steppers.events import PROGRESS
from ..variables import boolean_output, in_group, parameter, real_output, switch
from .currents import time_constant
from .declaration import Extension, also_read
from .status import DISABLED, OPERATIONAL, STATUS

STATES = (State("link_voltage", "V", "voltage of the DC link; -1 before the first step, which sets it to the source's"),
          State("supply_tripped", "1", "1 while the under-voltage trip holds the bridge open"),
          State("supply_charge", "A.s", "charge from the source since the start"))
_UNCHARGED = -1.0  # V, link voltage before the first step, in which it becomes the source's
# Largest phase [rad] by which the oscillation of winding and link at the voltage limit may advance in a tick.
_PHASE = 0.25

PARAMETERS = in_group(
    "supply",
    parameter("source_resistance", "Ohm", 1e-6, 1e3, "resistance of source and cable up to the DC link",
              sheet="supply: resistance of battery and cable"),
    switch("one_way", "true: a diode blocks current into the source; false: the source absorbs regenerated power"),
    parameter("capacitance", "F", 1e-6, 10.0, "capacitance of the DC link", sheet="drive: capacitance of the DC link"),
    parameter("chopper_voltage", "V", 1.0, 1e5, "link voltage above which the brake chopper conducts (set it out of "
              "reach for none)", sheet="drive: voltage at which the brake chopper switches on"),
    parameter("chopper_resistance", "Ohm", 1e-3, 1e6, "brake resistor; the chopper's current is the link voltage "
              "above chopper_voltage, divided by this resistance", sheet="drive: brake resistor"),
    parameter("trip_voltage", "V", 1.0, 1e3, "link voltage below which the bridge opens",
              sheet="drive: under-voltage trip"),
    parameter("recovery_voltage", "V", 1.0, 1e3, "link voltage above which the bridge closes again"),
    parameter("quiescent_power", "W", 0.0, 1e4, "power of the electronics; below trip_voltage it falls with v^2",
              sheet="drive: power of the electronics"),
    parameter("device_voltage", "V", 0.0, 100.0, "loss of the inverter per current: fixed drop and switching"),
    parameter("device_resistance", "Ohm", 0.0, 100.0, "loss of the inverter per square of the current: on-state "
              "resistance"),
)
SUPPLY_POWER = real_output("supply_power", "W", "electrical power from the source, including that of its resistance; "
                           "on a bus that is not stiff the mean over the last update; negative while the source "
                           "absorbs power", 1000.0)
OUTPUTS = (
    real_output("link_voltage", "V", "voltage of the DC link, which limits the motor's", 30.0, minimum=0.0),
    real_output("brake_power", "W", "power that the brake chopper turns into heat", 100.0, minimum=0.0),
    real_output("inverter_loss", "W", "power that the inverter turns into heat", 100.0, minimum=0.0),
    boolean_output("supply_tripped", "the link's voltage is too low; the bridge is open until it recovers"),
)


def _link(ops: Ops, p: Any, x: Record, source: Value, enable: Value) -> tuple[Value, Value]:
    """Return the link's voltage [V], before the first step the source's, and whether the bridge is closed."""
    link = ops.where(x.link_voltage < 0.0, ops.maximum(source, 0.0), x.link_voltage)
    return link, ops.both(enable, ops.negate(supply.tripped(ops, p, link, x.supply_tripped)))


def _inverse_inductance(ops: Ops, p: Any, interval: Value) -> Value:
    """Return the effective 1/L [1/H] on the line, of source resistance and link capacitance, in an interval [s]."""
    return supply.admittance(ops, p, interval) / interval


def _course(ops: Ops, p: Any, x: Record, current: Value, before: Value, interval: Value) -> tuple[Value, Value]:
    """Return the source's charge [A.s] from the start, and mean current [A] in the next interval; see `Supply`."""
    mean = (x.supply_charge - before) / interval
    return x.supply_charge, supply.mean_ahead(ops, p, current, mean, interval)


def extend(actuator: Actuator) -> Actuator:
    """Return the actuator fed by a source through a DC link."""
    stepped = capabilities.DRIVE_STEP in actuator.provides

    def electrical(ops: Ops, p: Any, x: Record, u: PlantInputs) -> tuple[Value, Value]:
        """Return motor voltage [V] and current [A]."""
        shown = actuator.plant_outputs(ops, p, x, u)
        return shown["motor_voltage"], shown["motor_current"]

    def initial(ops: Ops, p: Any, start: Record) -> Values:
        return {**actuator.initial(ops, p, start), "link_voltage": _UNCHARGED, "supply_charge": 0.0}

    def sample(ops: Ops, p: Any, x: Record, inputs: SampleInputs) -> Values:
        link, enabled = _link(ops, p, x, inputs.supply, inputs.enable)
        return actuator.sample(ops, p, x, inputs.replace(supply=link, enable=enabled))

    def ahead(ops: Ops, p: Any, x: Record, u: PlantInputs, h: Value) -> Value:
        """Return the mean power [W] of motor and inverter over the next `h` [s]; back-EMF and drive integral are held.

        If the drive's equations do not step the motor, return the present power.
        """
        voltage, current = electrical(ops, p, x, u)
        if not stepped:
            return _mean_power(ops, p, (voltage, current), (voltage, current), 0.0)
        built = actuator.plant_parameters(ops, p)
        mode = electrical_mode(ops, built, x, u, h)
        final = (mode.source - drive.back_emf(built, x.motor_speed)) / mode.loop
        reached = final + (current - final) * ops.exp(-h / mode.tau)
        change = ops.where(u.enabled, reached - current, 0.0)
        falls = (mode.loop - built.motor.resistance) * change  # a closed loop lowers the voltage as the current rises
        return _mean_power(ops, p, (voltage, current), (voltage - falls, current + change), h / mode.tau)

    def step(ops: Ops, p: Any, x: Record, u: PlantInputs, h: Value) -> tuple[Values, Value]:
        link, enabled = _link(ops, p, x, u.supply, u.enabled)
        acting = u.replace(supply=link, enabled=enabled)
        load = supply.load_current(ops, p, link, ahead(ops, p, x, acting, 0.5 * h))
        trip_time = ops.where(enabled, supply.trip_time(ops, p, link, u.supply, load, h), h)
        trips, h = trip_time < h, ops.maximum(trip_time, PROGRESS * h)
        middle, _ = supply.moved(ops, p, link, u.supply, load, 0.5 * h)
        acting = acting.replace(supply=middle)
        moved, used = actuator.step(ops, p, x, acting, h)

        start, end = electrical(ops, p, x, acting), electrical(ops, p, x.replace(**moved), acting)
        ratio = 0.0
        if stepped:
            built = actuator.plant_parameters(ops, p)
            ratio = used / time_constant(ops, built, x, acting, h)
            if built.structure.inverter:
                end = _at_end(ops, built, x, acting, start[1], end)
        power = _mean_power(ops, p, start, end, ratio)
        link, charge = supply.moved(ops, p, link, u.supply, supply.load_current(ops, p, middle, power), used)
        tripped = ops.either(ops.both(trips, used >= h), supply.tripped(ops, p, link, x.supply_tripped))
        return {**moved, "link_voltage": link, "supply_tripped": ops.where(tripped, 1.0, 0.0),
                "supply_charge": x.supply_charge + charge}, used

    def output_values(ops: Ops, p: Any, x: Record, u: PlantInputs) -> Values:
        link, enabled = _link(ops, p, x, u.supply, u.enabled)
        shown = actuator.output_values(ops, p, x, u.replace(supply=link, enabled=enabled))
        return {**shown, "supply_power": u.supply * supply.source_current(ops, p, link, u.supply),
                "link_voltage": link, "brake_power": supply.brake_power(ops, p, link),
                "inverter_loss": supply.inverter_loss(ops, p, shown["motor_current"]),
                "supply_tripped": supply.tripped(ops, p, link, x.supply_tripped),
                STATUS.name: ops.where(enabled, shown.get(STATUS.name, OPERATIONAL), DISABLED)}

    def longest_tick(ops: Ops, p: Any) -> Value:
        resolved = _PHASE * ops.sqrt(p.motor.inductance * p.supply.capacitance)
        return ops.minimum(actuator.longest_tick(ops, p), resolved)

    line = actuator.supply
    assert line is not None  # VOLTAGE_LIMIT
    return replace(
        actuator, states=(*actuator.states, *STATES),
        controllers_read=also_read(actuator, "link_voltage", "supply_tripped", "supply"), initial=initial,
        sample=sample, step=step, output_values=output_values,
        longest_tick=longest_tick, tick_remedy=f"{actuator.tick_remedy}, or raise supply.capacitance",
        supply=replace(line, power=SUPPLY_POWER, inverse_inductance=_inverse_inductance, course=_course),
        outputs=fin_port.described({SUPPLY_POWER.name: SUPPLY_POWER.description}, actuator.outputs),
        descriptions={**actuator.descriptions, line.input.name: "voltage of the source that feeds the DC link"})


def _at_end(ops: Ops, q: Any, x: Record, u: PlantInputs, start: Value, end: tuple[Value, Value]) -> tuple[Value, Value]:
    """Return motor voltage [V] and current [A] at the `end` of a step that begins with the current `start` [A].

    If the current through the diodes of an open bridge ends there, the voltage is still that of the diodes.
    """
    def through() -> tuple[Value, ...]:
        against = -ops.sign(start) * inverter.diodes(ops, q, u.supply, x.motor_speed).voltage
        return (ops.where(ops.both(ops.equal(end[1], 0.0), ops.negate(ops.equal(start, 0.0))), against, end[0]),)

    (voltage,) = ops.branch(u.enabled, lambda: (end[0],), through)
    return voltage, end[1]


def _mean_power(ops: Ops, p: Any, start: tuple[Value, Value], end: tuple[Value, Value], ratio: Value) -> Value:
    """Return the mean power [W] of motor and inverter over a step, from motor voltage [V] and current [A] at its ends.

    Both follow an exponential; `ratio` is the step over the time constant, 0 for a line.
    """
    (_, first), (_, last) = start, end
    magnitude, _ = step_means.shares(ops, ratio)
    magnitude = ops.fabs(first) + (ops.fabs(last) - ops.fabs(first)) * magnitude
    return (step_means.mean_product(ops, start, end, ratio) + p.supply.device_voltage * magnitude
            + p.supply.device_resistance * step_means.mean_square(ops, first, last, ratio))


@rule("supply.recovery_voltage = %.6g V must not be below supply.trip_voltage = %.6g V")
def _hysteresis(ops: Ops, p: Any, _: Value) -> tuple[Value, ...]:
    trip, recovery = p.supply.trip_voltage, p.supply.recovery_voltage
    return when(ops, recovery < trip), recovery, trip


EXTENSION = Extension(
    "supply", "source, DC link and brake chopper, inverter losses and under-voltage trip", extend,
    needs=(capabilities.VOLTAGE_LIMIT, capabilities.RETURNS_POWER),
    parameters=lambda actuator: PARAMETERS, outputs=(STATUS, *OUTPUTS), rules=lambda actuator: (_hysteresis,))
