"""Filters of the sampled controllers: an observer of the motor's speed, and a notch in the drive's reference.

The difference of two counts gives the mean speed d since the last sample; it is half a sample old. The observer
predicts the speed w from the torque of the measured current and a load T_d, positive along w, and corrects both by d.
Its two poles are z = exp(-b T_s) (Franklin, Powell & Workman, "Digital Control of Dynamic Systems", 3rd ed., section
8.2):

    w'  = w + T_s/J (K_t i + T_d)                           e  = d - (w + w')/2             q = exp(-b T_s)
    w+  = w' + (1 - q)(3 + q)/2 e                           T_d+ = T_d + (1 - q)^2 J/T_s e

Hence w is exact under constant acceleration, and 0 at rest under a constant load. T_d also contains model errors.
The observer also runs while the drive is disabled. With the encoder off the controllers use the true speed.

The notch has a gain of 1 at frequency 0 (ibid., section 6.1; bilinear transformation, prewarped and hence exact at W):

    (s^2 + 2 z_0 W s + W^2)/(s^2 + 2 z_p W s + W^2)         s = W/tan(W T_s/2) (z - 1)/(z + 1)

At W its gain is z_0/z_p; far below W it delays the reference by 2 (z_p - z_0)/W.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from ..namespace import Record
from ..ops.base import Ops, Value
from ..physics import drive, mechanics
from . import controllers
from .sensors import Measurement
from .trajectory import Ahead


class Observed(NamedTuple):
    """States of the observer: motor speed w [rad/s] and load T_d at the motor [N.m]."""

    observed_speed: Value
    observed_load: Value


class Notched(NamedTuple):
    """States of the notch [V], in the transposed direct form II."""

    notch_1: Value
    notch_2: Value


def _observes(ops: Ops, p: Any) -> Value:
    return ops.both(p.encoder.enabled, p.filters.speed_bandwidth > 0.0)


def observed(ops: Ops, p: Any, x: Record, measured: Measurement, current: Value) -> tuple[Value, Observed]:
    """Return the motor speed [rad/s] for the controllers, and the observer's states, at a measured current [A].

    With a bandwidth of 0, or with the encoder off, this speed is the measured one.
    """
    def estimated() -> tuple[Value, ...]:
        pole = ops.exp(-p.filters.speed_bandwidth * p.controller.sample_time)
        rise = p.controller.sample_time / mechanics.coefficients(ops, p, measured.motor_angle).inertia
        ahead = x.observed_speed + rise * (drive.torque(p, current) + x.observed_load)
        error = measured.motor_speed - 0.5 * (x.observed_speed + ahead)
        speed = ahead + 0.5 * (1.0 - pole) * (3.0 + pole) * error
        return speed, speed, x.observed_load + (1.0 - pole) * (1.0 - pole) / rise * error

    speed, *states = ops.branch(_observes(ops, p), estimated, lambda: (measured.motor_speed, 0.0, 0.0))
    return speed, Observed(*states)


def rate_led(ops: Ops, p: Any, x: Record, command: Value, ahead: Ahead) -> tuple[Ahead, Value]:
    """Return the feed-forward `ahead` of a motion to a `command` [rad], shifted to the time of the observed speed.

    The loops feed forward the mean rate since the last sample, like that from a difference of counts. The observed
    speed is half a sample newer. The second result is the mean rate [rad/s], which the next sample requires.
    """
    rate = (controllers.target_angle(ops, p, command) - x.target) / p.controller.sample_time
    advance = p.controller.velocity.kp * 0.5 * (rate - x.target_rate)
    reference = ahead.reference + ops.where(_observes(ops, p), advance, 0.0)
    return ahead._replace(reference=reference), rate


def notched(ops: Ops, p: Any, x: Record, reference: Value) -> tuple[Value, Notched]:
    """Return the reference [V] after the notch, within +-drive.reference_limit, and the notch's states."""
    def filtered() -> tuple[Value, ...]:
        f, limit = p.filters, p.drive.reference_limit
        warped = ops.tan(0.5 * f.notch_frequency * p.controller.sample_time)
        square = 1.0 + warped * warped
        zero, pole = 2.0 * f.notch_zero_damping * warped, 2.0 * f.notch_pole_damping * warped
        middle, scale = 2.0 * (warped * warped - 1.0), square + pole
        out = (square + zero) / scale * reference + x.notch_1
        return (ops.clip(out, -limit, limit), middle / scale * (reference - out) + x.notch_2,
                ((square - zero) * reference - (square - pole) * out) / scale)

    out, *states = ops.branch(p.filters.notch_frequency > 0.0, filtered, lambda: (reference, 0.0, 0.0))
    return out, Notched(*states)


def delay(ops: Ops, p: Any) -> Value:
    """Return the time [s] by which the notch delays a slowly varying reference."""
    f = p.filters
    on = f.notch_frequency > 0.0
    return ops.where(on, 2.0 * (f.notch_pole_damping - f.notch_zero_damping) / ops.where(on, f.notch_frequency, 1.0),
                     0.0)
