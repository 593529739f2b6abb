"""Incremental encoders, section 3.2.4: whole counts, and the speed from the counts of two samples.

    n_k = floor(angle/q)    measured angle = n_k q    measured speed = (n_k - n_k-1) q/T_s
    q = 2 pi/(pulses multiplier)

The motor's encoder always measures the speed. It also measures the position, unless ``encoder.on_fin`` selects a second
encoder, with as many pulses, on the fin shaft. The zero of an incremental encoder is arbitrary: its difference from the
true zero, `offset` [counts], is added to the counts of the position.
"""

from __future__ import annotations

from math import pi
from typing import Any, NamedTuple

from ..ops.base import Ops, Value
from ..physics import kinematics


class Measurement(NamedTuple):
    """Measured motor angle [rad] and speed [rad/s], fin angle [rad], and counts [-] of the encoders.

    `counts` are those of the position encoder with its offset, `motor_counts` those of the motor's encoder. With the
    encoders off, `counts` is 0 and `motor_counts` is the value at the previous sample.
    """

    motor_angle: Value
    motor_speed: Value
    fin_angle: Value
    counts: Value
    motor_counts: Value


def resolution(p: Any) -> Value:
    """Return the angle of one count [rad]."""
    return 2.0 * pi / (p.encoder.pulses * p.encoder.multiplier)


def _shifted(value: Value, offset: Value | None, unit: Value) -> Value:
    """Return `value` plus an `offset` in counts of one `unit` each, or `value` if the offset is None."""
    return value if offset is None else value + offset * unit


def motor_counts(ops: Ops, p: Any, motor_angle: Value) -> Value:
    """Return the whole counts of the motor's encoder at a motor angle [rad]."""
    return ops.floor(motor_angle / resolution(p))


def measure(ops: Ops, p: Any, plant: Any, position: Value, motor_angle: Value, motor_speed: Value, before: Value,
            offset: Value | None = None) -> Measurement:
    """Return the measurement at true angles [rad] and a true speed [rad/s].

    `position` is the angle that the position encoder reads: the motor's or, referred to the motor, the fin's. `before`
    is the number of counts of the motor's encoder at the previous sample. `p` contains the nominal parameters, which
    the controllers use, `plant` those as built.
    """

    def true_values() -> tuple[Value, ...]:
        read = _shifted(position, offset, resolution(p))

        def of_fin() -> tuple[Value, ...]:
            return (kinematics.motor_angle(ops, p, kinematics.fin_at(ops, plant, read)),)

        (angle,) = ops.branch(ops.both(p.encoder.on_fin, kinematics.deviates(ops, p, plant)), of_fin, lambda: (read,))
        return angle, motor_speed, kinematics.fin_at(ops, p, angle), 0.0, before

    def quantised() -> tuple[Value, ...]:
        q, now = resolution(p), motor_counts(ops, p, motor_angle)
        speed = (now - before) * q / p.controller.sample_time

        def from_fin() -> tuple[Value, ...]:
            counts = _shifted(ops.floor(kinematics.fin_at(ops, plant, position) / q), offset, 1.0)
            return kinematics.motor_angle(ops, p, counts * q), counts * q, counts

        def from_motor() -> tuple[Value, ...]:
            counts = _shifted(motor_counts(ops, p, position), offset, 1.0)
            return counts * q, kinematics.fin_at(ops, p, counts * q), counts

        angle, fin, counts = ops.branch(p.encoder.on_fin, from_fin, from_motor)
        return angle, speed, fin, counts, now

    return Measurement(*ops.branch(p.encoder.enabled, quantised, true_values))
