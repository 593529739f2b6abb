"""The drive in a step: the equations in force, with PWM, ideal loop and open bridge.

Stepping, heat and supply of every motor use it; it does not depend on how the motor moves. A state `s` has the names of
:class:`Plant`. Actuators that step from event to event (:mod:`emcas_fmu.steppers.events`) integrate motor current and
drive integral with their other states, by :func:`rates`, :func:`reserve` and :func:`integral_end`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar

from ..namespace import Record
from ..ops.base import Ops, Value
from ..physics import drive

# The demanded voltage counts as at its limit within this share of it, since a step that ends at the limit is rounded.
_BAND = 1e-6
# A voltage limit that falls with the current acts as a resistance. Steps at such a limit are at most this share of the
# winding's time constant with that resistance, and at least this share of the longest tick.
_RESOLVED, _SHORTEST = 0.1, 0.03
_TINY = 1e-300
States = TypeVar("States", bound=tuple[Any, ...])


class Plant(NamedTuple):
    """Motor angle [rad], motor speed [rad/s], motor current [A], drive integral xi [V]."""

    motor_angle: Value
    motor_speed: Value
    motor_current: Value
    drive_integral: Value


def states(kind: type[States], x: Record) -> States:
    """Return the states of a kind of plant, such as :class:`Plant`, by the names of its fields."""
    return kind(*(getattr(x, name) for name in kind._fields))  # type: ignore[attr-defined]  # a NamedTuple


class Drive(NamedTuple):
    """The electrical mode: L di/dt = source - loop i - back-EMF, clipped on `side` (0: not)."""

    side: Value
    loop: Value
    tau: Value
    source: Value
    integral_gain: Value
    limit: Value  # at the step's start
    supply: Value
    i_ref: Value
    enabled: Value
    stays: Value  # 1 where the demand stays at the limit, its integral following
    at_limit: Value  # 1 where the step starts at the limit

    def limit_at(self, ops: Ops, p: Any, speed: Value, current: Value) -> Value:
        """Return the voltage's limit [V] at a motor speed [rad/s] and a current [A]."""
        return drive.voltage_limit(ops, p, self.supply, speed, current)


def electrical_mode(ops: Ops, p: Any, s: Any, u: Record, h: Value,
                    accelerating: Callable[[], Value] = lambda: 0.0) -> Drive:
    """Return the electrical mode at the start of a step of `h` [s]; `accelerating` returns the acceleration [rad/s2].

    A demand at the limit may leave it while it is free and return while it is clipped (with its integral held): then
    it stays there, and the integral follows the current (Filippov's sliding solution). A clipped voltage is the limit
    of mid-step, with speed and current extrapolated from the start.
    """
    if p.structure.current == "pwm":
        return _pwm_mode(ops, p, u)
    i_ref = drive.current_reference(ops, p, u.reference)
    if p.structure.current == "ideal":  # the current is its reference at once, whatever the voltage
        return Drive(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, i_ref, u.enabled, 0.0, 1.0)
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
            middle = drive.voltage_limit(ops, p, supply, s.motor_speed + 0.5 * h * accelerating(),
                                         s.motor_current + 0.5 * h * side * rise)
            return middle, p.drive.kp * rise + (middle - limit) / (0.5 * h)

        # Limit of mid-step, and the speed at which a clipped demand falls back behind the limit.
        held, back = ops.branch(p.motor.pole_pairs > 0.0, moving, lambda: (limit, p.drive.kp * rise))
        leaving = side * p.drive.ki * (i_ref - s.motor_current) > back
        stays = ops.both(at_limit, ops.both(back > 0.0, leaving))
        clipped = ops.either(ops.negate(at_limit), ops.either(back <= 0.0, stays))
        clipped_side = ops.where(clipped, side, 0.0)
        loop = ops.where(clipped, resistance, resistance + p.drive.kp)
        source = ops.where(clipped, side * held, p.drive.kp * i_ref + s.drive_integral)
        gain = ops.where(clipped, 0.0, p.drive.ki)
        return (clipped_side, loop, inductance / loop, source, gain, ops.where(stays, 1.0, 0.0),
                ops.where(at_limit, 1.0, 0.0))

    side, loop, tau, source, gain, stays, at_limit = ops.branch(inside, free, beyond)
    return Drive(side, loop, tau, source, gain, limit, supply, i_ref, u.enabled, stays, at_limit)


def _pwm_mode(ops: Ops, p: Any, u: Record) -> Drive:
    """Return the mode of a PWM amplifier: its voltage, within the supply, is constant over the step."""
    limit = ops.maximum(u.supply, 0.0)
    source = ops.clip(drive.pwm_voltage(p, u.reference), -limit, limit)
    resistance = p.motor.resistance
    return Drive(0.0, resistance, p.motor.inductance / resistance, source, 0.0, limit, limit, 0.0, u.enabled, 0.0,
                 1.0)


def switched(ops: Ops, s: Any, enabled: Value) -> dict[str, Value]:
    """Return motor current [A] and drive integral [V] by name; a disabled drive's open bridge has neither."""
    current, integral = ops.branch(enabled, lambda: (s.motor_current, s.drive_integral), lambda: (0.0, 0.0))
    return {"motor_current": current, "drive_integral": integral}


def resolved(ops: Ops, p: Any, s: Any, u: Record, h: Value) -> Value:
    """Return `h` [s], or a shorter step that resolves a voltage limit which falls steeply with the current."""
    if p.structure.current != "loop":
        return h

    def steep() -> tuple[Value, ...]:
        limit = drive.voltage_limit(ops, p, ops.maximum(u.supply, 0.0), s.motor_speed, s.motor_current)
        i_ref = drive.current_reference(ops, p, u.reference)
        clipped = ops.fabs(drive.voltage_demand(p, i_ref, s.motor_current, s.drive_integral)) >= limit * (1.0 - _BAND)
        across = drive.inductive_voltage(p, s.motor_speed, 1.0)
        falling = ops.maximum(across * across * ops.fabs(s.motor_current), _TINY)  # -dV_w/di V_w
        step = ops.maximum(_SHORTEST * p.solver.max_tick, _RESOLVED * p.motor.inductance * limit / falling)
        return (ops.where(clipped, ops.minimum(h, step), h),)

    (h,) = ops.branch(p.motor.pole_pairs > 0.0, steep, lambda: (h,))
    return h


def begun(ops: Ops, p: Any, x: Record, u: Record, h: Value) -> tuple[Record, Value]:
    """Return the states of a plant whose drive has been :func:`switched`, and a step that is :func:`resolved` [s]."""
    x = x.replace(**switched(ops, x, u.enabled))
    return x, resolved(ops, p, x, u, h)


def rates(ops: Ops, p: Any, d: Drive, s: Any) -> dict[str, Value]:
    """Return d/dt of motor current [A/s] and drive integral [V/s] by name in a mode; both are 0 for a disabled drive.

    A clipped voltage is the limit of mid-step.
    """
    free = ops.equal(d.side, 0.0)
    voltage = ops.where(free, drive.voltage_demand(p, d.i_ref, s.motor_current, s.drive_integral), d.source)
    rise = (voltage - p.motor.resistance * s.motor_current - drive.back_emf(p, s.motor_speed)) / p.motor.inductance
    gain = ops.where(ops.both(d.enabled, free), p.drive.ki, 0.0)
    return {"motor_current": ops.where(d.enabled, rise, 0.0), "drive_integral": gain * (d.i_ref - s.motor_current)}


def integral_end(ops: Ops, p: Any, d: Drive, s: Any) -> Value:
    """Return the drive integral [V] at the end `s` of a step; it keeps a demand that stays at the limit there."""
    followed = d.side * d.limit_at(ops, p, s.motor_speed, s.motor_current) - p.drive.kp * (d.i_ref - s.motor_current)
    return ops.where(d.enabled, ops.where(d.stays > 0.0, followed, s.drive_integral), 0.0)


def reserve(ops: Ops, p: Any, d: Drive, s: Any) -> Value:
    """Return the event margin [V] of the demanded voltage, which meets or leaves its limit; 1 without such an event.

    From the limit itself the mode of the start holds through the step.
    """
    demand = drive.voltage_demand(p, d.i_ref, s.motor_current, s.drive_integral)
    limit = d.limit_at(ops, p, s.motor_speed, s.motor_current)
    left = ops.where(ops.equal(d.side, 0.0), limit - ops.fabs(demand), demand * d.side - limit)
    return ops.where(ops.both(d.enabled, ops.equal(d.at_limit, 0.0)), left, 1.0)
