"""The times of samples, arrivals and ticks.

Time is counted in ticks. A sample period is cut at the instant at which the delayed reference reaches the drive. Each
part is divided into equal ticks that are no longer than the longest allowed tick. Samples and arrivals are thus at
boundaries of ticks, whatever the delay.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from ..actuators.declaration import Actuator
from ..control import command_bus
from ..ops.base import Ops, Value

# Communication points nearer to a tick's boundary than this share of the sample time, but at most a quarter of the
# shortest tick, count as being on it. By rounding, a host's time may be slightly before a sample, which would delay the
# command by a whole sample.
TOLERANCE = 1e-3
# Relative amount by which a tick may exceed the longest allowed tick, so that rounding does not add a tick.
_ROUNDING = 1e-9


class Schedule(NamedTuple):
    """A sample period: ``before`` ticks of length ``h_before`` [s], then ``after`` of ``h_after``.

    The reference of a sample reaches the drive ``delay_samples`` periods later, ``arrival`` [s] into the period:
    between the two parts. A command reaches the controllers ``late_commands`` periods after its sample. ``slack`` [s]
    is the tolerance of communication points.
    """

    sample_time: Value
    before: Value
    after: Value
    arrival: Value
    h_before: Value
    h_after: Value
    delay_samples: Value
    late_commands: Value
    slack: Value


def schedule(ops: Ops, p: Any, actuator: Actuator) -> Schedule:
    """Return the schedule of a sample period of an actuator with parameters `p`."""
    period = p.controller.sample_time
    delay = 0.0 if actuator.transport_delay is None else actuator.transport_delay(ops, p) / period
    delay_samples = ops.floor(delay + TOLERANCE)
    late = delay - delay_samples
    fraction = ops.where(late < TOLERANCE, 0.0, late)  # both parts are at least the tolerance, or 0
    longest = actuator.longest_tick(ops, p)

    def ticks(width: Value) -> Value:
        return -ops.floor(-(width * period / longest * (1.0 - _ROUNDING)))

    before, after = ticks(fraction), ticks(1.0 - fraction)
    h_after = (1.0 - fraction) * period / after
    cut = before > 0.0
    h_before = ops.where(cut, fraction * period / ops.where(cut, before, 1.0), h_after)
    slack = ops.minimum(TOLERANCE * period, 0.25 * ops.minimum(h_before, h_after))
    return Schedule(period, before, after, fraction * period, h_before, h_after, delay_samples,
                    command_bus.latency(ops, p), slack)


def locate(ops: Ops, p: Any, actuator: Actuator, time: Value) -> tuple[Value, ...]:
    """Return the numbers of whole periods and of whole ticks after them in a time [s] from the start, and the rest [s].

    A rest within the slack is 0.
    """
    s = schedule(ops, p, actuator)
    periods = ops.floor((time + s.slack) / s.sample_time)
    within = time - periods * s.sample_time
    late = within + s.slack  # negative by rounding only
    early = ops.both(s.before > 0.0, late < s.arrival)
    first = ops.clip(ops.floor(late / s.h_before), 0.0, s.before - 1.0)
    second = ops.clip(ops.floor((late - s.arrival) / s.h_after), 0.0, s.after - 1.0)
    index = ops.where(early, first, s.before + second)
    rest = within - ops.where(early, first * s.h_before, s.arrival + second * s.h_after)
    return periods, index, ops.where(rest > s.slack, rest, 0.0)
