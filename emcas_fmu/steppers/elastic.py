"""One step of rotor and fin with an elastic drive line between them (:mod:`emcas_fmu.physics.drive_line`).

Rotor and fin make one implicit midpoint step under the line's torque at mid-step. The rule conserves the energy of an
undamped line, however stiff. Dry friction on both sides is solved together with the motions: a body at rest that
friction holds stays exactly there. The current follows its exponential for the back-EMF at the mean speed.

The equations are smooth while all event margins are above 0: the gap ahead of a flank or the pressure on it, both
speeds, the distances to the fin's stops, and the distance of the drive's demand from its voltage limit. The step ends
at the first event (:func:`emcas_fmu.steppers.events.first_event`), and the caller continues from there.
"""

from __future__ import annotations

from functools import reduce
from typing import Any, NamedTuple

from ..namespace import Record
from ..ops.base import Ops, Value
from ..physics import drive, drive_line, friction, loads, mechanics, screw
from ..physics.stick import WALL
from .electrical import ElectricalMode, electrical_mode, reserve, resolved_step, switched
from .events import PROGRESS, Values, first_event
from .rigid import friction_speed, integral_end, stops

# A flank separates no earlier than this share of the step after its start: in less time, a slow motion may be smaller
# than the rounding of its angle. Until then the flank pulls, which removes energy.
_LEAVING = 1e-3
_LEAST_LOCKING = 1e-12  # smallest value of -e, so that the step of a screw that does not lock is hardly limited


class Pair(NamedTuple):
    """The states: angle [rad] and speed [rad/s] of the rotor, motor current [A], drive integral [V], and angle [rad]
    and speed [rad/s] of the fin, referred to the motor."""

    motor_angle: Value
    motor_speed: Value
    motor_current: Value
    drive_integral: Value
    fin_side_angle: Value
    fin_side_speed: Value


class _Mode(NamedTuple):
    """The mode of a step: whether a flank presses, from which deflection [rad] it presses, and the electrical mode."""

    pressed: Value
    flank: Value
    drive: Any


class _Electric(NamedTuple):
    """Coefficients of the current in a step: its mean is at_rest - slope w [A] at a mean speed w [rad/s]; `kept` and
    `decay` are the weights [-] of the starting current in the mean current and in the current at the end."""

    at_rest: Value
    slope: Value
    kept: Value
    decay: Value


def _ideal(p: Any) -> bool:
    """Return whether the current loop is ideal."""
    return bool(p.structure.current == "ideal")


def _electric(ops: Ops, p: Any, s: Pair, d: Any, h: Value) -> _Electric:
    if _ideal(p):
        return _Electric(ops.where(d.enabled, d.i_ref, 0.0), 0.0, 0.0, 0.0)

    def flowing() -> tuple[Value, ...]:
        decay = ops.exp(-h / d.tau)
        kept = d.tau / h * (1.0 - decay)  # share of the starting current in the mean
        half = 0.5 * h * d.integral_gain
        share = (1.0 - kept) / (d.loop + half * (1.0 - kept))
        at_rest = kept * s.motor_current + share * (d.source + half * (d.i_ref - kept * s.motor_current))
        return at_rest, drive.back_emf(p, share), kept, decay

    return _Electric(*ops.branch(d.enabled, flowing, lambda: (0.0, 0.0, 0.0, 0.0)))


def _electric_end(ops: Ops, p: Any, s: Pair, d: Any, e: _Electric, speed: Value, h: Value) -> tuple[Value, Value]:
    mean = e.at_rest - e.slope * speed
    if _ideal(p):
        return e.at_rest, 0.0
    final = (mean - e.kept * s.motor_current) / (1.0 - e.kept)
    current = ops.where(d.enabled, final + (s.motor_current - final) * e.decay, 0.0)
    return current, integral_end(ops, p, s, d, mean, current, 2.0 * speed - s.motor_speed, h)


def _net_torque(ops: Ops, torque: Value, high: Value, low: Value) -> tuple[Value, Value]:
    """Return the net torque [N.m] beyond stiction between `low` and `high`, and its direction."""
    net = ops.where(torque > high, torque - high, ops.where(torque < low, torque - low, 0.0))
    return net, ops.where(torque > high, 1.0, ops.where(torque < low, -1.0, 0.0))


def _state_after(ops: Ops, p: Any, c: drive_line.DriveLine, s: Pair, acting: Record, mode: _Mode, h: Value,
                 at: Value | None = None) -> Pair:
    """Return the state after `h` [s] if the mode holds.

    With the mean speeds W of the rotor and U of the fin, the midpoint rules are

        (2 J/h + b + K_t K_e' + k) W - k U = r_1 - friction        (2 J_f/h + b_f + k) U - k W = r_2 - friction

    where k = h K/2 + D. K and D are the line's stiffness and damping, J, b and J_f, b_f inertia and damping of rotor
    and fin, K_e' [A.s/rad] is the fall of the mean current with W, and r_1, r_2 are the known torques. The matrix is
    symmetric. The solution under friction minimises a strictly convex function and is therefore unique. Friction that
    falls with speed is evaluated at a rotor speed `at` [rad/s], by default the mid-step speed of a first solution.
    """
    if at is None:
        at = friction_speed(ops, p, s, lambda: 0.5 * (
            s.motor_speed + _state_after(ops, p, c, s, acting, mode, h, s.motor_speed).motor_speed))
    if not screw.lossy(p):
        return _solution(ops, p, c, s, acting, mode, h, at)[0]
    # The load L on the screw grows with W, whatever the friction at the fin. For either value of e the left side of the
    # rotor's row also grows with W while 2 J/h + b + K_t K_e' + e k > 0: the sign of L is then the same with both
    # values. A screw that locks, e < 0, needs steps that are short enough (:func:`longest_step`).
    # If `at` is against the motor's direction, the efficiencies are those at rest.
    along = ops.where(at * s.motor_speed < 0.0, 0.0, at) if screw.falls(p) else at
    (driving, load, direction), (driven, _, _) = (
        _solution(ops, p, c, s, acting, mode, h, at, e(ops, p, along)) for e in (screw.forward, screw.backward))
    forward = load * direction > 0.0
    return Pair(*(ops.where(forward, x, y) for x, y in zip(driving, driven, strict=True)))


def longest_step(ops: Ops, p: Any, c: drive_line.DriveLine, most: float) -> Value:
    """Return the longest step [s] in which the acceleration of a screw that locks, e < 0, is unique."""
    # -e k, with k = h K/2 + D, is at most the share `most` of 2 J/h, which is also enough for a fin at rest.
    locking = ops.maximum(-screw.backward(ops, p), _LEAST_LOCKING)
    inertia = most * screw.rotor_inertia(p)
    damped = 0.5 * locking * c.damping
    return 2.0 * inertia / (damped + ops.sqrt(damped * damped + locking * c.stiffness * inertia))


def _solution(ops: Ops, p: Any, c: drive_line.DriveLine, s: Pair, acting: Record, mode: _Mode, h: Value, at: Value,
              felt: Value | None = None) -> tuple[Pair, Value, Value]:
    """Return the end of :func:`_state_after`, the load on the screw [N.m] and the rotor's direction (-1, 0, 1).

    If the load acts on the rotor with a factor e (`felt`), the rotor's row of the equations is

        (2 J/h + b + K_t K_e' + e k) W - e k U = r_1 - friction        J = J_r + e J_n, J_n of the nut
    """
    def at_rotor(x: Value) -> Value:
        return x if felt is None else felt * x

    def body_force() -> Value:
        return p.screw.lead * loads.nut_force(ops, p, acting)

    m = drive_line.fin_side(ops, p, s.fin_side_angle + 0.5 * h * s.fin_side_speed, acting)
    e = _electric(ops, p, s, mode.drive, h)
    driving = drive.torque(p, e.at_rest) + mechanics.rotor_torque(p, acting)
    k = ops.where(mode.pressed, 0.5 * h * c.stiffness + c.damping, 0.0)
    spring = ops.where(mode.pressed, c.stiffness * (s.motor_angle - s.fin_side_angle - mode.flank), 0.0)
    inertia = mechanics.screw_inertia(p)
    if felt is not None:
        inertia = inertia + (felt - 1.0) * screw.nut_inertia(p)
    rotor, fin = 2.0 * inertia / h, 2.0 * m.inertia / h
    # The centrifugal term is linearised about the speed u at the start: u^2 becomes 2 u U - u^2.
    swing = m.centrifugal * s.fin_side_speed
    alone_2 = fin + mechanics.hinge_damping(p, m) - 2.0 * swing
    r_1 = (rotor * s.motor_speed + driving + at_rotor(body_force())) - at_rotor(spring)
    r_2 = (fin - swing) * s.fin_side_speed + m.load + spring

    low_stop, high_stop = stops(ops, p)
    hinge = mechanics.hinge_dry(p, m)
    high = ops.where(s.fin_side_angle >= high_stop, WALL, hinge)
    low = -ops.where(s.fin_side_angle <= low_stop, WALL, hinge)
    up, down = friction.coulomb(ops, p, 1.0, m.fin), -friction.coulomb(ops, p, -1.0, m.fin)
    fin_rests, rotor_rests = ops.equal(s.fin_side_speed, 0.0), ops.equal(s.motor_speed, 0.0)
    sliding = ops.where(s.fin_side_speed > 0.0, hinge, -hinge)

    # The fin's mean speed while the rotor rests, and the direction in which the torque then starts the rotor.
    free, _ = _net_torque(ops, r_2, high, low)
    fin_alone = ops.where(fin_rests, free, r_2 - sliding) / (alone_2 + k)
    if felt is None:
        _, started = _net_torque(ops, r_1 + k * fin_alone, up, down)
    else:
        resting = spring - k * fin_alone - body_force()  # the load on the screw of a rotor at rest
        _, started = _net_torque(ops, ((driving + body_force()) - spring) + k * fin_alone,
                                 up + screw.hold(ops, p, resting, 1.0), down - screw.hold(ops, p, resting, -1.0))
    direction = ops.where(rotor_rests, started, ops.where(s.motor_speed > 0.0, 1.0, -1.0))
    rotor_held = ops.equal(direction, 0.0)

    alone_1 = rotor + friction.viscous(ops, p, direction) + drive.torque(p, e.slope)
    if friction.falls(p):
        up, down = friction.coulomb(ops, p, 1.0, m.fin, at), -friction.coulomb(ops, p, -1.0, m.fin, at)
    n_1 = r_1 - ops.where(direction > 0.0, up, down)
    # The rotor's mean speed while the fin rests; a rotor at rest starts only in the direction of its torque.
    rotor_alone = n_1 / (alone_1 + at_rotor(k))
    rotor_alone = ops.where(ops.both(rotor_rests, rotor_alone * direction < 0.0), 0.0, rotor_alone)
    _, pushed = _net_torque(ops, r_2 + k * rotor_alone, high, low)
    fin_held = ops.both(fin_rests, ops.equal(pushed, 0.0))
    n_2 = r_2 - ops.where(fin_rests, ops.where(pushed > 0.0, high, low), sliding)
    # The terms with k^2 are left out: they cancel.
    determinant = alone_1 * alone_2 + k * (alone_1 + at_rotor(alone_2))
    w = ops.where(fin_held, rotor_alone, ((alone_2 + k) * n_1 + at_rotor(k) * n_2) / determinant)
    u = ops.where(fin_held, 0.0, ((alone_1 + at_rotor(k)) * n_2 + k * n_1) / determinant)
    w, u = ops.where(rotor_held, 0.0, w), ops.where(rotor_held, fin_alone, u)

    current, integral = _electric_end(ops, p, s, mode.drive, e, w, h)
    end = Pair(s.motor_angle + h * w, 2.0 * w - s.motor_speed, current, integral,
               s.fin_side_angle + h * u, 2.0 * u - s.fin_side_speed)
    if felt is None:
        return end, 0.0, direction
    return end, spring + k * (w - u) + screw.nut_inertia(p) * 2.0 * (w - s.motor_speed) / h - body_force(), direction


def _margins(ops: Ops, p: Any, c: drive_line.DriveLine, start: Pair, s: Pair, mode: _Mode) -> Values:
    """Return the event margins by name, above 0 until the mode at `start` ends."""
    deflection = s.motor_angle - s.fin_side_angle
    side = ops.where(mode.flank > 0.0, 1.0, -1.0)
    torque = drive_line.torque(c, deflection, s.motor_speed - s.fin_side_speed, mode.flank)
    pressure = side * torque - drive_line.least(c)
    low_stop, high_stop = stops(ops, p)
    voltage = 1.0 if _ideal(p) else reserve(ops, p, mode.drive, s)
    dry = mechanics.hinge_friction(p).dry > 0.0
    return {
        "contact": ops.where(c.loose, ops.where(mode.pressed, pressure, c.half_gap - deflection), 1.0),
        "other flank": ops.where(ops.either(mode.pressed, ops.negate(c.loose)), 1.0, c.half_gap + deflection),
        "rotor": ops.where(start.motor_speed > 0.0, s.motor_speed, -s.motor_speed),
        "fin": ops.where(dry, ops.where(start.fin_side_speed > 0.0, s.fin_side_speed, -s.fin_side_speed), 1.0),
        "upper stop": high_stop - s.fin_side_angle,
        "lower stop": s.fin_side_angle - low_stop,
        "voltage": voltage,
    }


def _mode(ops: Ops, p: Any, c: drive_line.DriveLine, s: Pair, acting: Record, h: Value) -> _Mode:
    """Return the mode at the start of a step of `h` [s].

    A flank that has just been met presses if the motion without its force would close the gap.
    """
    deflection = s.motor_angle - s.fin_side_angle
    pressed, flank = drive_line.pressed(ops, c, deflection, s.motor_speed - s.fin_side_speed)
    electric = electrical_mode(ops, p, s, acting, h)

    def ahead() -> tuple[Value, ...]:
        free = _state_after(ops, p, c, s, acting, _Mode(False, 0.0, electric), h)
        return ((free.motor_angle - free.fin_side_angle - flank) * flank > 0.0,)

    met = ops.both(c.loose, ops.both(pressed, ops.fabs(deflection - flank) <= drive_line.MET))
    (pressed,) = ops.branch(met, ahead, lambda: (pressed,))
    if _ideal(p):
        return _Mode(pressed, flank, electric)

    def accelerated() -> tuple[Value, ...]:
        speed = _state_after(ops, p, c, s, acting, _Mode(pressed, flank, electric), h).motor_speed
        return tuple(electrical_mode(ops, p, s, acting, h, lambda: (speed - s.motor_speed) / h))

    electric = ElectricalMode(*ops.branch(p.motor.pole_pairs > 0.0, accelerated, lambda: tuple(electric)))
    return _Mode(pressed, flank, electric)


def advance(ops: Ops, p: Any, s: Pair, acting: Record, h: Value) -> tuple[Pair, Value]:
    """Return the state after `h` [s] or at the first event in that time, and the time that has passed [s]."""
    s = s._replace(**switched(ops, s, acting.enabled))
    h = resolved_step(ops, p, s, acting, h)
    c = drive_line.line(ops, p, s.fin_side_angle + 0.5 * h * s.fin_side_speed)
    mode = _mode(ops, p, c, s, acting, h)
    whole = _state_after(ops, p, c, s, acting, mode, h)
    before, after = _margins(ops, p, c, s, s, mode), _margins(ops, p, c, s, whole, mode)

    # A margin that is 0 at the start causes no event, except at a stop towards which the fin moves.
    outward = {"upper stop": whole.fin_side_angle > s.fin_side_angle,
               "lower stop": whole.fin_side_angle < s.fin_side_angle}
    lost = {name: ops.both(after[name] <= 0.0, outward.get(name, y > 0.0)) for name, y in before.items()}

    def margins(time: Value) -> Values:
        return _margins(ops, p, c, s, _state_after(ops, p, c, s, acting, mode, time), mode)

    def to_event() -> tuple[Value, ...]:
        leaving = ops.where(mode.pressed, _LEAVING, PROGRESS)
        used, happens, *_ = first_event(ops, h, before, after, lost, margins, {"contact": leaving})
        part = _state_after(ops, p, c, s, acting, mode, used)
        upper, lower = happens["upper stop"], happens["lower stop"]
        low_stop, high_stop = stops(ops, p)
        fin_stops = ops.either(happens["fin"], ops.either(upper, lower))
        fin_angle = ops.where(upper, high_stop, ops.where(lower, low_stop, part.fin_side_angle))
        return *part._replace(motor_speed=ops.where(happens["rotor"], 0.0, part.motor_speed),
                              fin_side_angle=fin_angle, fin_side_speed=ops.where(fin_stops, 0.0, part.fin_side_speed)
                              ), used

    *state, used = ops.branch(reduce(ops.either, lost.values()), to_event, lambda: (*whole, h), rare=True)
    return Pair(*state), used
