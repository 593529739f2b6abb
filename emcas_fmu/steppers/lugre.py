"""One step of the plant on LuGre bristles (:mod:`emcas_fmu.extensions.lugre`), without stick.

    dz/dt = w - a z        a = sigma_0 |w|/g        torque = sigma_0 z + sigma_1 dz/dt

For the rate a frozen at a predicted mid-step speed the deflection z follows its exact exponential, and its end and
means over a step of length h are linear in the step's mean speed W:

    end = e^-x z + h f1 W     mean z = f1 z + h f2 W     mean dz/dt = f1 (W - a z)     x = a h
    f1 = (1 - e^-x)/x         f2 = (1 - f1)/x

So friction is a torque and a viscous coefficient to the midpoint step of the motion, which is solved with the current
as ever. With sigma_1 a <= 4 sigma_0 (it is below sigma_0) the step is passive whatever the prediction: the friction's
work h W (mean torque) is at least the change of sigma_0 z^2/2, for it is that of the exact z under a constant W. Of
events there are the voltage's limit and the stops; a motor pressed against a stop stays there exactly, its bristles as
they are.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from ..namespace import Record
from ..ops.base import Ops, Value
from ..physics import drive, friction, mechanics
from . import rigid
from .rigid import PROGRESS, Events, Motion, Plant, Step

_SERIES = 0.02  # x below which f2 is its series: there both forms are good to 1e-12


class Bristles(NamedTuple):
    """What bristles do over a step: mean torque = at_rest [N.m] + slope [N.m.s/rad] W, end = kept z + gain [s] W."""

    at_rest: Value
    slope: Value
    kept: Value
    gain: Value


class _Way(NamedTuple):
    """Where a step leads, and the deflection at its end [rad]."""

    step: Step
    deflection: Value


def shares(ops: Ops, x: Value) -> tuple[Value, ...]:
    """e^-x, f1 and f2 for x >= 0."""
    def series() -> tuple[Value, ...]:
        second = 0.5 * (1.0 - x / 3.0 * (1.0 - x / 4.0 * (1.0 - x / 5.0 * (1.0 - x / 6.0))))
        first = 1.0 - x * second
        return 1.0 - x * first, first, second

    def closed() -> tuple[Value, ...]:
        safe = ops.maximum(x, _SERIES)
        kept = ops.exp(-x)
        first = (1.0 - kept) / safe
        return kept, first, (1.0 - first) / safe

    return ops.branch(x < _SERIES, series, closed)


def bristles(ops: Ops, p: Any, m: mechanics.Mechanics, deflection: Value, at: Value, h: Value) -> Bristles:
    """The bristles over a step of h [s] at a motor speed `at` [rad/s] for their rate."""
    rate, damping = friction.bristles(ops, p, m.fin, m.ratio, at)
    kept, first, second = shares(ops, rate * h)
    stiffness = p.lugre.stiffness
    fallen = (1.0 - kept) / h  # a f1, with no product of large and small
    return Bristles((stiffness * first - damping * fallen) * deflection,
                    stiffness * h * second + damping * first, kept, h * first)


def _mechanics(ops: Ops, p: Any, s: Plant, u: Record, h: Value) -> mechanics.Mechanics:
    return mechanics.coefficients(ops, p, s.angle + 0.5 * h * s.speed, u.aero_torque, u.f_x, u.f_z)


def _step(ops: Ops, p: Any, s: Plant, deflection: Value, u: Record, h: Value, at: Value | None = None) -> _Way:
    """A step of a free motor with the friction of the speed `at`: that of mid-step, as a first step has it."""
    if at is None:
        at = _step(ops, p, s, deflection, u, h, s.speed).step.current.speed
    m = _mechanics(ops, p, s, u, h)
    own = bristles(ops, p, m, deflection, at, h)
    damping = mechanics.damping(ops, p, m, at) + own.slope
    w = s.speed
    # As in rigid.py: mid-step speed in what is viscous, linearised in the centrifugal term.
    inertia = m.inertia + 0.5 * h * damping - h * w * m.centrifugal
    torque = m.load - own.at_rest - damping * w + m.centrifugal * w * w
    motion = Motion(1.0, inertia, torque, 0.0, 0.0, m.load)
    d = rigid.electrical_mode(ops, p, s, u)
    c = rigid.current_course(ops, p, s, motion, d, h)
    speed = w + h * (drive.torque(p, c.mean) + torque) / inertia
    end = Plant(s.angle + h * c.speed, speed, c.end, rigid.integral_end(ops, p, s, d, c, h))
    motion = motion._replace(direction=ops.where(end.angle > s.angle, 1.0, -1.0))
    return _Way(Step(end, motion, d, c), own.kept * deflection + own.gain * c.speed)


def _free(ops: Ops, p: Any, s: Plant, deflection: Value, u: Record, h: Value, way: _Way) -> tuple[Value, ...]:
    """State and deflection at the end of a free motor's step or at the first event in it, and the time that took."""
    step = way.step
    side = step.motion.direction
    low, high = rigid.stops(ops, p)
    stop = ops.where(side > 0.0, high, low)
    stopping = (step.end.angle - stop) * side >= 0.0
    entering, leaving = rigid.voltage_events(ops, p, step.drive, step.end)

    def to_event() -> tuple[Value, ...]:
        e = Events(entering, leaving, False, False, False, stopping)
        arrival = rigid.stop_time(ops, s, step, e, stop, h)
        first = ops.minimum(rigid.voltage_time(ops, p, s, step, e, h), arrival)
        used = ops.maximum(first, PROGRESS * h)
        part = _step(ops, p, s, deflection, u, used)
        end, hits = part.step.end, ops.both(stopping, arrival <= first)
        return (ops.where(hits, stop, end.angle), ops.where(hits, 0.0, end.speed), end.current, end.integral,
                part.deflection, used)

    return ops.branch(ops.either(ops.either(entering, leaving), stopping), to_event,
                      lambda: (*step.end, way.deflection, h))


def _at_stop(ops: Ops, p: Any, s: Plant, deflection: Value, u: Record, h: Value, side: Value) -> tuple[Value, ...]:
    """The same of a motor at rest at the stop on this side."""
    m = _mechanics(ops, p, s, u, h)
    spring = p.lugre.stiffness * deflection

    def pressing(current: Value) -> Value:
        return side * (drive.torque(p, current) + m.load - spring)

    pressed = pressing(s.current) >= 0.0
    way = _step(ops, p, s, deflection, u, h)
    # A start that leads nowhere is none, as from rest in rigid.py.
    nowhere = side * (way.step.end.angle - s.angle) >= 0.0

    def held(h: Value) -> Step:
        motion = Motion(0.0, 1.0, 0.0, 0.0, 0.0, m.load)
        d = rigid.electrical_mode(ops, p, s, u)
        c = rigid.current_course(ops, p, s, motion, d, h)
        return Step(Plant(s.angle, 0.0, c.end, rigid.integral_end(ops, p, s, d, c, h)), motion, d, c)

    def stays() -> tuple[Value, ...]:
        step = held(h)
        entering, leaving = rigid.voltage_events(ops, p, step.drive, step.end)
        released = ops.both(pressed, pressing(step.end.current) < 0.0)

        def to_event() -> tuple[Value, ...]:
            e = Events(entering, leaving, False, False, False, False)
            balance = rigid.time_to(ops, step.current, (spring - m.load) / p.motor.torque_constant)
            first = ops.minimum(rigid.voltage_time(ops, p, s, step, e, h), ops.where(released, balance, h))
            used = ops.maximum(first, PROGRESS * h)
            return *held(used).end, deflection, used

        return ops.branch(ops.either(released, ops.either(entering, leaving)), to_event,
                          lambda: (*step.end, deflection, h))

    return ops.branch(ops.either(pressed, nowhere), stays, lambda: _free(ops, p, s, deflection, u, h, way))


def advance(ops: Ops, p: Any, s: Plant, deflection: Value, u: Record, h: Value) -> tuple[Plant, Value, Value]:
    """State and bristle deflection [rad] after `h` [s] or at the first event before, and the time that took [s].

    While the drive is disabled its bridge is open: no current, the integral at zero.
    """
    s = Plant(s.angle, s.speed, *ops.branch(u.enabled, lambda: (s.current, s.integral), lambda: (0.0, 0.0)))
    low, high = rigid.stops(ops, p)
    side = ops.where(s.angle >= high, 1.0, ops.where(s.angle <= low, -1.0, 0.0))
    resting = ops.both(ops.equal(s.speed, 0.0), ops.negate(ops.equal(side, 0.0)))
    *plant, deflection, used = ops.branch(
        resting, lambda: _at_stop(ops, p, s, deflection, u, h, side),
        lambda: _free(ops, p, s, deflection, u, h, _step(ops, p, s, deflection, u, h)))
    return Plant(*plant), deflection, used
