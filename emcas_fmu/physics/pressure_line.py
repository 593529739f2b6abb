"""A pressure line that several actuators share: a pump with limited flow, and a gas accumulator.

    C dp/dt = Q_pump - sum Q_i        Q_i = P_i/p        Q_pump = clip(G (p_set - p), 0, Q_max)
    C = V/(n p)                       V = V_0 (p_0/p)^(1/n)

p is the absolute pressure at the actuators, P_i the hydraulic power to one of them, p_set the setting of the pump's
regulator. V is the volume of the gas in an accumulator of the volume V_0 with the precharge p_0; p V^n is constant.
Below p_0 the accumulator is empty, and only oil, its air and pipes are compliant: C is then a hundredth of its value at
p_0 (an estimate).

A step h uses C and the flow Q to all actuators at its start, and the pump's flow at its end. Q changes in proportion to
the pressure:

    C (p' - p)/h = Q_pump(p') - Q - |Q|/p (p' - p)

Each of the three pieces of Q_pump has a solution p'. The correct p' is the larger of the solution without pump flow and
the smaller of the other two. It is a weighted mean of p, p_set and pressures at which flows balance, and no weight is
negative: it does not overshoot, whatever h is. If a line fills, a step ends at p_0, since C changes there. p stays at
or above a hundredth of a bar, about the pressure of vapour.

The flow Q to an actuator behind a throttle, with the pressure p_1 behind the throttle, really has the slope
Q/(2 (p - p_1)). The step is stable if the drop p - p_1 is above a quarter of p, or if h times the slope is below C.
"""

from __future__ import annotations

from typing import Any

from ..ops.base import Ops, Value

LEAST_PRESSURE = 1e3  # Pa, smallest pressure
EMPTY = 0.01  # ratio of the compliance with an empty accumulator to that at the precharge
LEAST_COMPLIANCE = 1e-16  # m3/Pa, that of less than a cubic centimetre of oil: a line is never rigid
AT_SOURCE = -1.0  # state of a line that has not been stepped yet: its pressure is p_set


def pressure(ops: Ops, source: Value, state: Value) -> Value:
    """Return the pressure at the actuators [Pa]; until the first step of the line it is the `source`, p_set."""
    return ops.where(state < 0.0, source, state)


def compliance(ops: Ops, line: Any, at: Value) -> Value:
    """Return the compliance C [m3/Pa] of the line at a pressure [Pa] above 0."""
    volume, precharge, exponent = line.accumulator_volume, line.precharge_pressure, line.polytropic_exponent
    gas = ops.branch(at < precharge, lambda: (EMPTY * volume / (exponent * precharge),),
                     lambda: (volume * ops.exp(ops.log(precharge / at) / exponent) / (exponent * at),))[0]
    return ops.maximum(gas, LEAST_COMPLIANCE)


def next_pressure(ops: Ops, line: Any, source: Value, state: Value, drawn: Value) -> Value:
    """Return the pressure [Pa] after an update of the line; `source` is p_set [Pa], `drawn` Q [m3/s]."""
    p, h = ops.maximum(pressure(ops, source, state), LEAST_PRESSURE), line.update_time
    slope = ops.fabs(drawn) / p
    storage = compliance(ops, line, p) / h  # flow [m3/s] per change of pressure [Pa]
    flow = storage * p + slope * p - drawn
    no_flow = flow / (storage + slope)
    full = (flow + line.pump_flow) / (storage + slope)
    regulated = (flow + line.pump_gain * source) / (storage + slope + line.pump_gain)
    reached = ops.maximum(no_flow, ops.minimum(regulated, full))
    stopped = ops.where(p < line.precharge_pressure, ops.minimum(reached, line.precharge_pressure), reached)
    return ops.maximum(stopped, LEAST_PRESSURE)
