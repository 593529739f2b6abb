"""Four-way servovalve: spool and metering edges.

    z'' = w_v^2 (u - z) - 2 zeta_v w_v z'        |z'| <= 1/t_s, |z| <= 1        spool, command u: shares of the stroke
    Q1 = K (g(z) s(p_s - p1) - g(-z) s(p1 - p_t))        Q2 with p2 and -z        K = Q_r/sqrt(dp_r/2)
    g(z) = (z + sqrt(z^2 + l^2))/2        s(dp) = dp/(dp^2 + dp_0^2)^(1/4)

Q_r is the flow through the fully open valve at a pressure drop dp_r across both edges. g is the opening of an edge with
the lap l, which leaks at null. s is the root of turbulent flow, smooth at 0: flow is laminar far below dp_0. Merritt,
"Hydraulic Control Systems" (1967), chapter 5; Jelali & Kroll, "Hydraulic Servo-systems" (2003), chapter 4.
"""

from __future__ import annotations

from typing import Any

from ..ops.base import Ops, Value


def opening(ops: Ops, p: Any, spool: Value) -> Value:
    """Return g [-], the opening of the edge that a positive spool position [-] opens."""
    lap = p.valve.lap
    return 0.5 * (spool + ops.sqrt(spool * spool + lap * lap))


def turbulent(ops: Ops, p: Any, drop: Value) -> Value:
    """Return the signed root s [Pa^0.5] of a pressure drop [Pa]."""
    return drop / ops.sqrt(ops.sqrt(drop * drop + p.valve.laminar_pressure * p.valve.laminar_pressure))


def gain(ops: Ops, p: Any) -> Value:
    """Return K [m3/(s.Pa^0.5)], the flow coefficient of an open edge."""
    return p.valve.rated_flow / ops.sqrt(0.5 * p.valve.rated_pressure)


def flows(ops: Ops, p: Any, spool: Value, supply: Value, pressure_1: Value, pressure_2: Value) -> tuple[Value, ...]:
    """Return the flows [m3/s] into both chambers and from the supply, at pressures [Pa] of `supply` and chambers."""
    k, up, down, tank = gain(ops, p), opening(ops, p, spool), opening(ops, p, -spool), p.tank.pressure

    def edge(open_: Value, drop: Value) -> Value:
        return k * open_ * turbulent(ops, p, drop)

    from_1, from_2 = edge(up, supply - pressure_1), edge(down, supply - pressure_2)
    to_tank_1, to_tank_2 = edge(down, pressure_1 - tank), edge(up, pressure_2 - tank)
    return from_1 - to_tank_1, from_2 - to_tank_2, from_1 + from_2


def fastest(p: Any) -> Value:
    """Return the largest speed [1/s] of the spool."""
    return 1.0 / p.valve.stroke_time


def spool_acceleration(p: Any, spool: Value, speed: Value, command: Value) -> Value:
    """Return z'' [1/s2] while no limit acts, at a `spool` position [-], a `speed` z' [1/s] and a `command` u [-]."""
    w = p.valve.natural_frequency
    return w * (w * (command - spool) - 2.0 * p.valve.damping * speed)
