"""A supply bus with source resistance that several drives share.

    V = max(V_source - s, V_0)        I = sum P_i / V        s -> R I

V is the voltage at the drives, s the sag. It follows the current at instants h apart; in between it is held.
A drive at its voltage limit raises its current by about dV h/L in that time, so the new sag is where that line meets
R I (one step of Newton's method): otherwise the sag would overshoot where R h/L is not small. V_0 is a millivolt, or
the source's voltage if that is less: drives on a collapsed bus still switch their motors' currents onto it, and P/V
limits I as long as V is not zero.
"""

from __future__ import annotations

from ..ops.base import Ops, Value

LEAST = 1e-3  # V


def voltage(ops: Ops, source: Value, sag: Value) -> Value:
    """Return the voltage at the drives [V]; the source's without a sag."""
    return ops.maximum(source - sag, ops.clip(source, 0.0, LEAST))


def next_sag(ops: Ops, resistance: Value, sag: Value, current: Value, admittance: Value) -> Value:
    """Return the sag [V] after an instant of the bus, under a supply current [A]; `admittance` is sum h/L_i [1/Ohm]."""
    return sag + (resistance * current - sag) / (1.0 + resistance * admittance)
