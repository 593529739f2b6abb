"""The built-in test: what the actuator finds out by itself, from what it measures. It knows nothing of faults.

A monitor trips when its condition has held for ``monitor.persistence``, and clears when it has not for as long.
"""

from __future__ import annotations

from functools import reduce
from math import radians
from typing import Any, NamedTuple

from .. import control
from ..ops.base import Ops, Value
from ..physics import drive
from ..variables import Variable
from .status import DEGRADED, FAILED, OPERATIONAL

_SLACK = 1e-6  # of a sample: whole numbers of samples are counted whole


def _tunable(name: str, unit: str, minimum: float, maximum: float, description: str) -> Variable:
    return Variable(f"monitor.{name}", "Real", "parameter", "tunable", unit, description, minimum, maximum)


PARAMETERS = (
    _tunable("persistence", "s", 0.0, 100.0, "time a condition must hold for its monitor to trip or to clear"),
    _tunable("tracking_limit", "rad", 0.0, radians(180.0), "command less measured angle, beyond which tracking trips"),
    _tunable("stall_share", "1", 0.0, 1.0, "of drive.reference_limit that the DAC puts out at a stall"),
    _tunable("stall_rate", "rad/s", 0.0, 100.0, "measured rate below which the fin is taken to stand"),
    _tunable("current_limit", "A", 0.0, 1e4, "current reference less current, beyond which the drive does not respond"),
    _tunable("minimum_supply", "V", 0.0, 1e3, "bus voltage below which the supply is too low"),
)
# Bits of the built-in test's word, the first the least.
MONITORS = (
    ("tracking", "the measured angle does not follow the command"),
    ("stall", "a large reference moves nothing"),
    ("drive", "the current does not follow its reference"),
    ("supply", "the bus voltage is too low"),
    ("command", "the command is beyond command.limit"),
)
COUNT = len(MONITORS)


class Watched(NamedTuple):
    """What the monitors see at a sample: `command` [rad] as received, `measured` angle [rad] now and before,
    `reference` [V] and `current` [A] (nothing in a model without a drive, or without a current loop), `supply` [V],
    `enabled`."""

    command: Value
    measured: Value
    before: Value
    reference: Value | None
    current: Value | None
    supply: Value
    enabled: Value


def _conditions(ops: Ops, p: Any, w: Watched) -> tuple[Value, ...]:
    error = ops.fabs(control.clipped_command(ops, p, w.command) - w.measured)
    rate = ops.fabs(w.measured - w.before) / p.controller.sample_time
    stalled: Value = False
    unresponsive: Value = False
    if w.reference is not None:
        pushing = ops.fabs(w.reference) >= p.monitor.stall_share * p.drive.reference_limit
        stalled = ops.both(pushing, rate < p.monitor.stall_rate)
    if w.reference is not None and w.current is not None:
        # The reference that the drive has is a transport delay older: persistence covers it.
        asked = drive.current_reference(ops, p, w.reference)
        unresponsive = ops.fabs(asked - w.current) > p.monitor.current_limit
    found = (error > p.monitor.tracking_limit, stalled, unresponsive, w.supply < p.monitor.minimum_supply,
             ops.fabs(w.command) > p.command.limit)
    return tuple(ops.both(w.enabled, condition) for condition in found)


def judged(ops: Ops, p: Any, counters: tuple[Value, ...], tripped: tuple[Value, ...], w: Watched
           ) -> tuple[tuple[Value, ...], tuple[Value, ...]]:
    """Counters [samples] and flags (1 tripped, 0 clear) of the monitors after a sample."""
    most = p.monitor.persistence / p.controller.sample_time - _SLACK
    most = ops.maximum(-ops.floor(-most), 1.0)
    counted, flags = [], []
    for condition, counter, flag in zip(_conditions(ops, p, w), counters, tripped, strict=True):
        now = ops.clip(counter + ops.where(condition, 1.0, -1.0), 0.0, most)
        counted.append(now)
        flags.append(ops.where(now >= most, 1.0, ops.where(now <= 0.0, 0.0, flag)))
    return tuple(counted), tuple(flags)


def word(tripped: tuple[Value, ...]) -> Value:
    """A bit for each monitor that has tripped."""
    return reduce(lambda sum_, i: sum_ + float(2**i) * tripped[i], range(COUNT), 0.0)


def verdict(ops: Ops, tripped: tuple[Value, ...]) -> Value:
    """The status of an enabled actuator: failed if it does not track, degraded if another monitor has tripped."""
    any_tripped = reduce(lambda found, flag: ops.either(found, flag > 0.0), tripped, False)
    return ops.where(tripped[0] > 0.0, FAILED, ops.where(any_tripped, DEGRADED, OPERATIONAL))
