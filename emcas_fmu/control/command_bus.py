"""The data bus between flight computer and controllers: latency, update time and resolution of the command.

    arrived_k = command_k-L                                                         L samples of `latency`
    delivered_k = q round(arrived_k/q)  every `update_time`, else delivered_k-1     q = `resolution`; 0: not rounded

Latency and update time are rounded to whole samples. Until the command of the first sample has arrived, the controllers
use the start angle. The runtime delays the commands by the latency (:mod:`emcas_fmu.runtime.core`).
"""

from __future__ import annotations

from typing import Any

from ..ops.base import Ops, Value

LONGEST_LATENCY = 20  # longest latency in samples
# States: number of samples until the next update, and the command [rad] of the last update.
STATES = ("command_wait", "command_taken")


def _whole(ops: Ops, p: Any, time: Value) -> Value:
    return ops.floor(time / p.controller.sample_time + 0.5)


def latency(ops: Ops, p: Any) -> Value:
    """Return the latency of commands as a number of samples [-]."""
    return _whole(ops, p, p.command.latency)


def interval(ops: Ops, p: Any) -> Value:
    """Return the time [s] between two updates of the command."""
    return p.controller.sample_time * ops.maximum(_whole(ops, p, p.command.update_time), 1.0)


def start(ops: Ops, p: Any, fin_angle: Value) -> dict[str, Value]:
    """Return the initial STATES by name, for a start angle [rad] of the fin."""
    return dict(zip(STATES, (latency(ops, p), fin_angle), strict=True))


def delivered(ops: Ops, p: Any, arrived: Value, wait: Value, before: Value) -> tuple[Value, ...]:
    """Return the command [rad] that the controllers use at a sample, and the two STATES after this sample.

    `arrived` [rad] is the command after the latency; `wait` and `before` are the STATES after the previous sample.
    """
    every, resolution = _whole(ops, p, p.command.update_time), p.command.resolution

    def over_the_bus() -> tuple[Value, ...]:
        step = ops.where(resolution > 0.0, resolution, 1.0)
        rounded = ops.where(resolution > 0.0, step * ops.floor(arrived / step + 0.5), arrived)
        due = wait < 0.5
        now = ops.where(due, rounded, before)
        return now, ops.where(due, ops.maximum(every, 1.0), wait) - 1.0, now

    # The limits 1 and 2 also hold in linear analysis, in which floor returns its argument.
    direct = ops.both(ops.both(latency(ops, p) < 1.0, every < 2.0), ops.equal(resolution, 0.0))
    return ops.branch(direct, lambda: (arrived, wait, before), over_the_bus)
