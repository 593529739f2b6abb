"""Filters of the loops of motor and screw: an observer of the motor's speed, and a notch in the drive's reference.

The controllers, including their load observer, use the observed speed instead of the difference of counts. The notch
is behind the controllers and also filters the feed-forward; the anti-windup of the controllers uses the reference
before the notch. The notch is at rest while the drive is disabled. :mod:`emcas_fmu.control.filters` has the equations.

filters.speed_bandwidth = 0 removes the observer, filters.notch_frequency = 0 the notch.
"""

from __future__ import annotations

from dataclasses import replace
from math import pi
from typing import Any

from ..actuators import capabilities
from ..actuators.declaration import Actuator, SampleInputs, State, Values
from ..control import filters
from ..control.trajectory import Ahead, Motion
from ..namespace import Record
from ..ops.base import Ops, Value
from ..rules import at_most, rule, when
from ..variables import in_group, parameter
from .declaration import Extension

PARAMETERS = in_group(
    "filters",
    parameter("speed_bandwidth", "1/s", 0.0, 1e5, "bandwidth of the observer of the motor's speed (0: none, the speed "
              "is the difference of counts)"),
    parameter("notch_frequency", "rad/s", 0.0, 6e4, "frequency of the notch in the drive's reference (0: none)",
              quantity="AngularFrequency"),
    parameter("notch_zero_damping", "1", 0.0, 10.0, "damping of the notch's zeros"),
    parameter("notch_pole_damping", "1", 1e-3, 10.0, "damping of the notch's poles"),
)
_OBSERVER = (State("observed_speed", "rad/s", "motor speed as its observer estimates it"),
             State("observed_load", "N.m", "load at the motor as the observer of the speed estimates it"))
_RATE = State("target_rate", "rad/s", "rate of the motion that the controllers followed at the last sample")
_NOTCH = tuple(map(State, filters.Notched._fields))


def extend(actuator: Actuator) -> Actuator:
    """Return the actuator whose controllers have the filters."""
    observing = replace(actuator, controller_states=(*actuator.controller_states, *_OBSERVER))

    def sample(ops: Ops, p: Any, x: Record, inputs: SampleInputs) -> Values:
        rate = 0.0
        if inputs.ahead is not None:
            ahead, rate = filters.rate_led(ops, actuator.equation_parameters(ops, p), x, inputs.command, inputs.ahead)
            inputs = inputs.replace(ahead=ahead)
        out = observing.sampled(ops, p, x, inputs.replace(observer=filters.observed))
        reference, states = filters.notched(ops, p, x, out["reference"])
        kept = {name: ops.where(inputs.enable, value, 0.0)
                for name, value in {"reference": reference, _RATE.name: rate, **states._asdict()}.items()}
        return {**out, **kept}

    def feed_forward(ops: Ops, p: Any, motion: Motion, memory: Value) -> tuple[Ahead, Value, Value]:
        """Return the actuator's feed-forward; the reference acts later by the notch's delay."""
        ahead, memory, time = actuator.feed_forward(ops, p, motion, memory)  # type: ignore[misc]  # not None
        return ahead, memory, time + filters.delay(ops, p)

    return replace(observing, sample=sample, controller_states=(*observing.controller_states, _RATE, *_NOTCH),
                   feed_forward=None if actuator.feed_forward is None else feed_forward)


@rule("filters.notch_frequency = %.6g rad/s must be at least a hundredth below half the sample rate, "
      "pi/controller.sample_time = %.6g rad/s")
def _sampled(ops: Ops, p: Any, _: Value) -> tuple[Value, ...]:
    highest = pi / p.controller.sample_time
    return when(ops, p.filters.notch_frequency > 0.99 * highest), p.filters.notch_frequency, highest


_LOWERS = at_most("filters.notch_zero_damping", "filters.notch_pole_damping", otherwise=", or the notch is a peak")
EXTENSION = Extension(
    "filters", "observer of the speed, and notch", extend,
    # The shared loops of motor and screw, which read `observer` of a sample's inputs.
    needs=(capabilities.CASCADE, capabilities.SCREW_EQUATIONS, capabilities.ENCODER, capabilities.REFERENCE_LIMIT),
    parameters=lambda actuator: PARAMETERS, rules=lambda actuator: (_sampled, _LOWERS),
    references=("emcas_fmu.reference.plant",))
