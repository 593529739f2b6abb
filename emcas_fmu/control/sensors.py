"""Incremental encoders, section 3.2.4: whole counts, speed from the difference of two samples.

    n_k = floor(angle/q)    measured angle = n_k q    measured speed = (n_k - n_k-1) q/T_s
    q = 2 pi/(pulses multiplier)

An incremental encoder knows no zero of its own: `offset` are counts added to those from the true zero, None where
its zero is the true one.
"""

from __future__ import annotations

from math import pi
from typing import Any, NamedTuple

from ..ops.base import Ops, Value
from ..physics import kinematics


class Measurement(NamedTuple):
    """What the controllers see: motor angle [rad] and speed [rad/s], fin angle [rad], encoder counts [-]."""

    motor_angle: Value
    motor_speed: Value
    fin_angle: Value
    counts: Value


def resolution(p: Any) -> Value:
    """Return angle of one count [rad]."""
    return 2.0 * pi / (p.encoder.pulses * p.encoder.multiplier)


def _shifted(value: Value, offset: Value | None, unit: Value) -> Value:
    """Return `value` with an offset whose counts are of `unit`."""
    return value if offset is None else value + offset * unit


def counts(ops: Ops, p: Any, motor_angle: Value, offset: Value | None = None) -> Value:
    """Return whole counts at a motor angle [rad], of the encoder on the motor or on the fin, of the unit as built."""
    (angle,) = ops.branch(
        p.encoder.on_fin,
        lambda: (kinematics.fin_angle(ops, p, kinematics.lever_tangent(ops, p, motor_angle)),),
        lambda: (motor_angle,),
    )
    return _shifted(ops.floor(angle / resolution(p)), offset, 1.0)


def measure(ops: Ops, p: Any, plant: Any, motor_angle: Value, motor_speed: Value, previous_counts: Value,
            offset: Value | None = None) -> Measurement:
    """Return a sample of true angle [rad] and speed [rad/s]; `previous_counts` are those of the sample before.

    `p` are the parameters that the controllers know, `plant` those of the unit as built.
    """

    def true_values() -> tuple[Value, ...]:
        seen = _shifted(motor_angle, offset, resolution(p))
        fin = kinematics.fin_angle(ops, p, kinematics.lever_tangent(ops, p, seen))
        return seen, motor_speed, fin, previous_counts

    def quantised() -> tuple[Value, ...]:
        q = resolution(p)
        now = counts(ops, plant, motor_angle, offset)
        angle, rate = now * q, (now - previous_counts) * q / p.controller.sample_time

        def from_fin() -> tuple[Value, ...]:
            ratio = kinematics.reduction_ratio(ops, p, ops.tan(angle + p.kinematics.initial_angle))
            return kinematics.motor_angle(ops, p, angle), ratio * rate, angle, now

        def from_motor() -> tuple[Value, ...]:
            fin = kinematics.fin_angle(ops, p, kinematics.lever_tangent(ops, p, angle))
            return angle, rate, fin, now

        return ops.branch(p.encoder.on_fin, from_fin, from_motor)

    return Measurement(*ops.branch(p.encoder.enabled, quantised, true_values))
