"""The command from the bus to the controllers: late, taken now and then, in whole steps.

    arrived_k = command_k-L                                                   L samples of `latency`
    taken_k = q round(arrived_k/q)  every `update_time`, else taken_k-1       q = `resolution`, 0: as it is

Latency and update time count in whole samples, rounded. The first command is the one of the first sample; before it has
arrived it is the start angle. The runtime delays (:mod:`emcas_fmu.runtime.core`), the rest is here.
"""

from __future__ import annotations

from typing import Any

from ..ops.base import Ops, Value

LONGEST = 20  # samples of latency
# Samples until the next command is taken, and the one that was [rad].
STATES = ("command_wait", "command_taken")


def _whole(ops: Ops, p: Any, time: Value) -> Value:
    return ops.floor(time / p.controller.sample_time + 0.5)


def late(ops: Ops, p: Any) -> Value:
    """Return the samples by which commands are late."""
    return _whole(ops, p, p.command.latency)


def interval(ops: Ops, p: Any) -> Value:
    """Return the time [s] from one command that is taken to the next."""
    return p.controller.sample_time * ops.maximum(_whole(ops, p, p.command.update_time), 1.0)


def start(ops: Ops, p: Any, fin_angle: Value) -> dict[str, Value]:
    """Return STATES at a start at a fin angle [rad], by name."""
    return dict(zip(STATES, (late(ops, p), fin_angle), strict=True))


def taken(ops: Ops, p: Any, arrived: Value, wait: Value, before: Value) -> tuple[Value, Value, Value]:
    """Return the command [rad] that the controllers have at a sample, and STATES after it.

    `arrived` [rad] is the command that has come over the bus, `wait` and `before` are STATES of the sample before.
    """
    every, resolution = _whole(ops, p, p.command.update_time), p.command.resolution

    def over_the_bus() -> tuple[Value, ...]:
        unit = ops.where(resolution > 0.0, resolution, 1.0)
        rounded = ops.where(resolution > 0.0, unit * ops.floor(arrived / unit + 0.5), arrived)
        due = wait < 0.5
        now = ops.where(due, rounded, before)
        return now, ops.where(due, ops.maximum(every, 1.0), wait) - 1.0, now

    # True too of operations whose floor does nothing (linear analysis).
    direct = ops.both(ops.both(late(ops, p) < 1.0, every < 2.0), ops.equal(resolution, 0.0))
    now, next_wait, kept = ops.branch(direct, lambda: (arrived, wait, before), over_the_bus)
    return now, next_wait, kept
