"""A supply bus with source resistance that several drives share.

    V = max(V_source - s, 0)        I = sum P_i / V        s -> R I

V is the voltage at the drives, s the sag. It follows the current at instants h apart; in between it is held.
A drive at its voltage limit raises its current by about dV h/L in that time, so the new sag is taken where that
line meets R I (one step of Newton's method), which keeps it steady for any R.
"""

from __future__ import annotations

from ..ops.base import Ops, Value


def voltage(ops: Ops, source: Value, sag: Value) -> Value:
    """Voltage at the drives [V]."""
    return ops.maximum(source - sag, 0.0)


def current(ops: Ops, power: Value, at: Value) -> Value:
    """Current [A] that drives of a total power [W] draw at a voltage [V]; none from a dead bus."""
    return ops.branch(at > 0.0, lambda: (power / at,), lambda: (0.0,))[0]


def next_sag(ops: Ops, resistance: Value, sag: Value, drawn: Value, admittance: Value) -> Value:
    """Sag [V] from an instant of the bus on; `admittance` is sum h/L_i [1/Ohm]."""
    return sag + (resistance * drawn - sag) / (1.0 + resistance * admittance)
