"""Trajectory generator: a command becomes a motion that the actuator can follow.

    a   = clip(2 z W (v_d - v), +-a_max), which changes by at most j_max T_s        v_d = clip(s(c - r), +-v_max)
    v+  = v + T_s a        r+ = r + T_s (v + v+)/2

c is the command within its limit. Within the limits r follows c as a system of second order with the natural frequency
W and the damping z: s(e) = W e/(2 z). Beyond |e| = a_b (2 z/W)^2 the speed s still allows braking in time with
a_b = 0.8 a_max:

    s(e) = sgn(e) sqrt(2 a_b (|e| - a_b (2 z/W)^2/2))

The braking is in time if the acceleration can end soon enough: j_max >= 1.5 a_max W, which a rule requires.

The feedback follows r delayed by the time that a reference needs to act. If the fin lags this by more than a tracking
limit, for instance at a low supply, the motion slows down to that of the fin, but is never reversed.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from ..ops.base import Ops, Value

LONGEST = 20  # samples by which the feedback may lag the motion
_BRAKING = 0.8  # a_b as a share of a_max; the rest is a reserve for the end of the braking
_SLOWING = 0.3  # share of the excess rate by which a motion that is too fast slows down in a sample
_LEAST = 1e-3  # rad/s: a natural frequency of 0 means no motion; this avoids a division by 0


class Motion(NamedTuple):
    """Angle [rad] and rate [rad/s] of the fin at a sample and at the next one, and the acceleration [rad/s2] between.
    """

    angle: Value
    rate: Value
    acceleration: Value
    next_angle: Value
    next_rate: Value


class Ahead(NamedTuple):
    """The feed-forward of a motion: the speed of motor or piston [rad/s or m/s], the value that controllers add to
    their reference before its limit, in its unit (a firmware: counts of PWM), and whether both are used."""

    speed: Value
    reference: Value
    active: Value = True


def added(ops: Ops, value: Value, ahead: Ahead | None, name: str) -> Value:
    """Return a value plus the speed or reference (`name`) that is fed forward; without a motion, the value."""
    return value if ahead is None else value + ops.where(ahead.active, getattr(ahead, name), 0.0)


def move(ops: Ops, p: Any, angle: Value, rate: Value, before: Value, command: Value) -> Motion:
    """Return the motion from an angle [rad] and rate [rad/s] towards a command [rad] within its limit.

    `before` [rad/s2] is the acceleration until now.
    """
    t, period = p.trajectory, p.controller.sample_time
    error, most, step = command - angle, t.acceleration_limit, t.jerk_limit * period
    slope = 2.0 * t.damping / ops.maximum(t.natural_frequency, _LEAST)
    near = _BRAKING * most * slope * slope
    distance = ops.fabs(error)
    # Used beyond `near` only; below, the root is kept above 0, where it has no finite slope.
    braking = ops.sqrt(2.0 * _BRAKING * most * ops.maximum(distance - 0.5 * near, 0.25 * near))
    wanted = ops.where(distance > near, ops.where(error < 0.0, -braking, braking), error / slope)
    wanted = ops.clip(wanted, -t.rate_limit, t.rate_limit)
    acceleration = ops.clip(2.0 * t.damping * t.natural_frequency * (wanted - rate), -most, most)
    acceleration = ops.clip(acceleration, before - step, before + step)
    after = rate + period * acceleration
    return Motion(angle, rate, acceleration, angle + 0.5 * period * (rate + after), after)


def delayed(ops: Ops, samples: Value, angles: tuple[Value, ...]) -> Value:
    """Return the angle [rad] a number of `samples` ago, interpolated between the present and earlier `angles`."""
    total: Value = 0.0
    for k, angle in enumerate(angles):
        total = total + ops.maximum(1.0 - ops.fabs(samples - k), 0.0) * angle
    return total


def excess(ops: Ops, p: Any, motion: Motion, distance: Value) -> tuple[Value, Value]:
    """Return the part of a sample's motion [rad] that is too much for a fin that lags by a `distance` [rad].

    The second result is its share of the sample's motion [-], 0 if the motion rests.
    """
    limit, way = p.trajectory.tracking_limit, p.controller.sample_time * motion.next_rate
    lost = ops.clip(distance - ops.clip(distance, -limit, limit), ops.minimum(way, 0.0), ops.maximum(way, 0.0))
    return lost, lost / ops.where(ops.equal(way, 0.0), 1.0, way)


def slowed(p: Any, motion: Motion, excess: Value) -> Value:
    """Return the next rate [rad/s] of a motion that is slowed down because of an excess [rad]."""
    return motion.next_rate - _SLOWING * excess / p.controller.sample_time
