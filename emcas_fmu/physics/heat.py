"""Heat of the motor: two thermal nodes, the parameters that depend on their temperatures, and the drive's I2t limit.

    C_w dT_w/dt = R i^2 - (T_w - T_c)/R_wc        C_c dT_c/dt = (T_w - T_c)/R_wc - (T_c - T_a)/R_ca
    R = R_0 (1 + a_R (T_w - T_0))        K_t = K_t0 (1 + a_K (T_c - T_0)), K_e likewise

w is the winding, c the case with stator and magnets, a the ambient. Losses of iron and friction are left out. As in
servo drives, the drive integrates i^2 - I_c^2, with the continuous current I_c, to a load s >= 0:

    ds/dt = F (i^2 - I_c^2) / ((I_p^2 - I_c^2) t_p)        0 <= s
    I_max^2 = I_c^2 + (I_p^2 - I_c^2) clip((1 - s)/(1 - F), 0, 1)

From s = 0 the peak I_p (drive.current_limit) is available for t_p; from s = F on the limit folds back, to I_c at s = 1.
The limit is a continuous function of a state, so it neither jumps nor chatters: while the reference is above the limit,
i^2 - I_c^2 falls exponentially, with the time constant t_p (1 - F)/F. I_p is the drive's rated peak: a fault that
lowers drive.current_limit changes neither I_p nor s, and the lower of drive.current_limit and I_max acts.
"""

from __future__ import annotations

from typing import Any

from ..namespace import with_values
from ..ops.base import Ops, Value

FOLDING = 0.9  # F, the I2t load from which the limit folds back
LEAST_FACTOR = 0.1  # smallest R/R_0 and K_t/K_t0


def _linear(ops: Ops, p: Any, coefficient: Value, temperature: Value) -> Value:
    return ops.maximum(1.0 + coefficient * (temperature - p.heat.reference_temperature), LEAST_FACTOR)


def resistance(ops: Ops, p: Any, winding: Value) -> Value:
    """Return the winding's resistance [Ohm] at a winding temperature [degC]."""
    return p.motor.resistance * _linear(ops, p, p.heat.resistance_coefficient, winding)


def magnets(ops: Ops, p: Any, case: Value) -> Value:
    """Return the ratio [-] of the magnets' flux, K_t and K_e at a case temperature [degC] to those at T_0."""
    return _linear(ops, p, p.heat.torque_coefficient, case)


def at_temperatures(ops: Ops, p: Any, winding: Value, case: Value) -> Any:
    """Return parameters with the motor's resistance and constants at temperatures [degC] of winding and case."""
    flux = magnets(ops, p, case)
    return with_values(p, {"motor.resistance": resistance(ops, p, winding),
                           "motor.torque_constant": p.motor.torque_constant * flux,
                           "motor.back_emf_constant": p.motor.back_emf_constant * flux})


def flows(p: Any, winding: Value, case: Value) -> tuple[Value, Value]:
    """Return the heat flows [W] from winding to case and from case to ambient at their temperatures [degC]."""
    return ((winding - case) / p.heat.winding_to_case, (case - p.friction.temperature) / p.heat.case_to_ambient)


def warmed(ops: Ops, p: Any, winding: Value, case: Value, loss: Value, h: Value) -> tuple[Value, Value]:
    """Return the temperatures [degC] of winding and case after `h` [s] under a constant loss [W] in the winding."""
    # The implicit midpoint rule is of second order, stable for any step, and conserves energy. A step that is long for
    # a node is more implicit than the midpoint, or its temperature would pass that of its neighbour.
    inward, outward = flows(p, winding, case)
    between, away = 1.0 / p.heat.winding_to_case, 1.0 / p.heat.case_to_ambient
    weight = ops.maximum(0.5, 1.0 - ops.minimum(p.heat.winding_capacity / (between * h),
                                                p.heat.case_capacity / ((between + away) * h)))
    winding_rate, case_rate = p.heat.winding_capacity / (weight * h), p.heat.case_capacity / (weight * h)
    first, second = loss - inward, inward - outward
    below = case_rate + between + away
    # The square of the conductance between the nodes is left out: it cancels. The rises are those at `weight` of h.
    determinant = winding_rate * below + between * (case_rate + away)
    rise = (first * below + second * between) / determinant
    case_rise = (second * (winding_rate + between) + first * between) / determinant
    return winding + rise / weight, case + case_rise / weight


def _squares(ops: Ops, p: Any, peak: Value) -> tuple[Value, Value]:
    """Return I_c^2 and I_p^2 - I_c^2 [A^2]; the continuous current is at most the peak."""
    continuous = ops.minimum(p.heat.continuous_current, peak)
    return continuous * continuous, peak * peak - continuous * continuous


def loaded(ops: Ops, p: Any, load: Value, square: Value, h: Value, rated: Value | None = None) -> Value:
    """Return the I2t load s [-] after `h` [s] with a mean `square` of the current [A^2]; 0 if I_p <= I_c.

    `rated` [A] is the rated peak of a drive that a fault derates, otherwise None.
    """
    continuous, reserve = _squares(ops, p, p.drive.current_limit if rated is None else rated)
    limited = reserve > 0.0
    budget = ops.where(limited, reserve, 1.0) * p.heat.peak_time / FOLDING
    return ops.where(limited, ops.maximum(load + h * (square - continuous) / budget, 0.0), 0.0)


def sustained_current(ops: Ops, p: Any, duration: Value) -> Value:
    """Return the constant current [A] that the drive allows for a time [s] from s = 0 without folding back."""
    peak = p.drive.current_limit
    continuous, reserve = _squares(ops, p, peak)
    return ops.minimum(ops.sqrt(continuous + reserve * p.heat.peak_time / duration), peak)


def current_limit(ops: Ops, p: Any, load: Value, rated: Value | None = None) -> Value:
    """Return the largest current reference [A] at an I2t load s [-]; `rated` as in :func:`loaded`."""
    peak = p.drive.current_limit if rated is None else rated
    continuous, reserve = _squares(ops, p, peak)
    remaining = (1.0 - load) / (1.0 - FOLDING)
    folded = ops.sqrt(continuous + ops.clip(remaining, 0.0, 1.0) * reserve)
    limit = ops.where(remaining >= 1.0, peak, folded)
    return limit if rated is None else ops.minimum(limit, p.drive.current_limit)
