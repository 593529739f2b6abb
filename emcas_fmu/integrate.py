"""One step of the plant: from a state to the end of a tick, or to the first event in it.

The motion takes an implicit midpoint step (second order) under the mean torque of
the tick. The current is stiff beside it, so it follows its exact exponential for
the back-EMF of mid-tick; both are solved together, since the mean current is
linear in the acceleration it causes.

Within a tick the equations are smooth until an event: the speed reaches zero, a
stuck motor breaks away, the drive's voltage meets or leaves its limit, or the fin
meets a stop. The step then ends at that event, placed by closed forms, and the
caller steps on through what is left of the tick.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from .ops.base import Ops, Value
from .physics import drive, kinematics, mechanics

# Dry friction counts as overcome this close to its limit, so that a step that ended at
# breakaway does not find itself stuck by a rounding error.
_EDGE = 1.0 - 1e-9
# The drive counts as saturated this far beyond its limit, for the same reason.
_OVER = 1.0 + 1e-9
# The least share of a step that is taken, so that every call moves on.
_PROGRESS = 1e-6
_WALL = 1e30  # N.m, a mechanical stop seen as friction that nothing overcomes
_TINY = 1e-300


class Plant(NamedTuple):
    """Motor angle [rad], motor speed [rad/s], motor current [A], drive integral xi [V]."""

    angle: Value
    speed: Value
    current: Value
    integral: Value


class Boundary(NamedTuple):
    """What acts on the plant through a step.

    ``reference`` [V] active in the drive, ``aero_torque`` [N.m], ``f_x`` and ``f_z``
    [m/s2] (specific force in the fin's frame), ``supply`` [V], ``enabled``.
    """

    reference: Value
    aero_torque: Value
    f_x: Value
    f_z: Value
    supply: Value
    enabled: Value


class _Motion(NamedTuple):
    """Direction (-1, 0 stuck, 1) and the mechanics along it: (inertia) dw = K_t i + torque."""

    direction: Value
    inertia: Value
    torque: Value
    high: Value  # applied torque that moves a motor at rest in the positive direction
    low: Value  # and in the negative one
    load: Value


class _Drive(NamedTuple):
    """The electrical mode: L di/dt = source - loop i - back-EMF, clipped on `side` (0: not)."""

    side: Value
    loop: Value
    tau: Value
    source: Value
    integral_gain: Value
    limit: Value
    i_ref: Value
    enabled: Value


class _Current(NamedTuple):
    """i(t) = final + (start - final) exp(-t/tau); ``mean`` over the step, ``end`` at its end.

    ``speed`` is the mean speed of a sliding motor under that current.
    """

    start: Value
    final: Value
    tau: Value
    mean: Value
    end: Value
    speed: Value


def stops(ops: Ops, p: Any) -> tuple[Value, Value]:
    """Motor angles [rad] at the lower and upper mechanical stop."""
    limit = p.fin.stop_angle
    return kinematics.motor_angle(ops, p, -limit), kinematics.motor_angle(ops, p, limit)


def _sign(ops: Ops, x: Value) -> Value:
    return ops.where(x > 0.0, 1.0, ops.where(x < 0.0, -1.0, 0.0))


def _motion(ops: Ops, p: Any, s: Plant, b: Boundary, h: Value) -> _Motion:
    m = mechanics.coefficients(ops, p, s.angle + 0.5 * h * s.speed, b.aero_torque, b.f_x, b.f_z)

    def stuck_or_starting() -> tuple[Value, ...]:
        low_stop, high_stop = stops(ops, p)
        high = ops.where(s.angle >= high_stop, _WALL, mechanics.breakaway(ops, p, m, 1.0))
        low = -ops.where(s.angle <= low_stop, _WALL, mechanics.breakaway(ops, p, m, -1.0))
        applied = drive.torque(p, s.current) + m.load
        # Strictly beyond: without friction and without torque a motor at rest stays at rest.
        up = ops.both(applied >= high * _EDGE, applied > 0.0)
        down = ops.both(applied <= low * _EDGE, applied < 0.0)
        direction = ops.where(up, 1.0, ops.where(down, -1.0, 0.0))
        friction = ops.where(up, high, ops.where(down, low, 0.0))
        return direction, friction, high, low

    def moving() -> tuple[Value, ...]:
        direction = _sign(ops, s.speed)
        return direction, direction * mechanics.breakaway(ops, p, m, direction), 0.0, 0.0

    direction, friction, high, low = ops.branch(ops.equal(s.speed, 0.0), stuck_or_starting, moving)
    w = s.speed
    damping = mechanics.damping(ops, p, m, direction)
    # Midpoint speed w + h dw/2 in the viscous and (linearised) the centrifugal term.
    inertia = m.inertia + 0.5 * h * damping - h * w * m.centrifugal
    torque = m.load - friction - damping * w + m.centrifugal * w * w
    return _Motion(direction, inertia, torque, high, low, m.load)


def _drive(ops: Ops, p: Any, s: Plant, b: Boundary) -> _Drive:
    i_ref = drive.current_reference(ops, p, b.reference)
    demand = drive.voltage_demand(p, i_ref, s.current, s.integral)
    limit = ops.maximum(b.supply, 0.0)
    side = ops.where(demand > limit * _OVER, 1.0, ops.where(demand < -limit * _OVER, -1.0, 0.0))
    closed, opened = p.motor.resistance + p.drive.kp, p.motor.resistance
    loop, tau, source, gain = ops.branch(
        ops.equal(side, 0.0),
        lambda: (closed, p.motor.inductance / closed, p.drive.kp * i_ref + s.integral, p.drive.ki),
        lambda: (opened, p.motor.inductance / opened, side * limit, 0.0),
    )
    return _Drive(side, loop, tau, source, gain, limit, i_ref, b.enabled)


def _current(ops: Ops, p: Any, s: Plant, motion: _Motion, d: _Drive, h: Value) -> _Current:
    """The current's course for the back-EMF of the step's mean speed, and that speed.

    Mean speed and mean integral are linear in the final current, which is therefore
    found without iteration. A disabled drive's bridge is open: no current.
    """
    half_step = 0.5 * h
    drift = s.speed + half_step * motion.torque / motion.inertia  # mean speed if there were no current

    def flowing() -> tuple[Value, ...]:
        decay = ops.exp(-h / d.tau)
        kept = d.tau / h * (1.0 - decay)  # share of the starting current in the mean
        gone = 1.0 - kept
        lag = d.tau * gone  # its share in the mean speed, times its torque over the inertia
        half = half_step * d.integral_gain
        gain = ops.where(ops.equal(motion.direction, 0.0), 0.0, p.motor.torque_constant / motion.inertia)
        speed_at_zero = drift + gain * lag * s.current
        speed_slope = gain * (half_step - lag)
        at_rest = d.source + half * (d.i_ref - kept * s.current) - drive.back_emf(
            p, ops.where(ops.equal(motion.direction, 0.0), 0.0, speed_at_zero))
        final = at_rest / (d.loop + half * gone + drive.back_emf(p, speed_slope))
        mean = final * gone + s.current * kept
        return final, mean, final + (s.current - final) * decay, speed_at_zero + speed_slope * final

    final, mean, end, speed = ops.branch(d.enabled, flowing, lambda: (0.0, 0.0, 0.0, drift))
    return _Current(s.current, final, d.tau, mean, end, speed)


def _time_to(ops: Ops, c: _Current, value: Value) -> Value:
    """When the current reaches a value that lies on its way."""
    rest = value - c.final
    ratio = (c.start - c.final) / ops.where(ops.fabs(rest) > _TINY, rest, _TINY)
    return c.tau * ops.log(ops.maximum(ratio, 1.0))


def _step(ops: Ops, p: Any, s: Plant, b: Boundary, h: Value) -> tuple[Plant, _Motion, _Drive, _Current]:
    """The state after h [s] if nothing but what holds at its start happens."""
    motion = _motion(ops, p, s, b, h)
    d = _drive(ops, p, s, b)
    c = _current(ops, p, s, motion, d, h)

    def sliding() -> tuple[Value, ...]:
        acceleration = (drive.torque(p, c.mean) + motion.torque) / motion.inertia
        speed = s.speed + h * acceleration
        # A start from rest that leads nowhere is none.
        starts = ops.either(ops.fabs(s.speed) > 0.0, speed * motion.direction > 0.0)
        return (ops.where(starts, s.angle + h * c.speed, s.angle),
                ops.where(starts, speed, 0.0))

    angle, speed = ops.branch(ops.equal(motion.direction, 0.0), lambda: (s.angle, 0.0), sliding)
    (integral,) = ops.branch(
        b.enabled, lambda: (s.integral + h * d.integral_gain * (d.i_ref - c.mean),), lambda: (0.0,))
    return Plant(angle, speed, c.end, integral), motion, d, c


def _voltage_event(ops: Ops, p: Any, s: Plant, end: Plant, d: _Drive, c: _Current, h: Value) -> Value:
    """When the demanded voltage crosses the limit, `h` if it does not."""
    demand = drive.voltage_demand(p, d.i_ref, end.current, end.integral)
    entering = ops.both(ops.equal(d.side, 0.0), ops.fabs(demand) > d.limit * _OVER)
    leaving = ops.both(ops.fabs(d.side) > 0.0, demand * d.side < d.limit)
    side = ops.where(entering, _sign(ops, demand), d.side)

    def crossing() -> tuple[Value, ...]:
        # With the integral of the step's start, as the mode is told; it hardly moves.
        boundary = d.i_ref - (side * d.limit - s.integral) / p.drive.kp
        return (ops.minimum(_time_to(ops, c, boundary), h),)

    crosses = ops.both(d.enabled, ops.either(entering, leaving))
    (time,) = ops.branch(crosses, crossing, lambda: (h,))
    return time


def _motion_event(ops: Ops, p: Any, s: Plant, end: Plant, motion: _Motion, c: _Current,
                  h: Value) -> tuple[Value, Value, Value]:
    """When the motion changes its character (`h` if it does not), whether it stops, and the angle it stops at."""
    low_stop, high_stop = stops(ops, p)

    def stuck() -> tuple[Value, ...]:
        constant = p.motor.torque_constant
        up = constant * end.current + motion.load > motion.high
        down = constant * end.current + motion.load < motion.low
        edge = ops.where(up, motion.high, motion.low)
        (time,) = ops.branch(ops.either(up, down),
                             lambda: (_time_to(ops, c, (edge - motion.load) / constant),), lambda: (h,))
        return time, 0.0, s.angle

    def sliding() -> tuple[Value, ...]:
        reversing = ops.both(end.speed * motion.direction <= 0.0, ops.fabs(s.speed) > 0.0)
        stop = ops.where(motion.direction > 0.0, high_stop, low_stop)
        # With the speed nearly linear in time, zero speed is where the line crosses.
        zero_time = ops.where(reversing, h * s.speed / ops.where(reversing, s.speed - end.speed + _TINY, 1.0), h)
        travel = stop - s.angle
        beyond = (end.angle - stop) * motion.direction >= 0.0

        def contact() -> tuple[Value, ...]:
            acceleration = (end.speed - s.speed) / h
            root = ops.sqrt(ops.maximum(s.speed * s.speed + 2.0 * acceleration * travel, 0.0))
            denominator = s.speed + motion.direction * root
            time = 2.0 * travel / ops.where(ops.fabs(denominator) > _TINY, denominator, _TINY)
            return (ops.clip(time, 0.0, h),)

        (stop_time,) = ops.branch(beyond, contact, lambda: (h,))
        hits = ops.both(beyond, stop_time <= zero_time)
        stopped = ops.where(ops.either(reversing, hits), 1.0, 0.0)
        return ops.minimum(zero_time, stop_time), stopped, ops.where(hits, stop, s.angle)

    time, stopped, angle = ops.branch(ops.equal(motion.direction, 0.0), stuck, sliding)
    return time, stopped, angle


def advance(ops: Ops, p: Any, s: Plant, b: Boundary, h: Value) -> tuple[Plant, Value]:
    """The state after `h` [s] or at the first event before, and the time that took [s].

    While the drive is disabled its bridge is open: no current, the integral at zero.
    """
    s = Plant(s.angle, s.speed, *ops.branch(b.enabled, lambda: (s.current, s.integral), lambda: (0.0, 0.0)))
    end, motion, d, c = _step(ops, p, s, b, h)
    voltage_time = _voltage_event(ops, p, s, end, d, c, h)
    motion_time, stopped, stop_angle = _motion_event(ops, p, s, end, motion, c, h)
    first = ops.minimum(voltage_time, motion_time)

    def at_event() -> tuple[Value, ...]:
        used = ops.maximum(first, _PROGRESS * h)
        part, *_ = _step(ops, p, s, b, used)
        stops_here = ops.both(stopped > 0.0, motion_time <= voltage_time)
        hits = ops.both(stops_here, ops.negate(ops.equal(stop_angle, s.angle)))
        return (ops.where(hits, stop_angle, part.angle), ops.where(stops_here, 0.0, part.speed),
                part.current, part.integral, used)

    angle, speed, current, integral, used = ops.branch(
        first < h, at_event, lambda: (end.angle, end.speed, end.current, end.integral, h))
    return Plant(angle, speed, current, integral), used
