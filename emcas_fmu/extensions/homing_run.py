"""A homing run, sample by sample. Positions [counts] are encoder readings or, without encoder.enabled, true angles.

During a run the position is measured from a target that moves at homing.speed, and the command is zero. The loops, with
their normal gains, then follow the target whatever the unknown angle of the fin is, and command.limit has no effect. In
the shared loops in cascade, the target's speed is fed forward through the position loop's integral. The remainder of
this integral balances the loads and is kept after the run, so that nothing jumps. Other controllers follow the target
with their lag, and their anti-windup holds their integrals at a stop.

    seeking    towards one stop until a stall: the reference is at its limit and the fin hardly moves for stall_time
    crossing   towards the other stop until a stall; the run fails if the travel differs from 2 stop_angle
    returning  the offset is set so that both stops are at the same distance, then the fin moves to zero

Without homing.verify seeking is followed by returning, with the offset from the first stop. With both stops an error
that lengthens the travel equally on both sides, such as compliance and gap of a drive line, does not change the zero.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from ..actuators import capabilities
from ..actuators.declaration import Actuator, SampleInputs
from ..control import controllers, sensors
from ..namespace import Record, with_values
from ..ops.base import Ops, Value
from ..physics import kinematics
from ..physics.stick import EDGE

UNKNOWN, SEEKING, CROSSING, RETURNING, READY, FAILED = (float(i) for i in range(6))
_STILL = 0.1  # share of the target's motion in homing.stall_time; a fin that moves less is at rest
_WAITS = 0.25  # share of homing.stall_time for which the target still moves while the fin is at rest


class HomingStates(NamedTuple):
    """States of a run: the encoder's `offset`, the `target` and the `origin` of the phase, all in counts.

    `stalled` [s] is the time since the fin stalled, at the position `mark` [counts], or returned to zero; `elapsed` [s]
    is the time since the start of the run.
    """

    offset: Value
    target: Value
    origin: Value
    stalled: Value
    mark: Value
    elapsed: Value


HOMING_STATES = tuple(f"homing_{name}" for name in HomingStates._fields)


class _Way(NamedTuple):
    """The travel between the stops: its `span` [counts], and the readings in its `middle` and at the `first` stop.

    `per_angle` are counts per fin angle [1/rad], `motor` is the motor angle per count [rad].
    """

    span: Value
    middle: Value
    first: Value
    per_angle: Value
    motor: Value


def moving(ops: Ops, phase: Value) -> Value:
    """Return whether a run is in progress in a phase."""
    return ops.both(phase >= SEEKING, phase <= RETURNING)


def run_in_cascade(actuator: Actuator) -> bool:
    """Return whether the actuator has the shared loops in cascade; a run sets their integrals."""
    return actuator.provides.issuperset((capabilities.CASCADE, capabilities.SCREW_EQUATIONS))


def driven(ops: Ops, phase: Value) -> Value:
    """Return whether the drive's bridge may be closed in a phase."""
    return ops.both(phase >= SEEKING, phase <= READY)


def reading(ops: Ops, p: Any, angle: Value, counts: Value, offset: Value = 0.0) -> Value:
    """Return the reading [counts] of the encoder of position: its whole `counts`, which include the offset.

    With the encoder off it is the true `angle` [rad] in counts, plus the `offset`.
    """
    return ops.where(p.encoder.enabled, counts, angle / sensors.resolution(p) + offset)


def _way(ops: Ops, p: Any, actuator: Actuator) -> _Way:
    """Return the travel in the encoder's counts, for any kinematics."""
    stop = p.fin.stop_angle
    high, low = (Record(**actuator.start(ops, p, angle)) for angle in (stop, -stop))
    top, bottom = (reading(ops, p, actuator.position(ops, p, x), x.counts) for x in (high, low))
    span = top - bottom
    angle = actuator.encoder[0]
    return _Way(span, 0.5 * (top + bottom), ops.where(p.homing.positive_first, top, bottom), span / (2.0 * stop),
                (getattr(high, angle) - getattr(low, angle)) / span)


def sample(ops: Ops, p: Any, actuator: Actuator, x: Record, inputs: SampleInputs) -> dict[str, Value]:
    """Return the result of a sample by name, with the phase and HOMING_STATES.

    Outside a run it is the actuator's sample with the encoder's offset, enabled in the phase ready only.
    """
    progress = HomingStates(*(getattr(x, name) for name in HOMING_STATES))
    edge = ops.both(inputs.home, ops.negate(x.home_before))
    running = moving(ops, x.homing_phase)
    starts = ops.both(ops.both(edge, inputs.enable), ops.negate(running))
    phase = ops.where(starts, SEEKING, ops.where(
        ops.both(running, ops.negate(inputs.enable)), UNKNOWN, x.homing_phase))
    follows = ops.both(inputs.enable, ops.equal(phase, READY))
    seen = actuator.sampled(ops, p, x, inputs.replace(enable=follows, encoder_offset=progress.offset))
    plain = {**seen, **_named(phase, progress)}

    def homing() -> tuple[Value, ...]:
        run = _homing(ops, p, actuator, x, inputs, seen, starts, phase, progress)
        return tuple(run[name] for name in plain)

    return dict(zip(plain, ops.branch(moving(ops, phase), homing, lambda: tuple(plain.values())), strict=True))


def _named(phase: Value, progress: HomingStates) -> dict[str, Value]:
    return {"homing_phase": phase, **dict(zip(HOMING_STATES, progress, strict=True))}


def _homing(ops: Ops, p: Any, actuator: Actuator, x: Record, inputs: SampleInputs, seen: dict[str, Value],
            starts: Value, phase: Value, g: HomingStates) -> dict[str, Value]:
    way = _way(ops, with_values(p, actuator.nominal), actuator)
    period, limit = p.controller.sample_time, p.homing.reference_limit
    position = reading(ops, p, inputs.position, seen["counts"], g.offset)
    target, origin, mark = (ops.where(starts, position, x) for x in (g.target, g.origin, g.mark))
    stalled, elapsed = (ops.where(starts, 0.0, x) for x in (g.stalled, g.elapsed))
    seeks, crosses, returns = (ops.equal(phase, x) for x in (SEEKING, CROSSING, RETURNING))

    # The target waits while the fin is at rest: a fin that is released then has no distant target to follow.
    speed = p.homing.speed * way.per_angle
    first = ops.where(p.homing.positive_first, speed, -speed)
    rate = ops.where(seeks, first, ops.where(crosses, -first, ops.clip(-target / period, -speed, speed)))
    target = ops.where(stalled > _WAITS * p.homing.stall_time, target, target + rate * period)
    frame = ops.where(p.encoder.enabled, ops.floor(target), target)
    cascaded = run_in_cascade(actuator)
    forward = rate * way.motor if cascaded else 0.0
    inputs = inputs.replace(command=0.0, encoder_offset=g.offset - frame, ahead=None)
    # A setpoint weight of 1, since the loop must not depend on the moving origin.
    pushing = with_values(p, {"drive.reference_limit": limit, "controller.position.setpoint_weight": 1.0,
                              "controller.position.velocity_feedforward": 0.0})
    if cascaded:
        at_motor = kinematics.motor_angle(ops, actuator.equation_parameters(ops, p), seen["measured_fin_angle"])
        resting = controllers.resting_integral(p, at_motor)
        integral = ops.where(starts, x.integral - resting, x.integral)
        x = x.replace(integral=integral + forward)
    out = actuator.sampled(ops, pushing, x, inputs)

    pressed = ops.fabs(out["reference"]) >= limit * EDGE
    window = _STILL * speed * p.homing.stall_time
    # A change by one count is not motion.
    window = ops.where(p.encoder.enabled, ops.maximum(window, 1.0), window)
    still = ops.both(pressed, ops.fabs(position - mark) <= window)
    back = ops.both(returns, ops.both(ops.equal(target, 0.0),
                                      ops.fabs(position) <= p.homing.return_tolerance * way.per_angle))
    lasts = ops.either(still, back)
    stalled, mark = ops.where(lasts, stalled + period, 0.0), ops.where(still, mark, position)
    stall = stalled >= p.homing.stall_time * EDGE
    elapsed = elapsed + period

    travel, tolerance = ops.fabs(position - origin), p.homing.travel_tolerance * way.per_angle
    fits = ops.fabs(travel - way.span) <= tolerance
    lost = ops.both(ops.negate(returns), travel > way.span + tolerance)
    verify = p.homing.verify
    sets = ops.both(stall, ops.either(ops.both(seeks, ops.negate(verify)), ops.both(crosses, fits)))
    turns = ops.either(sets, ops.both(stall, seeks))
    after = ops.where(ops.negate(stall), phase, ops.where(
        sets, RETURNING, ops.where(seeks, CROSSING, ops.where(back, READY, FAILED))))
    fails = ops.either(ops.either(lost, elapsed > p.homing.timeout), ops.equal(after, FAILED))
    after = ops.where(fails, FAILED, after)

    # The offset changes by whole counts if the encoder is on; at a reversal the measurements of the phase begin again.
    error = ops.where(seeks, way.first - position, way.middle - 0.5 * (position + origin))
    shift = ops.where(sets, ops.where(p.encoder.enabled, ops.floor(error + 0.5), error), 0.0)
    here = position + shift
    target, origin, mark = (ops.where(turns, here, x) for x in (target, origin, mark))
    restarts = ops.either(turns, fails)
    now = HomingStates(g.offset + shift, target, origin, ops.where(turns, 0.0, stalled), mark, elapsed)
    after_sample = {**out, "reference": ops.where(fails, 0.0, out["reference"]),
                    "measured_fin_angle": seen["measured_fin_angle"], **_named(after, now)}
    if cascaded:
        after_sample["integral"] = ops.where(restarts, 0.0, out["integral"] - forward)
        after_sample["velocity_integral"] = ops.where(restarts, 0.0, out["velocity_integral"])
    return after_sample
