"""Viscous and Coulomb friction at the motor, which depends on direction, fin angle and temperature.

    C_m = k_C(T) max(sum_n c_n (fin_angle/20 deg)^n, 0)        b_m = k_b(T) b

with coefficients c_n and b for each direction of motion. At rest friction balances the other torques up to C_m: the
motor sticks exactly. Section 3.3 measures friction at 24 and -6 degC and fits a sixth-order polynomial of the fin angle
for each direction. The ratios k_C and k_b to the friction at 24 degC are tables over temperature, ``friction.table.*``:
linear between their points, constant beyond the first and the last.

With :mod:`emcas_fmu.extensions.stribeck` friction falls with the speed w, from s C_m at rest to C_m:

    C_m (1 + (s - 1) exp(-(w/w_s)^2))
"""

from __future__ import annotations

from collections.abc import Sequence
from math import radians
from typing import Any

from ..ops.base import Ops, Value
from ..ops.elementary import polynomial

POLYNOMIAL_SPAN = radians(20.0)  # the polynomials' variable is fin_angle / POLYNOMIAL_SPAN


def _temperature_factor(ops: Ops, p: Any, ratios: Sequence[Value]) -> Value:
    """Return the `ratios` [-] interpolated at friction.temperature; at a point of the table, its value to the bit."""
    points, now = p.friction.table.temperature, p.friction.temperature
    factor = ratios[0]
    for low, high, at_low, at_high in zip(points, points[1:], ratios, ratios[1:], strict=False):
        factor = ops.where(now >= low, at_low + (at_high - at_low) * ((now - low) / (high - low)), factor)
    return ops.where(now >= points[-1], ratios[-1], factor)


def coulomb_polynomial(coefficients: Any, fin: Value) -> Value:
    """Return the polynomial [N.m] of one direction at a fin angle [rad], as fitted; it may be negative."""
    # The span is in the coefficients, which depend on parameters alone: no step divides by it.
    return polynomial(fin, [c * (1.0 / POLYNOMIAL_SPAN**n) for n, c in enumerate(coefficients)])


def coulomb_reference(ops: Ops, p: Any, direction: Value, fin: Value) -> Value:
    """Return the Coulomb torque [N.m] at 24 degC at a fin angle [rad] for motion along the sign of `direction`."""
    polynomials = p.friction.coulomb
    return ops.branch(
        direction > 0.0,
        lambda: (ops.maximum(coulomb_polynomial(polynomials.positive, fin), 0.0),),
        lambda: (ops.maximum(coulomb_polynomial(polynomials.negative, fin), 0.0),),
    )[0]


def falls(p: Any) -> bool:
    """Return whether dry friction at the motor depends on the speed."""
    return bool(p.structure.stribeck)


def stribeck(ops: Ops, static_ratio: Value, stribeck_speed: Value, speed: Value) -> Value:
    """Return the ratio [-] of dry friction at a speed, in the unit of `stribeck_speed`, to that of fast sliding."""
    share = speed / stribeck_speed
    return 1.0 + (static_ratio - 1.0) * ops.exp(-share * share)


def coulomb(ops: Ops, p: Any, direction: Value, fin: Value, speed: Value = 0.0) -> Value:
    """Return dry friction C_m [N.m] at the motor for motion along the sign of `direction`, at a motor speed [rad/s].

    If the speed is against the direction, the friction is that at rest.
    """
    factor = _temperature_factor(ops, p, p.friction.table.coulomb)
    value = coulomb_reference(ops, p, direction, fin)
    if falls(p):
        curve = p.stribeck
        along = ops.maximum(ops.where(direction > 0.0, speed, -speed), 0.0)
        return value * factor * stribeck(ops, curve.static_ratio, curve.speed, along)
    return value * factor


def viscous(ops: Ops, p: Any, direction: Value) -> Value:
    """Return the viscous coefficient b_m [N.m.s/rad] at the motor for motion along the sign of `direction`."""
    factor = _temperature_factor(ops, p, p.friction.table.viscous)
    return ops.where(direction > 0.0, p.friction.viscous.positive * factor, p.friction.viscous.negative * factor)


def mean_viscous(ops: Ops, p: Any) -> Value:
    """Return the mean b_m [N.m.s/rad] of both directions, which damps the fundamental of an oscillation."""
    return 0.5 * (viscous(ops, p, 1.0) + viscous(ops, p, -1.0))
