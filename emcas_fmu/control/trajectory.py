"""Trajectory generator: a command becomes a motion that the actuator can follow.

    a   = clip(2 z W (v_d - v), +-a_max), changed by at most j_max T_s per sample   v_d = clip(s(c - r), +-v_max)
    v+  = v + T_s a        r+ = r + T_s (v + v+)/2

c is the command within its limit. While no limit acts, r follows c as a second-order system with natural frequency W
and damping z: s(e) = W e/(2 z). Beyond |e| = a_b (2 z/W)^2, s is the speed from which a deceleration of a_b = 0.8 a_max
stops the motion in time:

    s(e) = sgn(e) sqrt(2 a_b (|e| - a_b (2 z/W)^2/2))

The motion stops in time if the acceleration can change fast enough: a rule requires j_max >= 1.5 a_max W.

The feedback follows r delayed by the time until a reference acts. With a position integral or a load observer, the
motion slows down to that of the fin while the fin lags the delayed r by more than a tracking limit, for instance at a
low supply; it is never reversed. Only the share of the travel that is left is fed forward. In an overload, a position
integral beside a load observer does not wind up (:func:`integral`).
"""

from __future__ import annotations

from typing import Any, NamedTuple

from ..ops.base import Ops, Value

LONGEST_LAG = 20  # samples by which the feedback may lag the motion
_BRAKING = 0.8  # a_b/a_max; the rest is a reserve for the end of the braking
_SLOWING = 0.3  # share of its excess rate that a motion loses per sample
_SMALLEST = 1e-3  # rad/s, replaces a natural frequency of 0 (no motion) in a quotient


class Motion(NamedTuple):
    """Angle [rad] and rate [rad/s] of the fin at a sample and at the next; acceleration [rad/s2] between them."""

    angle: Value
    rate: Value
    acceleration: Value
    next_angle: Value
    next_rate: Value


class Ahead(NamedTuple):
    """The feed-forward of a motion: speed of motor [rad/s] or piston [m/s]; the value that the controllers add to their
    reference before its limit, in the unit of the reference; a flag that both are used."""

    speed: Value
    reference: Value
    active: Value = True


def added(ops: Ops, value: Value, ahead: Ahead | None, name: str) -> Value:
    """Return a value plus the `speed` or `reference` (`name`) of a feed-forward; the value itself without one."""
    return value if ahead is None else value + ops.where(ahead.active, getattr(ahead, name), 0.0)


def move(ops: Ops, p: Any, angle: Value, rate: Value, before: Value, command: Value) -> Motion:
    """Return the motion from an angle [rad] and rate [rad/s] towards a limited command [rad].

    `before` [rad/s2] is the acceleration in the previous sample time.
    """
    t, period = p.trajectory, p.controller.sample_time
    error, most, step = command - angle, t.acceleration_limit, t.jerk_limit * period
    slope = 2.0 * t.damping / ops.maximum(t.natural_frequency, _SMALLEST)
    near = _BRAKING * most * slope * slope
    distance = ops.fabs(error)
    # Used beyond `near` only; below, the root's argument is kept above 0, since the root has no finite slope at 0.
    braking = ops.sqrt(2.0 * _BRAKING * most * ops.maximum(distance - 0.5 * near, 0.25 * near))
    wanted = ops.where(distance > near, ops.where(error < 0.0, -braking, braking), error / slope)
    wanted = ops.clip(wanted, -t.rate_limit, t.rate_limit)
    acceleration = ops.clip(2.0 * t.damping * t.natural_frequency * (wanted - rate), -most, most)
    acceleration = ops.clip(acceleration, before - step, before + step)
    after = rate + period * acceleration
    return Motion(angle, rate, acceleration, angle + 0.5 * period * (rate + after), after)


def delayed(ops: Ops, samples: Value, angles: tuple[Value, ...]) -> Value:
    """Return the angle [rad] a number of `samples` ago, interpolated between `angles` of the samples, newest first."""
    total: Value = 0.0
    for k, angle in enumerate(angles):
        total = total + ops.maximum(1.0 - ops.fabs(samples - k), 0.0) * angle
    return total


def excess(ops: Ops, p: Any, motion: Motion, distance: Value) -> tuple[Value, Value]:
    """Return the part [rad] of a sample's travel that is removed, and its share of this travel [-], 0 at rest.

    The fin lags the motion by a `distance` [rad]; what is beyond the tracking limit is removed.
    """
    limit, travel = p.trajectory.tracking_limit, motion.next_angle - motion.angle
    lost = ops.clip(distance - ops.clip(distance, -limit, limit), ops.minimum(travel, 0.0), ops.maximum(travel, 0.0))
    return lost, lost / ops.where(ops.equal(travel, 0.0), 1.0, travel)


def integral(ops: Ops, p: Any, distance: Value, limited: Value, overload: Value, before: Value, after: Value
             ) -> tuple[Value, Value]:
    """Return the position integral after a sample, in its unit, and the flag `overload` after it (1 or 0).

    `before` and `after` are the integrals before and after the sample, `limited` is above 0 at a limit of speed or
    reference, `distance` [rad] is that from the fin to the motion. An overload lasts from a limit beyond the tracking
    limit until the fin is back within it. In it the integral is 0 at a limit, and otherwise grows as with an error of
    the tracking limit. This needs a load observer, which holds the load.
    """
    limit, far, at_limit = p.trajectory.tracking_limit, ops.fabs(distance), limited > 0.0
    lasts = ops.both(far > limit, ops.either(at_limit, overload > 0.0))
    part = ops.where(at_limit, 0.0, before + limit / ops.maximum(far, limit) * (after - before))
    return ops.where(lasts, part, after), ops.where(lasts, 1.0, 0.0)


def slowed(motion: Motion, lost: Value) -> Value:
    """Return the next rate [rad/s] of a motion after removal of a share `lost` [-] of a sample's travel."""
    return motion.next_rate * (1.0 - _SLOWING * lost)
