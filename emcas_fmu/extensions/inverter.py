"""Inverter: dead time that is not compensated, and the diodes of an open bridge (:mod:`emcas_fmu.physics.inverter`).

The dead time is modelled as a lossless resistance in series with the winding, computed for the mean current of a step;
the diodes are a voltage and a resistance, computed for its mean speed. A first step predicts both means. The error is
of second order in the tick, but of first order where the current starts at zero or changes its sign under dead time.
While the bridge is open a step ends where the diodes begin to conduct and where their current ends. The linear analysis
leaves dead time out, as it leaves out dry friction.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

from ..actuators import capabilities
from ..actuators.declaration import Actuator, PlantInputs, Values
from ..namespace import Record, with_values, with_values_where
from ..ops.base import Ops, Value
from ..physics import drive, inverter, step_means, winding
from ..rules import Rule, rule, when
from ..steppers.electrical import electrical_mode
from ..steppers.events import PROGRESS
from ..variables import in_group, integer_parameter, parameter
from .declaration import Extension
from .pole_pairs import one_motor

PARAMETERS = in_group(
    "inverter",
    parameter("dead_time", "s", 0.0, 1e-3, "dead time between the switches of a phase, less what the drive "
              "compensates (0: none)", sheet="drive: dead time, less its compensation", display="us"),
    parameter("switching_frequency", "Hz", 1.0, 1e6, "switching frequency of the bridge",
              sheet="drive: switching (PWM) frequency", display="kHz"),
    integer_parameter("pole_pairs", 0, 1000, "pole pairs of the motor, for the diodes of an open bridge (0: they do "
                      "not conduct)", sheet="motor: pole pairs, half the number of poles"),
)


class _Opposing(NamedTuple):
    """A voltage [V] against the current, an added resistance [Ohm], and the lossless part of the resistance [Ohm]."""

    voltage: Value
    added: Value
    lossless: Value


def extend(actuator: Actuator) -> Actuator:
    """Return the actuator with dead time and diodes."""
    assert actuator.supply is not None  # RETURNS_POWER
    power = actuator.supply.power.name

    def conducting(ops: Ops, q: Any, x: Record, u: PlantInputs) -> Value:
        """Return the sign of the current through the diodes of an open bridge, or 0."""
        return ops.where(u.enabled, 0.0, inverter.current_side(ops, q, u.supply, x.motor_speed, x.motor_current))

    def opposing(ops: Ops, q: Any, u: PlantInputs, speed: Value, current: Value) -> _Opposing:
        """Return voltage and resistance of dead time or diodes at a motor speed [rad/s] and current [A]."""
        def dead() -> _Opposing:
            added = inverter.dead_resistance(ops, q, u.supply, current)
            return _Opposing(0.0, added, added)

        def diodes() -> _Opposing:
            through = inverter.diodes(ops, q, u.supply, speed)
            return _Opposing(through.voltage, through.resistance - q.motor.resistance,
                             through.resistance - through.loss)

        return _Opposing(*ops.branch(u.enabled, dead, diodes))

    def acting(ops: Ops, q: Any, x: Record, u: PlantInputs, side: Value, against: _Opposing) -> tuple[Any, Record, Any]:
        """Return parameters, states and inputs with the voltage and resistance `against` the current.

        Conducting diodes are computed as an enabled drive without loop. Its integral is the voltage of the diodes, and
        its supply is twice that plus 1 V, so that no limit is active, not even at 0 V.
        """
        conducts = ops.negate(ops.equal(side, 0.0))
        wound = with_values(q, {"motor.resistance": q.motor.resistance + against.added})
        return (with_values_where(ops, conducts, wound, winding.WITHOUT_LOOP),
                x.replace(drive_integral=ops.where(conducts, -side * against.voltage, x.drive_integral)),
                u.replace(enabled=ops.either(u.enabled, conducts),
                          supply=ops.where(conducts, 2.0 * against.voltage + 1.0, u.supply)))

    def step(ops: Ops, p: Any, x: Record, u: PlantInputs, h: Value) -> tuple[Values, Value]:
        q, start = actuator.plant_parameters(ops, p), x.motor_current
        side = conducting(ops, q, x, u)

        def predicted() -> tuple[Value, ...]:
            """Return the values of :class:`_Opposing` at the step's means, and the longest time of the step [s]."""
            mode = electrical_mode(ops, q, x, u, h)
            final = inverter.settled(ops, q, u.supply, mode.source - drive.back_emf(q, x.motor_speed), mode.loop)
            expected = step_means.mean(ops, start, final + (start - final) * ops.exp(-h / mode.tau), h / mode.tau)
            against = opposing(ops, q, u, x.motor_speed, expected)
            moved, used = actuator.step(ops, *acting(ops, q, x, u, side, against), h)
            speed, end = moved["motor_speed"], moved["motor_current"]
            loop = ops.where(u.enabled, mode.loop, q.motor.resistance) + against.added
            ratio = used * loop / q.motor.inductance

            time = _event(ops, q, u, (x.motor_speed, speed), (side * start, side * end), used, ratio, h)
            middle = x.motor_speed + 0.5 * (speed - x.motor_speed) * (time / used)
            mean = step_means.mean(ops, start, end, ratio)
            return (*opposing(ops, q, u, middle, mean), ops.where(u.enabled, h, time))

        acts = ops.where(u.enabled, inverter.dead_voltage(ops, q, u.supply), q.inverter.pole_pairs) > 0.0
        *against, time = ops.branch(acts, predicted, lambda: (0.0, 0.0, 0.0, h))
        moved, used = actuator.step(ops, *acting(ops, q, x, u, side, _Opposing(*against)), time)
        conducts, current = ops.negate(ops.equal(side, 0.0)), moved["motor_current"]
        ended = ops.both(conducts, side * current <= 0.0)
        return {**moved, "motor_current": ops.where(ended, 0.0, current),
                "drive_integral": ops.where(conducts, 0.0, moved["drive_integral"])}, used

    def output_values(ops: Ops, p: Any, x: Record, u: PlantInputs) -> Values:
        q = actuator.plant_parameters(ops, p)
        side, shown = conducting(ops, q, x, u), actuator.output_values(ops, p, x, u)
        against = opposing(ops, q, u, x.motor_speed, x.motor_current)
        names = ("motor_current", "motor_torque", "motor_voltage", power)

        def through_diodes() -> tuple[Value, ...]:
            electrical = actuator.output_values(ops, *acting(ops, q, x, u, side, against))
            return tuple(electrical[name] for name in names)

        current, torque, voltage, consumed = ops.branch(ops.negate(ops.equal(side, 0.0)), through_diodes,
                                                        lambda: tuple(shown[name] for name in names))
        dropped = against.lossless * current
        return {**shown, **dict(zip(names, (current, torque, voltage - dropped, consumed - dropped * current),
                                    strict=True))}

    return replace(actuator, structure=replace(actuator.structure, inverter=True), step=step,
                   output_values=output_values)


def _event(ops: Ops, q: Any, u: PlantInputs, speeds: tuple[Value, Value], currents: tuple[Value, Value], used: Value,
           ratio: Value, h: Value) -> Value:
    """Return the time [s] at which an open bridge's diodes begin to conduct or their current ends; `h` [s] if never.

    Motor speeds [rad/s] and currents [A] along the diodes' direction are those at both ends of a first step of the time
    `used` [s]; `ratio` is this time over the current's time constant.
    """
    before, after = currents
    onset = inverter.onset(ops, u.supply)
    below, beyond = (onset - ops.fabs(drive.back_emf(q, w)) for w in speeds)
    ends = ops.both(before > 0.0, after < 0.0)
    begins = ops.both(ops.equal(before, 0.0), ops.both(below >= 0.0, beyond < 0.0))
    # The current is on its exponential, the back-EMF on a line.
    gone = (1.0 - ops.exp(-ratio)) * before / ops.where(ends, before - after, 1.0)
    at_end = -(used / ratio) * ops.log(ops.where(ends, 1.0 - gone, 1.0))
    at_begin = used * below / ops.where(begins, below - beyond, 1.0)
    time = ops.where(ends, at_end, ops.where(begins, at_begin, h))
    return ops.maximum(time, PROGRESS * h)


@rule("inverter.dead_time = %.6g s must be shorter than half the period, 1/inverter.switching_frequency = %.6g s")
def _dead_period(ops: Ops, p: Any, _: Value) -> tuple[Value, ...]:
    period = 1.0 / p.inverter.switching_frequency
    return when(ops, 2.0 * p.inverter.dead_time >= period), p.inverter.dead_time, period


def _rules(actuator: Actuator) -> tuple[Rule, ...]:
    has_pairs = any(v.name == "motor.pole_pairs" for v in actuator.parameters)
    return (_dead_period, one_motor("inverter.pole_pairs", "motor.pole_pairs")) if has_pairs else (_dead_period,)


EXTENSION = Extension(
    "inverter", "dead time of the inverter and diodes of an open bridge", extend,
    needs=(capabilities.PHASES, capabilities.DRIVE_STEP, capabilities.CURRENT_LOOP, capabilities.VOLTAGE_LIMIT,
           capabilities.RETURNS_POWER),
    parameters=lambda actuator: PARAMETERS, rules=_rules,
    references=tuple(f"emcas_fmu.reference.{name}" for name in ("simulate", "worm_gear", "worm_gear_elastic")))
