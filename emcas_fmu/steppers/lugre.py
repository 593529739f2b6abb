"""One step of a plant with LuGre friction (:mod:`emcas_fmu.extensions.lugre`), under which a motor never sticks.

    dz/dt = w - a z        a = sigma_0 |w|/g        torque = sigma_0 z + sigma_1 dz/dt

z [rad] is the deflection of the bristles, w [rad/s] the motor speed, g [N.m] the friction in steady sliding. The rate a
is that of a predicted mid-step speed and constant over the step h; z then follows an exact exponential. Its value at
the end and its means are linear in the step's mean speed W:

    end = e^-x z + h f1 W     mean z = f1 z + h f2 W     mean dz/dt = f1 (W - a z)     x = a h
    f1 = (1 - e^-x)/x         f2 = (1 - f1)/x

In the midpoint step of the motion, friction is thus a torque and a viscous coefficient, and motion and current are
solved together as in :mod:`emcas_fmu.steppers.rigid`. Since sigma_1 a is at most 4 sigma_0 (here it is below sigma_0),
the step is passive whatever the prediction: the work against friction, h W (mean torque), is that of the exact z under
a constant W, hence at least the change of sigma_0 z^2/2. Events are the voltage limit and the stops. A motor pressed
against a stop stays exactly there, and the deflection of the bristles is constant.
"""

from __future__ import annotations

from typing import Any

from ..namespace import Record
from ..ops.base import Ops, Value
from ..physics import drive, mechanics
from . import electrical, rigid
from .electrical import Motor
from .events import PROGRESS
from .rigid import MotorMechanics, Step

_SERIES = 0.02  # x below which f2 is computed by its series: at this x both forms are accurate to 1e-12


def shares(ops: Ops, x: Value) -> tuple[Value, ...]:
    """Return e^-x, f1 = (1 - e^-x)/x and f2 = (1 - f1)/x, all [-], for x >= 0."""
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


def _bristles(ops: Ops, p: Any, m: mechanics.Mechanics, deflection: Value, at: Value, h: Value) -> tuple[Value, ...]:
    """Return at_rest [N.m], slope [N.m.s/rad], kept [-] and gain [s] of the bristles over a step of `h` [s].

    The mean torque is at_rest + slope W, and the deflection at the end is kept z + gain W. The rate a is that of a
    motor speed `at` [rad/s].
    """
    rate, damping = mechanics.bristles(ops, p, m, at)
    kept, first, second = shares(ops, rate * h)
    stiffness = p.lugre.stiffness
    fallen = (1.0 - kept) / h  # a f1, without the product of a large and a small number
    return ((stiffness * first - damping * fallen) * deflection, stiffness * h * second + damping * first, kept,
            h * first)


def _step(ops: Ops, p: Any, s: Motor, deflection: Value, u: Record, h: Value, at: Value | None = None
          ) -> tuple[Step, Value]:
    """Return a step of a free motor and the deflection at its end [rad].

    Friction is evaluated at a speed `at` [rad/s], by default the mid-step speed of a first step.
    """
    if at is None:
        at = _step(ops, p, s, deflection, u, h, s.motor_speed)[0].current.speed
    m = mechanics.coefficients(ops, p, s.motor_angle + 0.5 * h * s.motor_speed, u)
    at_rest, slope, kept, gain = _bristles(ops, p, m, deflection, at, h)
    damping = mechanics.damping(ops, p, m, at) + slope
    w = s.motor_speed
    # As in rigid.py, the viscous and the (linearised) centrifugal term use the mid-step speed.
    inertia = m.inertia + 0.5 * h * damping - h * w * m.centrifugal
    torque = m.load - at_rest - damping * w + m.centrifugal * w * w
    motion = MotorMechanics(1.0, inertia, torque, 0.0, 0.0, m.load)
    d = electrical.electrical_mode(ops, p, s, u, h, lambda: rigid.acceleration(ops, p, s, motion))
    c = rigid.current_course(ops, p, s, motion, d, h)
    speed = w + h * (drive.torque(p, c.mean) + torque) / inertia
    end = Motor(s.motor_angle + h * c.speed, speed, c.end, rigid.integral_end(ops, p, s, d, c.mean, c.end, speed, h))
    motion = motion._replace(direction=ops.where(end.motor_angle > s.motor_angle, 1.0, -1.0))
    return Step(end, motion, d, c), kept * deflection + gain * c.speed


def _free(ops: Ops, p: Any, s: Motor, deflection: Value, u: Record, h: Value, step: Step, end_deflection: Value
          ) -> tuple[Value, ...]:
    """Return state and deflection [rad] of a free motor, and their time [s]: the first event or the end of `step`."""
    side = step.motion.direction
    low, high = rigid.stops(ops, p)
    stop = ops.where(side > 0.0, high, low)
    stopping = (step.end.motor_angle - stop) * side >= 0.0
    crossing = rigid.voltage_events(ops, p, step.drive, step.end)

    def to_event() -> tuple[Value, ...]:
        arrival = rigid.stop_time(ops, s, step, stopping, stop, h)
        voltage = rigid.voltage_time(ops, p, s, step, crossing, h, lambda time: _step(
            ops, p, s, deflection, u, time)[0])
        first = ops.minimum(voltage, arrival)
        used = ops.maximum(first, PROGRESS * h)
        part, part_deflection = _step(ops, p, s, deflection, u, used)
        end, hits = part.end, ops.both(stopping, arrival <= first)
        end = end._replace(motor_angle=ops.where(hits, stop, end.motor_angle),
                           motor_speed=ops.where(hits, 0.0, end.motor_speed))
        return *end, part_deflection, used

    return ops.branch(ops.either(ops.either(*crossing), stopping), to_event, lambda: (*step.end, end_deflection, h),
                      rare=True)


def _at_stop(ops: Ops, p: Any, s: Motor, deflection: Value, u: Record, h: Value, side: Value) -> tuple[Value, ...]:
    """Return the result of :func:`_free` for a motor at rest at the stop on a side (-1 or 1)."""
    m = mechanics.coefficients(ops, p, s.motor_angle + 0.5 * h * s.motor_speed, u)
    spring = p.lugre.stiffness * deflection

    def pressing(current: Value) -> Value:
        return side * (drive.torque(p, current) + m.load - spring)

    pressed = pressing(s.motor_current) >= 0.0
    free, free_deflection = _step(ops, p, s, deflection, u, h)
    # A motor that would start into the stop stays at rest, as in rigid.py.
    outwards = side * (free.end.motor_angle - s.motor_angle) >= 0.0

    def resting(h: Value) -> Step:
        motion = MotorMechanics(0.0, 1.0, 0.0, 0.0, 0.0, m.load, True)
        d = electrical.electrical_mode(ops, p, s, u, h)
        c = rigid.current_course(ops, p, s, motion, d, h)
        integral = rigid.integral_end(ops, p, s, d, c.mean, c.end, 0.0, h)
        return Step(Motor(s.motor_angle, 0.0, c.end, integral), motion, d, c)

    def stays() -> tuple[Value, ...]:
        step = resting(h)
        crossing = rigid.voltage_events(ops, p, step.drive, step.end)
        released = ops.both(pressed, pressing(step.end.motor_current) < 0.0)

        def to_event() -> tuple[Value, ...]:
            balance = rigid.time_to(ops, step.current, (spring - m.load) / p.motor.torque_constant)
            voltage = rigid.voltage_time(ops, p, s, step, crossing, h, resting)
            first = ops.minimum(voltage, ops.where(released, balance, h))
            used = ops.maximum(first, PROGRESS * h)
            return *resting(used).end, deflection, used

        return ops.branch(ops.either(released, ops.either(*crossing)), to_event, lambda: (*step.end, deflection, h),
                          rare=True)

    return ops.branch(ops.either(pressed, outwards), stays,
                      lambda: _free(ops, p, s, deflection, u, h, free, free_deflection))


def advance(ops: Ops, p: Any, s: Motor, deflection: Value, u: Record, h: Value) -> tuple[Motor, Value, Value]:
    """Return state and deflection [rad] after `h` [s] or at the first event, and the time that has passed [s]."""
    s = s._replace(**electrical.switched(ops, s, u.enabled))
    h = electrical.resolved_step(ops, p, s, u, h)
    low, high = rigid.stops(ops, p)
    side = ops.where(s.motor_angle >= high, 1.0, ops.where(s.motor_angle <= low, -1.0, 0.0))
    resting = ops.both(ops.equal(s.motor_speed, 0.0), ops.negate(ops.equal(side, 0.0)))
    *plant, deflection, used = ops.branch(
        resting, lambda: _at_stop(ops, p, s, deflection, u, h, side),
        lambda: _free(ops, p, s, deflection, u, h, *_step(ops, p, s, deflection, u, h)))
    return Motor(*plant), deflection, used
