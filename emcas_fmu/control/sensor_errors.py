"""Errors of sensors: offset and gain of the current sensor; eccentricity and noise of the position encoder.

    i_m = (1 + g) i + i_0
    x_m = x + a_1 (sin(x + p_1) - sin p_1) + a_2 (sin(2 x + p_2) - sin p_2) + sigma z

x is the angle of the encoder's shaft. If a scale is off its axis by e and one head reads it at a radius r, a_1 is e/r.
The error of an elliptic scale or of an angled shaft coupling has two periods per turn. Without noise x_m is 0 at x = 0.

Drive and controllers read i_m. In the drive

    K_p (i_ref - i_m) = (1 + g) K_p ((i_ref - i_0)/(1 + g) - i)         -I <= i_ref <= I

and likewise for the integral: a drive with this sensor equals a drive with an exact sensor, other gains and another
reference.

z is drawn at every sample. With four numbers u, uniform between 0 and 1, z = sqrt(3) (u_1 + u_2 - u_3 - u_4) has a mean
of 0, a variance of 1 and no value beyond +-2 sqrt(3). Two sequences of whole numbers give u = (s/m_s - t/m_t) mod 1:

    s <- 40014 s mod m_s, m_s = 2147483563        t <- 40692 t mod m_t, m_t = 2147483399

Both generators are from L'Ecuyer, "Efficient and portable combined random number generators", Communications of the
ACM 31 (1988) 742-751, who combines s and t instead of s/m_s and t/m_t. The products are exact in double precision. s
starts at the seed, t always at the same number: if both started at the seed, u of seed n would be n times u of seed 1,
modulo 1, and the noise of one seed would follow from that of another.
"""

from __future__ import annotations

from math import sqrt
from typing import Any

from ..namespace import with_values
from ..ops.base import Ops, Value
from ..physics import drive

_MULTIPLIERS, MODULI = (40014.0, 40692.0), (2147483563.0, 2147483399.0)
SECOND = 1234567890.0  # start of t: any whole number from 1 to m_t - 1
_SIGNS = (1.0, 1.0, -1.0, -1.0)


def current(p: Any, value: Value) -> Value:
    """Return the measured current [A] for a motor current [A]."""
    return (1.0 + p.sensor.current.gain_error) * value + p.sensor.current.offset


def beyond(ops: Ops, p: Any, reference: Value) -> Any:
    """Return whether a reference [V] requests a current beyond the drive's limit."""
    return ops.fabs(drive.current_reference_raw(p, reference)) > p.drive.current_limit


def of_drive(ops: Ops, p: Any, reference: Value) -> Any:
    """Return the parameters with those of the equivalent drive with an exact sensor, at a reference [V].

    A current reference beyond the limit becomes an offset, with a gain of 0; the equivalent drive's limit is never
    exceeded.
    """
    gains, offset, scale = p.drive, p.sensor.current.offset, 1.0 + p.sensor.current.gain_error
    over = beyond(ops, p, reference)
    start = ops.where(over, drive.current_reference(ops, p, reference), gains.current_offset)
    return with_values(p, {
        "drive.kp": gains.kp * scale, "drive.ki": gains.ki * scale,
        "drive.current_gain": ops.where(over, 0.0, gains.current_gain / scale),
        "drive.current_offset": (start - offset) / scale,
        "drive.current_limit": (gains.current_limit + ops.fabs(offset)) / scale})


def angle(ops: Ops, p: Any, value: Value) -> Value:
    """Return the encoder's reading [rad] without noise at an angle [rad] of its shaft."""
    e = p.sensor.encoder
    return (value + e.once * (ops.sin(value + e.once_phase) - ops.sin(e.once_phase))
            + e.twice * (ops.sin(2.0 * value + e.twice_phase) - ops.sin(e.twice_phase)))


def slope(ops: Ops, p: Any, value: Value) -> Value:
    """Return the derivative [-] of :func:`angle` at an angle [rad] of the shaft."""
    e = p.sensor.encoder
    return 1.0 + e.once * ops.cos(value + e.once_phase) + 2.0 * e.twice * ops.cos(2.0 * value + e.twice_phase)


def _next(ops: Ops, state: Value, multiplier: float, modulus: float) -> Value:
    product = multiplier * state
    return product - modulus * ops.floor(product / modulus)


def draw(ops: Ops, one: Value, other: Value) -> tuple[Value, Value, Value]:
    """Return a random number z [-] and the next states of both generators, `one` (s) and `other` (t)."""
    total = 0.0
    for sign in _SIGNS:
        one, other = (_next(ops, *generator) for generator in zip((one, other), _MULTIPLIERS, MODULI, strict=True))
        difference = one / MODULI[0] - other / MODULI[1]
        total = total + sign * (difference - ops.floor(difference))
    return sqrt(3.0) * total, one, other
