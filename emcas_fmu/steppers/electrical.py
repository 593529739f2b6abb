"""The electrical mode of a drive: the equations that hold in a step, with a current loop, an ideal loop or PWM.

The steppers of all motors and the extensions for heat and supply use these functions, which do not depend on how the
motor moves. A state `s` has the fields of :class:`Motor`. Actuators that step from event to event
(:mod:`emcas_fmu.steppers.events`) integrate motor current and drive integral together with their other states; they
use :func:`rates`, :func:`reserve` and :func:`integral_end`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar

from ..namespace import Record
from ..ops.base import TINY, Ops, Value
from ..physics import drive

# The demanded voltage counts as at the limit within this share of the limit: the end of a step to the limit is rounded.
_BAND = 1e-6
# A voltage limit that falls with the current acts as a resistance. A step at such a limit is at most the larger of two
# times: the first number times the winding's time constant with that resistance, and the second times the longest tick.
_RESOLVED, _SHORTEST = 0.1, 0.03
States = TypeVar("States", bound=tuple[Any, ...])


class Motor(NamedTuple):
    """The states of motor and drive: angle [rad], speed [rad/s], current [A], drive integral xi [V]."""

    motor_angle: Value
    motor_speed: Value
    motor_current: Value
    drive_integral: Value


def states(kind: type[States], x: Record) -> States:
    """Return the states in a tuple of the class `kind`, such as :class:`Motor`, whose fields are names of states."""
    return kind(*(getattr(x, name) for name in kind._fields))  # type: ignore[attr-defined]  # a NamedTuple


class ElectricalMode(NamedTuple):
    """The electrical mode of a step: L di/dt = source - loop i - back-EMF."""

    side: Value  # of the limit at which the voltage is clipped: 1 or -1; 0 if it is not clipped
    loop: Value  # resistance [Ohm] of the winding, with kp of a loop that is not clipped
    tau: Value  # time constant L/loop [s]
    source: Value  # [V]
    integral_gain: Value  # [V/(A.s)], 0 while the voltage is clipped
    limit: Value  # of the voltage at the step's start [V]; 0 with an ideal loop
    supply: Value  # [V]
    i_ref: Value  # [A]
    enabled: Value
    stays: Value  # 1 if the demand stays at the limit and the integral follows the current, else 0
    at_limit: Value  # 1 if the step starts at the limit, and with an ideal loop or PWM; else 0

    def limit_at(self, ops: Ops, p: Any, speed: Value, current: Value) -> Value:
        """Return the voltage limit [V] at a motor speed [rad/s] and a current [A]."""
        return drive.voltage_limit(ops, p, self.supply, speed, current)


def electrical_mode(ops: Ops, p: Any, s: Any, u: Record, h: Value,
                    acceleration: Callable[[], Value] = lambda: 0.0) -> ElectricalMode:
    """Return the electrical mode of a step of `h` [s] from `s`; `acceleration` returns that of the motor [rad/s2].

    A demand at the limit may rise beyond the limit while the voltage is not clipped, but fall below the limit while the
    voltage is clipped and the integral held. The demand then stays at the limit, and the integral follows the current
    (Filippov's sliding solution). A clipped voltage is the limit for speed and current extrapolated to mid-step.
    """
    if p.structure.current == "pwm":
        return _pwm_mode(ops, p, u)
    i_ref = drive.current_reference(ops, p, u.reference)
    if p.structure.current == "ideal":  # the current is its reference at once, whatever the voltage
        return ElectricalMode(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, i_ref, u.enabled, 0.0, 1.0)
    demand = drive.voltage_demand(p, i_ref, s.motor_current, s.drive_integral)
    supply = ops.maximum(u.supply, 0.0)
    limit = drive.voltage_limit(ops, p, supply, s.motor_speed, s.motor_current)
    inside = ops.fabs(demand) < limit * (1.0 - _BAND)
    resistance, inductance = p.motor.resistance, p.motor.inductance

    def free() -> tuple[Value, ...]:
        loop = resistance + p.drive.kp
        return 0.0, loop, inductance / loop, p.drive.kp * i_ref + s.drive_integral, p.drive.ki, 0.0, 0.0

    def beyond() -> tuple[Value, ...]:
        side = ops.sign(demand)
        at_limit = ops.fabs(demand) <= limit * (1.0 + _BAND)
        rise = side * (side * limit - resistance * s.motor_current - drive.back_emf(p, s.motor_speed)) / inductance

        def moving() -> tuple[Value, ...]:
            middle = drive.voltage_limit(ops, p, supply, s.motor_speed + 0.5 * h * acceleration(),
                                         s.motor_current + 0.5 * h * side * rise)
            return middle, p.drive.kp * rise + (middle - limit) / (0.5 * h)

        # The limit at mid-step [V], and the rate [V/s] at which a clipped demand falls below the limit.
        clipped_voltage, fall_rate = ops.branch(p.motor.pole_pairs > 0.0, moving, lambda: (limit, p.drive.kp * rise))
        leaving = side * p.drive.ki * (i_ref - s.motor_current) > fall_rate
        stays = ops.both(at_limit, ops.both(fall_rate > 0.0, leaving))
        clipped = ops.either(ops.negate(at_limit), ops.either(fall_rate <= 0.0, stays))
        clipped_side = ops.where(clipped, side, 0.0)
        loop = ops.where(clipped, resistance, resistance + p.drive.kp)
        source = ops.where(clipped, side * clipped_voltage, p.drive.kp * i_ref + s.drive_integral)
        gain = ops.where(clipped, 0.0, p.drive.ki)
        return (clipped_side, loop, inductance / loop, source, gain, ops.where(stays, 1.0, 0.0),
                ops.where(at_limit, 1.0, 0.0))

    side, loop, tau, source, gain, stays, at_limit = ops.branch(inside, free, beyond)
    return ElectricalMode(side, loop, tau, source, gain, limit, supply, i_ref, u.enabled, stays, at_limit)


def _pwm_mode(ops: Ops, p: Any, u: Record) -> ElectricalMode:
    """Return the mode of a PWM amplifier, whose voltage is limited to the supply and constant over the step."""
    limit = ops.maximum(u.supply, 0.0)
    source = ops.clip(drive.pwm_voltage(p, u.reference), -limit, limit)
    resistance = p.motor.resistance
    return ElectricalMode(0.0, resistance, p.motor.inductance / resistance, source, 0.0, limit, limit, 0.0, u.enabled,
                          0.0, 1.0)


def switched(ops: Ops, s: Any, enabled: Value) -> dict[str, Value]:
    """Return motor current [A] and drive integral [V] by name; both are 0 in a disabled drive, whose bridge is open."""
    current, integral = ops.branch(enabled, lambda: (s.motor_current, s.drive_integral), lambda: (0.0, 0.0))
    return {"motor_current": current, "drive_integral": integral}


def resolved_step(ops: Ops, p: Any, s: Any, u: Record, h: Value) -> Value:
    """Return `h` [s], or a shorter step if the voltage is clipped at a limit that falls steeply with the current."""
    if p.structure.current != "loop":
        return h

    def steep() -> tuple[Value, ...]:
        limit = drive.voltage_limit(ops, p, ops.maximum(u.supply, 0.0), s.motor_speed, s.motor_current)
        i_ref = drive.current_reference(ops, p, u.reference)
        clipped = ops.fabs(drive.voltage_demand(p, i_ref, s.motor_current, s.drive_integral)) >= limit * (1.0 - _BAND)
        across = drive.inductive_voltage(p, s.motor_speed, 1.0)
        falling = ops.maximum(across * across * ops.fabs(s.motor_current), TINY)  # product -V_w dV_w/di
        step = ops.maximum(_SHORTEST * p.solver.max_tick, _RESOLVED * p.motor.inductance * limit / falling)
        return (ops.where(clipped, ops.minimum(h, step), h),)

    return ops.branch(p.motor.pole_pairs > 0.0, steep, lambda: (h,))[0]


def begun(ops: Ops, p: Any, x: Record, u: Record, h: Value) -> tuple[Record, Value]:
    """Return the states after :func:`switched`, and the time step [s] from :func:`resolved_step`."""
    x = x.replace(**switched(ops, x, u.enabled))
    return x, resolved_step(ops, p, x, u, h)


def rates(ops: Ops, p: Any, d: ElectricalMode, s: Any) -> dict[str, Value]:
    """Return d/dt of motor current [A/s] and drive integral [V/s] by name in a mode; both are 0 in a disabled drive."""
    free = ops.equal(d.side, 0.0)
    voltage = ops.where(free, drive.voltage_demand(p, d.i_ref, s.motor_current, s.drive_integral), d.source)
    rise = (voltage - p.motor.resistance * s.motor_current - drive.back_emf(p, s.motor_speed)) / p.motor.inductance
    gain = ops.where(ops.both(d.enabled, free), p.drive.ki, 0.0)
    return {"motor_current": ops.where(d.enabled, rise, 0.0), "drive_integral": gain * (d.i_ref - s.motor_current)}


def integral_end(ops: Ops, p: Any, d: ElectricalMode, s: Any) -> Value:
    """Return the drive integral [V] at the end `s` of a step; a demand that stays at the limit then is the limit."""
    at_limit = d.side * d.limit_at(ops, p, s.motor_speed, s.motor_current) - p.drive.kp * (d.i_ref - s.motor_current)
    return ops.where(d.enabled, ops.where(d.stays > 0.0, at_limit, s.drive_integral), 0.0)


def reserve(ops: Ops, p: Any, d: ElectricalMode, s: Any) -> Value:
    """Return the event margin [V] of the demanded voltage, which is 0 where the demand meets or leaves its limit.

    It is 1 for a disabled drive, and where a step starts at the limit: the mode then holds through the step.
    """
    demand = drive.voltage_demand(p, d.i_ref, s.motor_current, s.drive_integral)
    limit = d.limit_at(ops, p, s.motor_speed, s.motor_current)
    margin = ops.where(ops.equal(d.side, 0.0), limit - ops.fabs(demand), demand * d.side - limit)
    return ops.where(ops.both(d.enabled, ops.equal(d.at_limit, 0.0)), margin, 1.0)
