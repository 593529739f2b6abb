"""One step of a plant with a rigid drive line, to the end of a tick or to the first event in it.

The motion makes an implicit midpoint step (second order) under the step's mean torque. The current is much faster, so
it follows its exact exponential for the back-EMF at the step's mean speed. Both are solved together without iteration,
since the mean current is linear in the acceleration that it causes.

Within a tick the equations are smooth until an event: the speed reaches zero, a stuck motor breaks away, the drive's
voltage meets or leaves its limit, or the fin meets a stop. The step ends at the first event, whose time is computed
without iteration, and the caller steps through the rest of the tick.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from ..namespace import Record, with_values
from ..ops.base import TINY, Ops, Value
from ..physics import drive, friction, kinematics, mechanics, screw
from ..physics.stick import WALL, overcome
from .electrical import ElectricalMode, Motor, electrical_mode, resolved_step, switched
from .events import PROGRESS, zero_between

# If the current's time constant or the computed time to the voltage limit is below this share of the step, a secant
# corrects this time: so fast a current follows the speed, and at a limit of microvolts steps would become ever shorter.
_SETTLED = 1.0 / 16.0
# At the computed time a reversing motor is set to rest if its speed is at most this share of the speed's change in the
# whole step. After a reversal of the current the speed is larger and reaches zero later: this step has no such event.
_REMAINDER = 0.01


class MotorMechanics(NamedTuple):
    """The mechanics of a motor in a step: inertia dw/dt = K_t i + torque."""

    direction: Value  # of the motion: -1, 1, or 0 for a stuck motor
    inertia: Value  # [kg.m2], with the terms of the midpoint rule
    torque: Value  # [N.m], with friction
    high: Value  # applied torque [N.m] above which a motor at rest starts in the positive direction
    low: Value  # applied torque [N.m] below which a motor at rest starts in the negative direction
    load: Value  # external torque [N.m]
    stuck: Value = False

    @property
    def mobility(self) -> Value:
        """The acceleration per torque [1/(kg.m2)]."""
        return 1.0 / self.inertia


class Current(NamedTuple):
    """The current i(t) = final + (start - final) exp(-t/tau) [A] in a step.

    ``mean`` is its mean and ``end`` its value at the end [A]; ``tau`` is in s; ``speed`` is the mean speed [rad/s] of a
    sliding motor under this current.
    """

    start: Value
    final: Value
    tau: Value
    mean: Value
    end: Value
    speed: Value


def stops(ops: Ops, p: Any) -> tuple[Value, Value]:
    """Return the motor angles [rad] at the lower and the upper mechanical stop."""
    limit = p.fin.stop_angle
    return kinematics.motor_angle(ops, p, -limit), kinematics.motor_angle(ops, p, limit)


def _stop_ahead(ops: Ops, p: Any, direction: Value) -> Value:
    """Return the motor angle [rad] at the stop in a direction."""
    low_stop, high_stop = stops(ops, p)
    return ops.where(direction > 0.0, high_stop, low_stop)


def _motion(ops: Ops, p: Any, s: Motor, u: Record, h: Value, heading: Value | None, at: Value,
            felt: Value = 1.0) -> MotorMechanics:
    """Return the mechanics of a motor that turns in the direction `heading` (1 or -1) or is at rest (None).

    Friction is evaluated at a speed `at` [rad/s]. `felt` is the factor e [-] of the load on a screw with losses.
    """
    m = mechanics.coefficients(ops, p, s.motor_angle + 0.5 * h * s.motor_speed, u)
    direction, high, low = heading, 0.0, 0.0
    if heading is not None:
        dry = heading * mechanics.breakaway(ops, p, m, heading, at)
    else:
        low_stop, high_stop = stops(ops, p)
        high = ops.where(s.motor_angle >= high_stop, WALL, mechanics.breakaway(ops, p, m, 1.0))
        low = -ops.where(s.motor_angle <= low_stop, WALL, mechanics.breakaway(ops, p, m, -1.0))
        if screw.lossy(p):
            high, low = screw.held(ops, p, m, high, low)
        applied = drive.torque(p, s.motor_current) + m.load
        up, down = overcome(ops, applied, high, low)
        direction = ops.where(up, 1.0, ops.where(down, -1.0, 0.0))
        dry = ops.where(up, high, ops.where(down, low, 0.0))
        if friction.falls(p):
            dry = ops.where(up, mechanics.breakaway(ops, p, m, 1.0, at),
                            ops.where(down, -mechanics.breakaway(ops, p, m, -1.0, at), 0.0))
    w, load = s.motor_speed, m.load
    if screw.lossy(p):
        p, m = screw.felt(p, m, felt)
        dry = direction * mechanics.breakaway(ops, p, m, direction, at)
    damping = mechanics.damping(ops, p, m, direction)
    # The viscous and the (linearised) centrifugal term use the midpoint speed w + h/2 dw/dt.
    inertia = m.inertia + 0.5 * h * damping - h * w * m.centrifugal
    torque = m.load - dry - damping * w + m.centrifugal * w * w
    return MotorMechanics(direction, inertia, torque, high, low, load, heading is None and ops.equal(direction, 0.0))


def _through_screw(ops: Ops, p: Any, s: Motor, u: Record, d: ElectricalMode, h: Value, heading: Value | None,
                   at: Value) -> MotorMechanics:
    """Return the motion with the screw's forward efficiency if the step's mean torques drive the load, else backward.

    The sign of the load is the same with either efficiency (:mod:`emcas_fmu.physics.screw`). If `at` is against the
    heading, the efficiencies are those at rest.
    """
    along = ops.maximum(heading * at, 0.0) if heading is not None and screw.falls(p) else at
    driving = _motion(ops, p, s, u, h, heading, at, screw.forward(ops, p, along))
    driven = _motion(ops, p, s, u, h, heading, at, screw.backward(ops, p, along))
    alone = _motion(ops, p, s, u, h, heading, at, 0.0)
    torque = drive.torque(p, current_course(ops, p, s, driving, d, h).mean)
    rate = (torque + driving.torque) * driving.mobility
    forward = (torque + alone.torque - alone.inertia * rate) * driving.direction > 0.0
    return driving._replace(inertia=ops.where(forward, driving.inertia, driven.inertia),
                            torque=ops.where(forward, driving.torque, driven.torque))


def current_course(ops: Ops, p: Any, s: Motor, motion: MotorMechanics, d: ElectricalMode, h: Value) -> Current:
    """Return the current in a step for the back-EMF at the step's mean speed.

    Mean speed and mean integral are linear in the final current, so no iteration is needed. In a disabled drive the
    current is 0.
    """
    half_step = 0.5 * h
    # Torque and source are computed last. So that no slow division waits for them, divisions are in their factors only.
    drift = s.motor_speed + half_step * motion.mobility * motion.torque  # mean speed without current

    def flowing() -> tuple[Value, ...]:
        decay = ops.exp(-h / d.tau)
        start_share = d.tau / h * (1.0 - decay)  # weight of the starting current in the mean current
        final_share = 1.0 - start_share
        lag = d.tau * final_share  # weight [s] of the starting current in the mean speed, before the factor `gain`
        half = half_step * d.integral_gain
        gain = ops.where(motion.stuck, 0.0, p.motor.torque_constant * motion.mobility)
        speed_at_zero = drift + gain * lag * s.motor_current
        speed_slope = gain * (half_step - lag)
        at_rest = d.source + half * (d.i_ref - start_share * s.motor_current) - drive.back_emf(
            p, ops.where(motion.stuck, 0.0, speed_at_zero))
        final = at_rest * (1.0 / (d.loop + half * final_share + drive.back_emf(p, speed_slope)))
        mean = final * final_share + s.motor_current * start_share
        return final, mean, final + (s.motor_current - final) * decay, speed_at_zero + speed_slope * final

    final, mean, end, speed = ops.branch(d.enabled, flowing, lambda: (0.0, 0.0, 0.0, drift))
    return Current(s.motor_current, final, d.tau, mean, end, speed)


def time_to(ops: Ops, c: Current, value: Value) -> Value:
    """Return the time [s] at which the current reaches a value [A] between its start and its end."""
    rest = value - c.final
    ratio = (c.start - c.final) / ops.where(ops.fabs(rest) > TINY, rest, TINY)
    return c.tau * ops.log(ops.maximum(ratio, 1.0))


class Step(NamedTuple):
    """A step without events: the state at its end, and the mechanics, electrical mode and current in the step."""

    end: Motor
    motion: MotorMechanics
    drive: ElectricalMode
    current: Current


def _step(ops: Ops, p: Any, s: Motor, u: Record, h: Value, heading: Value | None, at: Value | None = None) -> Step:
    """Return a step with friction at a speed `at` [rad/s], by default that of :func:`friction_speed`."""
    if at is None:
        at = friction_speed(ops, p, s, lambda: _step(ops, p, s, u, h, heading, s.motor_speed).current.speed)
    motion = _motion(ops, p, s, u, h, heading, at)
    d = electrical_mode(ops, p, s, u, h, lambda: acceleration(ops, p, s, motion))
    if screw.lossy(p):
        through = _through_screw(ops, p, s, u, d, h, heading, at)
        d = electrical_mode(ops, p, s, u, h, lambda: acceleration(ops, p, s, through))
        motion = through
    c = current_course(ops, p, s, motion, d, h)

    def sliding() -> tuple[Value, ...]:
        speed = s.motor_speed + h * motion.mobility * (drive.torque(p, c.mean) + motion.torque)
        angle = s.motor_angle + h * c.speed
        if heading is not None:
            return angle, speed
        # A motor whose speed would end against its starting direction stays at rest.
        starts = speed * motion.direction > 0.0
        return ops.where(starts, angle, s.motor_angle), ops.where(starts, speed, 0.0)

    angle, speed = ops.branch(motion.stuck, lambda: (s.motor_angle, 0.0), sliding)
    return Step(Motor(angle, speed, c.end, integral_end(ops, p, s, d, c.mean, c.end, speed, h)), motion, d, c)


def friction_speed(ops: Ops, p: Any, s: Any, predicted: Callable[[], Value]) -> Value:
    """Return the motor speed [rad/s] at which friction is evaluated in a step from `s`: the mid-step speed from
    `predicted` if friction or the screw's efficiency depends on the speed; otherwise the speed at the start."""
    if friction.falls(p):
        return predicted()
    if screw.falls(p):
        return ops.branch(screw.constant(ops, p), lambda: (s.motor_speed,), lambda: (predicted(),))[0]
    return s.motor_speed


def acceleration(ops: Ops, p: Any, s: Motor, motion: MotorMechanics) -> Value:
    """Return the acceleration [rad/s2] at the start of a step."""
    return ops.where(motion.stuck, 0.0, (drive.torque(p, s.motor_current) + motion.torque) * motion.mobility)


def integral_end(ops: Ops, p: Any, s: Any, d: ElectricalMode, mean: Value, end: Value, speed: Value, h: Value) -> Value:
    """Return the drive integral [V] at the end of a step, in which the current has the `mean` [A]; `end` [A] and
    `speed` [rad/s] are current and motor speed at the end."""
    if p.structure.current == "pwm":
        return s.drive_integral

    at_limit = d.side * d.limit_at(ops, p, speed, end) - p.drive.kp * (d.i_ref - end)
    integrated = s.drive_integral + h * d.integral_gain * (d.i_ref - mean)
    return ops.where(d.enabled, ops.where(d.stays > 0.0, at_limit, integrated), 0.0)


Crossing = tuple[Value, Value]
"""Whether the demanded voltage meets its limit in a step, and whether it leaves the limit."""


class Events(NamedTuple):
    """Events in a step: the demanded voltage crosses its limit, a stuck motor breaks away (``up``, ``down``), a motor
    comes to rest (``reversing``) or meets a stop (``stopping``)."""

    crossing: Crossing
    up: Value
    down: Value
    reversing: Value
    stopping: Value


def voltage_events(ops: Ops, p: Any, d: ElectricalMode, end: Motor) -> Crossing:
    """Return whether the demanded voltage meets or leaves its limit in a step to `end`."""
    if p.structure.current == "pwm":
        return False, False
    demand = drive.voltage_demand(p, d.i_ref, end.motor_current, end.drive_integral)
    limit = d.limit_at(ops, p, end.motor_speed, end.motor_current)
    free = ops.equal(d.side, 0.0)
    # A step that starts at the limit keeps its mode. Without supply the limit is 0, which the demand of a decaying
    # current would meet in ever shorter steps.
    watched = ops.both(ops.both(d.enabled, d.supply > 0.0), ops.equal(d.at_limit, 0.0))
    entering = ops.both(watched, ops.both(free, ops.fabs(demand) > limit))
    return entering, ops.both(watched, ops.both(ops.negate(free), demand * d.side < limit))


def _events(ops: Ops, p: Any, s: Motor, step: Step, heading: Value | None) -> Events:
    end, motion, d, _ = step
    crossing = voltage_events(ops, p, d, end)
    stopping = (end.motor_angle - _stop_ahead(ops, p, motion.direction)) * motion.direction >= 0.0
    if heading is not None:
        return Events(crossing, False, False, end.motor_speed * heading <= 0.0, stopping)
    stuck = motion.stuck
    applied = drive.torque(p, end.motor_current) + motion.load
    return Events(crossing, ops.both(stuck, applied > motion.high), ops.both(stuck, applied < motion.low), False,
                  ops.both(ops.negate(stuck), stopping))


def voltage_time(ops: Ops, p: Any, s: Motor, step: Step, crossing: Crossing, h: Value, part: Callable[[Value], Step]
                 ) -> Value:
    """Return the time [s] at which the demanded voltage crosses the limit, `h` if it does not.

    `part(time)` returns a shorter step. Under the constant back-EMF of a step, a current that settles much faster than
    the step meets the limit at once. In truth such a current follows the speed and meets the limit late: the time is
    then the zero of a secant between the time computed first and the step's end.
    """
    if p.structure.current == "pwm":
        return h
    (_, _, d, c), (entering, leaving) = step, crossing
    before = drive.voltage_demand(p, d.i_ref, s.motor_current, s.drive_integral)
    after = drive.voltage_demand(p, d.i_ref, step.end.motor_current, step.end.drive_integral)
    side = ops.where(entering, ops.sign(after), d.side)
    # The time follows from the current's exponential with the integral at the step's start. If not the current but the
    # integral moves the demand to the limit, it follows from the line between the demands at start and end.
    limit = d.limit_at(ops, p, step.end.motor_speed, step.end.motor_current)
    boundary = d.i_ref - (side * limit - s.drive_integral) / p.drive.kp
    on_course = (boundary - s.motor_current) * (step.end.motor_current - boundary) >= 0.0

    def on_line(start: Value, end: Value) -> Value:
        change = ops.where(ops.equal(end, start), 1.0, end - start)
        return h * ops.clip((side * limit - start) / change, 0.0, 1.0)

    time = ops.where(on_course, ops.minimum(time_to(ops, c, boundary), h), on_line(before, after))

    def moving() -> tuple[Value, ...]:
        # The limit also moves. The time is at most the zero of the line between the reserves at start and end: a step
        # that ends before the event is correct, as the next one continues in the same mode.
        latest = on_line(before + side * (limit - d.limit), after)
        return (ops.where(on_course, ops.minimum(time, latest), latest),)

    (time,) = ops.branch(p.motor.pole_pairs > 0.0, moving, lambda: (time,))

    def reserve(end: Motor) -> Value:
        beyond = side * drive.voltage_demand(p, d.i_ref, end.motor_current, end.drive_integral) - d.limit_at(
            ops, p, end.motor_speed, end.motor_current)
        return ops.where(entering, -beyond, beyond)

    def later() -> tuple[Value, ...]:
        rest = reserve(part(ops.maximum(time, PROGRESS * h)).end)
        return (ops.where(rest > 0.0, ops.clip(zero_between(ops, time, rest, h, reserve(step.end)), time, h), time),)

    met = ops.either(entering, leaving)
    (time,) = ops.branch(ops.both(met, ops.minimum(d.tau, time) < _SETTLED * h), later, lambda: (time,))
    return ops.where(met, time, h)


def stop_time(ops: Ops, s: Motor, step: Step, stopping: Value, stop: Value, h: Value) -> Value:
    """Return the time [s] in which constant acceleration brings a motor to the stop [rad], `h` unless `stopping`."""
    travel = stop - s.motor_angle
    acceleration = (step.end.motor_speed - s.motor_speed) / h
    root = ops.sqrt(ops.maximum(s.motor_speed * s.motor_speed + 2.0 * acceleration * travel, 0.0))
    divisor = s.motor_speed + step.motion.direction * root
    time = 2.0 * travel / ops.where(ops.fabs(divisor) > TINY, divisor, TINY)
    return ops.where(stopping, ops.clip(time, 0.0, h), h)


def _to_first_event(ops: Ops, p: Any, s: Motor, u: Record, step: Step, e: Events, h: Value,
                    heading: Value | None) -> tuple[Value, ...]:
    """Return the state at the first event, and the time until then [s]."""
    stop = _stop_ahead(ops, p, step.motion.direction)
    voltage = voltage_time(ops, p, s, step, e.crossing, h, lambda time: _step(ops, p, s, u, time, heading))
    stopping = stop_time(ops, s, step, e.stopping, stop, h)
    if heading is not None:
        # The zero of the line between the speeds at start and end is corrected by a line through the speed there.
        slowing = ops.where(e.reversing, s.motor_speed - step.end.motor_speed, 1.0)
        guess = ops.where(e.reversing, h * s.motor_speed / slowing, h)

        def refined() -> tuple[Value, ...]:
            speed = _step(ops, p, s, u, ops.maximum(guess, PROGRESS * h), heading).end.motor_speed
            late = speed * heading <= 0.0
            zero = zero_between(ops, guess, speed, ops.where(late, 0.0, h),
                                ops.where(late, s.motor_speed, step.end.motor_speed))
            return (ops.clip(zero, 0.0, h),)

        (other,) = ops.branch(e.reversing, refined, lambda: (h,))
    else:
        # The event of a motor at rest: the torque exceeds the friction.
        edge = ops.where(e.up, step.motion.high, step.motion.low)
        time = time_to(ops, step.current, (edge - step.motion.load) / p.motor.torque_constant)
        other = ops.where(ops.either(e.up, e.down), time, h)
    first = ops.minimum(ops.minimum(voltage, other), stopping)
    used = ops.maximum(first, PROGRESS * h)
    part = _step(ops, p, s, u, used, heading).end
    hits = ops.both(e.stopping, stopping <= first)
    met: Value = other <= first
    if heading is not None:
        met = ops.both(met, part.motor_speed * heading <= _REMAINDER * (s.motor_speed - step.end.motor_speed) * heading)
    rests = ops.either(hits, ops.both(e.reversing, met))
    return *part._replace(motor_angle=ops.where(hits, stop, part.motor_angle),
                          motor_speed=ops.where(rests, 0.0, part.motor_speed)), used


def _step_to_event(ops: Ops, p: Any, s: Motor, u: Record, h: Value, heading: Value | None) -> tuple[Value, ...]:
    step = _step(ops, p, s, u, h, heading)
    e = _events(ops, p, s, step, heading)
    any_motion = ops.either(ops.either(e.up, e.down), ops.either(e.reversing, e.stopping))
    return ops.branch(ops.either(ops.either(*e.crossing), any_motion),
                      lambda: _to_first_event(ops, p, s, u, step, e, h, heading), lambda: (*step.end, h), rare=True)


def advance(ops: Ops, p: Any, s: Motor, u: Record, h: Value) -> tuple[Motor, Value]:
    """Return the state after `h` [s] or at the first event in that time, and the time that has passed [s]."""
    s = s._replace(**switched(ops, s, u.enabled))
    if p.structure.current != "loop":
        *plant, used = _by_direction(ops, p, s, u, h)
    else:  # two versions of the code; the second, in which the supply is the voltage limit, is short
        fixed = with_values(p, {"motor.pole_pairs": 0})
        *plant, used = ops.branch(p.motor.pole_pairs > 0.0,
                                  lambda: _by_direction(ops, p, s, u, resolved_step(ops, p, s, u, h)),
                                  lambda: _by_direction(ops, fixed, s, u, h))
    # A motor that reverses twice in a tick could pass the stop behind it.
    end = Motor(*plant)
    return end._replace(motor_angle=ops.clip(end.motor_angle, *stops(ops, p))), used


def _by_direction(ops: Ops, p: Any, s: Motor, u: Record, h: Value) -> tuple[Value, ...]:
    """Return the result of :func:`advance` for a motor that turns or is at rest."""
    return ops.branch(ops.fabs(s.motor_speed) > 0.0,
                      lambda: _step_to_event(ops, p, s, u, h, ops.where(s.motor_speed > 0.0, 1.0, -1.0)),
                      lambda: _step_to_event(ops, p, s, u, h, None))
