"""The built-in test: what the actuator finds out by itself, from what it measures. It knows nothing of faults.

A monitor trips when its condition has held without a break for ``monitor.persistence``, and clears when it has been
gone for as long. Those of an actuator that does not follow its command, disabled or homing, are reset. Tracking is
judged against a model of what the command asks for,

    dm/dt = clip(Kp_pos (command - m), +-rate)

so that the lag of a loop that follows, v/Kp_pos, and the time of a large step trip nothing.
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
    _tunable("tracking_limit", "rad", 0.0, radians(180.0), "modelled less measured angle, beyond which tracking trips"),
    _tunable("rate", "rad/s", 1e-3, 1e3, "fin rate that the model of the response takes for possible"),
    _tunable("stall_share", "1", 0.0, 1.0, "of drive.reference_limit that the DAC puts out at a stall"),
    _tunable("stall_rate", "rad/s", 0.0, 100.0, "measured rate below which the fin is taken to stand"),
    _tunable("current_limit", "A", 0.0, 1e4, "current reference less current, beyond which the drive does not respond"),
    _tunable("minimum_supply", "V", 0.0, 1e3, "bus voltage below which the supply is too low"),
)
# Bits of the built-in test's word, the first the least.
MONITORS = (
    ("tracking", "the measured angle is not where the command should have taken it"),
    ("stall", "a large reference moves nothing"),
    ("drive", "the current does not follow its reference"),
    ("supply", "the bus voltage is too low"),
    ("command", "the command is beyond command.limit"),
)
COUNT = len(MONITORS)


class Watched(NamedTuple):
    """What the monitors see at a sample: `command` [rad] as received, `measured` angle [rad] now and before, the
    `modelled` one of the sample before,
    `reference` [V] and `current` [A] (nothing in a model without a drive, or without a current loop), `supply` [V],
    `enabled`."""

    command: Value
    measured: Value
    before: Value
    modelled: Value
    reference: Value | None
    current: Value | None
    supply: Value
    enabled: Value


def modelled(ops: Ops, p: Any, w: Watched) -> Value:
    """Where [rad] the command should have taken the fin by now; of an actuator that is not watched, where it is."""
    period = p.controller.sample_time
    share = ops.minimum(p.controller.position.kp * period, 1.0)
    asked = share * (control.clipped_command(ops, p, w.command) - w.modelled)
    most = p.monitor.rate * period
    return ops.where(w.enabled, w.modelled + ops.clip(asked, -most, most), w.measured)


def _conditions(ops: Ops, p: Any, w: Watched) -> tuple[Value, ...]:
    error = ops.fabs(modelled(ops, p, w) - w.measured)
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
    return (error > p.monitor.tracking_limit, stalled, unresponsive, w.supply < p.monitor.minimum_supply,
            ops.fabs(w.command) > p.command.limit)


def judged(ops: Ops, p: Any, counters: tuple[Value, ...], tripped: tuple[Value, ...], w: Watched
           ) -> tuple[tuple[Value, ...], tuple[Value, ...]]:
    """Counters and flags (1 tripped, 0 clear) of the monitors after a sample.

    A counter tells for how many samples on end the condition has not been what the flag says.
    """
    most = p.monitor.persistence / p.controller.sample_time - _SLACK
    most = ops.maximum(-ops.floor(-most), 1.0)
    counted, flags = [], []
    for condition, counter, flag in zip(_conditions(ops, p, w), counters, tripped, strict=True):
        holds = ops.where(condition, 1.0, 0.0)
        now = ops.where(ops.equal(holds, flag), 0.0, counter + 1.0)
        counted.append(ops.where(ops.both(w.enabled, now < most), now, 0.0))
        flags.append(ops.where(w.enabled, ops.where(now >= most, holds, flag), 0.0))
    return tuple(counted), tuple(flags)


def word(tripped: tuple[Value, ...]) -> Value:
    """A bit for each monitor that has tripped."""
    return reduce(lambda sum_, i: sum_ + float(2**i) * tripped[i], range(COUNT), 0.0)


def verdict(ops: Ops, tripped: tuple[Value, ...]) -> Value:
    """The status of an enabled actuator: failed if it does not track, degraded if another monitor has tripped."""
    any_tripped = reduce(lambda found, flag: ops.either(found, flag > 0.0), tripped, False)
    return ops.where(tripped[0] > 0.0, FAILED, ops.where(any_tripped, DEGRADED, OPERATIONAL))
