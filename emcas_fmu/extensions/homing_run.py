"""A homing run, sample by sample. Positions are the encoder's, in counts (with its encoder off: of the true angle).

While it runs, the controllers see the encoder from a target that moves at homing.speed, and are asked for zero: their
own loops, with their own gains, then follow the target whatever the fin's angle is, which nobody knows yet, and
command.limit does not matter. The target's speed is fed forward through the position loop's integral, which itself
keeps only what balances loads: it is the one that goes on in closed loop, so that nothing jumps.

    seeking    towards one stop until a stall: the reference at its limit, and no motion to speak of, for stall_time
    crossing   towards the other until a stall; the way between them must be 2 stop_angle, or it failed
    returning  the offset is set so that both stops are equally far off, then to zero

A symmetric error, the give and the gap of an elastic drive line pushed against its stops, cancels out of the zero.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from ..actuators.declaration import Actuator, SampleInputs
from ..control import controllers, sensors
from ..namespace import Record, with_values
from ..ops.base import Ops, Value
from ..physics import kinematics

UNKNOWN, SEEKING, CROSSING, RETURNING, READY, FAILED = (float(i) for i in range(6))
# Of the target's way within the time of a stall: less is none. Of that time: how long the target moves on without the
# fin. Of a limit, relative: what counts as at it.
_STILL, _WAITS = 0.1, 0.25
_EDGE = 1.0 - 1e-9


class Progress(NamedTuple):
    """What samples hand on: the encoder's `offset`, the `target`, where the present way begins (`origin`), for how
    long it has stalled [s] and where that began (`mark`), and for how long it has run (`elapsed`) [s]. All but
    times in counts."""

    offset: Value
    target: Value
    origin: Value
    stalled: Value
    mark: Value
    elapsed: Value


class Sampled(NamedTuple):
    """What a sample of the controllers gave, by name, the phase after it, and what is handed on."""

    given: dict[str, Value]
    phase: Value
    progress: Progress


class _Way(NamedTuple):
    """From stop to stop: `span` [counts], the reading expected of their `middle` and of the stop sought `first`,
    counts per fin angle [1/rad], motor angle per count [rad]."""

    span: Value
    middle: Value
    first: Value
    per_angle: Value
    motor: Value


def moving(ops: Ops, phase: Value) -> Value:
    """Return whether a run is under way."""
    return ops.both(phase >= SEEKING, phase <= RETURNING)


def driven(ops: Ops, phase: Value) -> Value:
    """Return whether the drive's bridge may work."""
    return ops.both(phase >= SEEKING, phase <= READY)


def reading(ops: Ops, p: Any, angle: Value, counts: Value, offset: Value = 0.0) -> Value:
    """Return the reading [counts] of the encoder of position at the state of angle [rad] that it reads.

    `offset` is that of true angles, whole counts have theirs in them.
    """
    return ops.where(p.encoder.enabled, counts, angle / sensors.resolution(p) + offset)


def _whole(ops: Ops, p: Any, x: Value) -> Value:
    return ops.where(p.encoder.enabled, ops.floor(x), x)


def _way(ops: Ops, p: Any, actuator: Actuator) -> _Way:
    """Return what the actuator's encoder reads from stop to stop, whatever its kinematics."""
    stop = p.fin.stop_angle
    high, low = (Record(**actuator.start(ops, p, angle)) for angle in (stop, -stop))
    top, bottom = (reading(ops, p, actuator.position(ops, p, x), x.counts) for x in (high, low))
    span = top - bottom
    angle = actuator.encoder[0]
    return _Way(span, 0.5 * (top + bottom), ops.where(p.homing.positive_first, top, bottom), span / (2.0 * stop),
                (getattr(high, angle) - getattr(low, angle)) / span)


def sample(ops: Ops, p: Any, actuator: Actuator, x: Record, inputs: SampleInputs, edge: Value, phase: Value,
           progress: Progress) -> Sampled:
    """Return one sample: `edge` is whether home has risen, `phase` and `progress` are as they were.

    Outside a run it is the actuator's sample, disabled unless ready, with the encoder's offset.
    """
    running = moving(ops, phase)
    starts = ops.both(ops.both(edge, inputs.enable), ops.negate(running))
    phase = ops.where(starts, SEEKING, ops.where(ops.both(running, ops.negate(inputs.enable)), UNKNOWN, phase))
    follows = ops.both(inputs.enable, ops.equal(phase, READY))
    seen = actuator.sampled(ops, p, x, inputs.replace(enable=follows, encoder_offset=progress.offset))
    names = ("reference", "measured_fin_angle", "limited",
             *(s.name for s in (*actuator.controller_states, *actuator.sampled_states)))

    def homing() -> tuple[Value, ...]:
        run = _homing(ops, p, actuator, x, inputs, seen, starts, phase, progress)
        return *(run.given[name] for name in names), run.phase, *run.progress

    values = ops.branch(moving(ops, phase), homing, lambda: (*(seen[name] for name in names), phase, *progress))
    count = len(names)
    return Sampled(dict(zip(names, values, strict=False)), values[count], Progress(*values[count + 1:]))


def _homing(ops: Ops, p: Any, actuator: Actuator, x: Record, inputs: SampleInputs, seen: dict[str, Value],
            starts: Value, phase: Value, g: Progress) -> Sampled:
    way = _way(ops, with_values(p, actuator.nominal), actuator)
    period, limit = p.controller.sample_time, p.homing.reference_limit
    at = reading(ops, p, inputs.position, seen["counts"], g.offset)
    target, origin, mark = (ops.where(starts, at, x) for x in (g.target, g.origin, g.mark))
    stalled, elapsed = (ops.where(starts, 0.0, x) for x in (g.stalled, g.elapsed))
    seeks, crosses, returns = (ops.equal(phase, x) for x in (SEEKING, CROSSING, RETURNING))

    # The target waits while the fin does not follow: let go, the fin does not run after one that is far ahead.
    speed = p.homing.speed * way.per_angle
    first = ops.where(p.homing.positive_first, speed, -speed)
    rate = ops.where(seeks, first, ops.where(crosses, -first, ops.clip(-target / period, -speed, speed)))
    target = ops.where(stalled > _WAITS * p.homing.stall_time, target, target + rate * period)
    frame = _whole(ops, p, target)
    forward = rate * way.motor
    inputs = inputs.replace(command=0.0, encoder_offset=g.offset - frame)
    # A weight of 1: the frame moves, and the loop must not see where it stands.
    pushing = with_values(p, {"drive.reference_limit": limit, "controller.position.setpoint_weight": 1.0,
                              "controller.position.velocity_feedforward": 0.0})
    at_motor = kinematics.motor_angle(ops, actuator.equation_parameters(ops, p), seen["measured_fin_angle"])
    weighed = controllers.resting_integral(p, at_motor)
    integral = ops.where(starts, x.integral - weighed, x.integral)
    moved = actuator.sampled(ops, pushing, x.replace(integral=integral + forward), inputs)

    pressed = ops.fabs(moved["reference"]) >= limit * _EDGE
    window = _STILL * speed * p.homing.stall_time
    # A count to and fro is none either.
    window = ops.where(p.encoder.enabled, ops.maximum(window, 1.0), window)
    still = ops.both(pressed, ops.fabs(at - mark) <= window)
    back = ops.both(returns, ops.both(ops.equal(target, 0.0),
                                      ops.fabs(at) <= p.homing.return_tolerance * way.per_angle))
    lasts = ops.either(still, back)
    stalled, mark = ops.where(lasts, stalled + period, 0.0), ops.where(still, mark, at)
    stall = stalled >= p.homing.stall_time * _EDGE
    elapsed = elapsed + period

    travel, tolerance = ops.fabs(at - origin), p.homing.travel_tolerance * way.per_angle
    fits = ops.fabs(travel - way.span) <= tolerance
    lost = ops.both(ops.negate(returns), travel > way.span + tolerance)
    verify = p.homing.verify
    sets = ops.both(stall, ops.either(ops.both(seeks, ops.negate(verify)), ops.both(crosses, fits)))
    turns = ops.either(sets, ops.both(stall, seeks))
    after = ops.where(ops.negate(stall), phase, ops.where(
        sets, RETURNING, ops.where(seeks, CROSSING, ops.where(back, READY, FAILED))))
    fails = ops.either(ops.either(lost, elapsed > p.homing.timeout), ops.equal(after, FAILED))
    after = ops.where(fails, FAILED, after)

    # What is added to the offset, in whole counts; at a turn everything begins anew from there.
    wrong = ops.where(seeks, way.first - at, way.middle - 0.5 * (at + origin))
    shift = ops.where(sets, ops.where(p.encoder.enabled, ops.floor(wrong + 0.5), wrong), 0.0)
    here = at + shift
    target, origin, mark = (ops.where(turns, here, x) for x in (target, origin, mark))
    anew = ops.either(turns, fails)
    return Sampled(
        {**moved, "reference": ops.where(fails, 0.0, moved["reference"]),
         "integral": ops.where(anew, 0.0, moved["integral"] - forward),
         "velocity_integral": ops.where(anew, 0.0, moved["velocity_integral"]),
         "measured_fin_angle": seen["measured_fin_angle"]},
        after, Progress(g.offset + shift, target, origin, ops.where(turns, 0.0, stalled), mark, elapsed))
