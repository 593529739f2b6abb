"""The built-in test: failures that an actuator detects by its measurements, without knowledge of the faults.

A monitor trips when its condition has held without interruption for ``monitor.persistence``, and clears when it has not
held for the same time. The monitors are reset while the actuator does not follow its command, because it is disabled or
homing. The measured angle is compared with a model of the response to the command,

    dm/dt = clip(K (command - m), +-rate)

with the largest rate monitor.rate, and as K the gain of the position loop in a cascade, otherwise monitor.response, so
that neither the lag v/K of a sound loop at a rate v nor the duration of a large step trips the monitor.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import reduce
from math import radians
from typing import Any, NamedTuple

from ..actuators import capabilities, fin_port
from ..actuators.declaration import Actuator
from ..ops.base import Ops, Value
from ..physics import drive
from ..variables import Variable, in_group, tunable
from .status import DEGRADED, FAILED, OPERATIONAL

_SLACK = 1e-6  # samples; rounding does not add a sample to a whole number of them


class Watched(NamedTuple):
    """Inputs of the monitors at a sample: `command` [rad] as received, `measured` angle [rad], the drive's `reference`,
    motor `current` [A], `supply` [V or Pa], and whether the monitors are `enabled`.

    `before` and `modelled` are the measured angle and that of the model [rad] at the sample before.
    """

    command: Value
    measured: Value
    before: Value
    modelled: Value
    reference: Value
    current: Value
    supply: Value
    enabled: Value


@dataclass(frozen=True)
class Monitor:
    """A monitored condition: its description, when it holds, its parameters, and the capabilities that it needs.

    `holds(ops, p, w, angle)` uses the inputs `w` and the modelled `angle` [rad] of this sample.
    """

    name: str
    description: str
    holds: Callable[[Ops, Any, Watched, Value], Value]
    parameters: tuple[Variable, ...] = ()
    needs: tuple[str, ...] = ()


def _stalled(ops: Ops, p: Any, w: Watched, angle: Value) -> Value:
    rate = ops.fabs(w.measured - w.before) / p.controller.sample_time
    pushing = ops.fabs(w.reference) >= p.monitor.stall_share * p.drive.reference_limit
    return ops.both(pushing, rate < p.monitor.stall_rate)


_PERSISTENCE = tunable("persistence", "s", 0.0, 100.0, "time a condition must hold for its monitor to trip or to clear")
_RESPONSE = tunable("response", "1/s", 1e-3, 1e5, "rate at which the model of the response reduces an error")
# In the order of their bits in the built-in test's word, the lowest first.
MONITORS = (
    Monitor("tracking", "the measured angle does not follow the command",
            lambda ops, p, w, angle: ops.fabs(angle - w.measured) > p.monitor.tracking_limit, (
                tunable("tracking_limit", "rad", 0.0, radians(180.0),
                        "difference of modelled and measured angle beyond which tracking trips"),
                tunable("rate", "rad/s", 1e-3, 1e3, "largest fin rate of the model of the response"))),
    Monitor("stall", "a large reference moves nothing", _stalled, (
        tunable("stall_share", "1", 0.0, 1.0, "share of drive.reference_limit from which a fin at rest is stalled"),
        tunable("stall_rate", "rad/s", 0.0, 100.0, "measured rate below which the fin counts as at rest")),
        (capabilities.REFERENCE_LIMIT,)),
    # The current follows a reference that is older by the transport delay: persistence must exceed this delay.
    Monitor("drive", "the current does not follow its reference", lambda ops, p, w, angle: ops.fabs(
        drive.current_reference(ops, p, w.reference) - w.current) > p.monitor.current_limit, (
            tunable("current_limit", "A", 0.0, 1e4,
                    "difference of current reference and current beyond which drive trips"),),
        (capabilities.MOTOR_CURRENT, capabilities.CURRENT_LOOP)),
    Monitor("supply", "the bus voltage is too low", lambda ops, p, w, angle: w.supply < p.monitor.minimum_supply, (
        tunable("minimum_supply", "V", 0.0, 1e3, "bus voltage below which the supply is too low"),),
        (capabilities.SUPPLY_VOLTAGE,)),
    Monitor("command", "the command is beyond command.limit",
            lambda ops, p, w, angle: ops.fabs(w.command) > p.command.limit),
    Monitor("pressure", "the pressure of the line is too low",
            lambda ops, p, w, angle: w.supply < p.monitor.minimum_pressure, (
                replace(tunable("minimum_pressure", "Pa", 0.0, 1e9,
                                "pressure of the line below which it is too low"), start=0.0),),
            (capabilities.SUPPLY_PRESSURE,)),
)


def possible(actuator: Actuator) -> tuple[Monitor, ...]:
    """Return the monitors an actuator can have."""
    return tuple(monitor for monitor in MONITORS if actuator.provides.issuperset(monitor.needs))


def parameters(actuator: Actuator) -> tuple[Variable, ...]:
    """Return the parameters of an actuator's monitors."""
    response = () if capabilities.CASCADE in actuator.provides else (_RESPONSE,)
    return in_group("monitor", _PERSISTENCE, *response,
                    *(v for monitor in possible(actuator) for v in monitor.parameters))


def modelled(ops: Ops, p: Any, response: Value, w: Watched) -> Value:
    """Return the angle [rad] of the model with a `response` [1/s]; without monitoring, the measured angle."""
    period = p.controller.sample_time
    share = ops.minimum(response * period, 1.0)
    change = share * (fin_port.clipped_command(ops, p, w.command) - w.modelled)
    most = p.monitor.rate * period
    return ops.where(w.enabled, w.modelled + ops.clip(change, -most, most), w.measured)


def response(p: Any, actuator: Actuator) -> Value:
    """Return K [1/s] of the model of the response: the position loop's gain in a cascade, or monitor.response."""
    return p.controller.position.kp if capabilities.CASCADE in actuator.provides else p.monitor.response


def judged(ops: Ops, p: Any, watched: tuple[Monitor, ...], angle: Value, counters: Sequence[Value],
           tripped: Sequence[Value], w: Watched) -> tuple[tuple[Value, ...], tuple[Value, ...]]:
    """Return counters and flags (1 tripped, 0 clear) of the monitors after a sample, with the modelled `angle` [rad].

    A counter is the number of successive samples in which the condition has differed from the flag.
    """
    most = p.monitor.persistence / p.controller.sample_time - _SLACK
    most = ops.maximum(-ops.floor(-most), 1.0)
    counted, flags = [], []
    for monitor, counter, flag in zip(watched, counters, tripped, strict=True):
        holds = ops.where(monitor.holds(ops, p, w, angle), 1.0, 0.0)
        now = ops.where(ops.equal(holds, flag), 0.0, counter + 1.0)
        counted.append(ops.where(ops.both(w.enabled, now < most), now, 0.0))
        flags.append(ops.where(w.enabled, ops.where(now >= most, holds, flag), 0.0))
    return tuple(counted), tuple(flags)


def word(watched: tuple[Monitor, ...], tripped: Sequence[Value]) -> Value:
    """Return the word with a bit for each tripped monitor, the first in MONITORS as the lowest bit."""
    bits = (float(2**MONITORS.index(monitor)) for monitor in watched)
    return reduce(lambda total, pair: total + pair[0] * pair[1], zip(bits, tripped, strict=True), 0.0)


def status(ops: Ops, tripped: Sequence[Value]) -> Value:
    """Return the status of an enabled actuator: failed if it does not track, degraded if another monitor tripped."""
    any_tripped: Value = reduce(lambda any_, flag: ops.either(any_, flag > 0.0), tripped, False)
    return ops.where(tripped[0] > 0.0, FAILED, ops.where(any_tripped, DEGRADED, OPERATIONAL))
