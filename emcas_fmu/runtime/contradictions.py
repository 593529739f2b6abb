"""Checks of the samples and outputs of a user's actuator against its motion.

The package cannot compute the actuator's measured angle, `limited` and power; it checks invariants that every sound
actuator keeps. A power that is too low for the energy of motor or fin is detected, a power that is too high is not.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from math import degrees
from typing import Any

import numpy as np

from ..actuators import fin_port
from ..actuators.declaration import Actuator, SampleInputs
from ..actuators.external import of_function
from ..actuators.positional import identifier
from ..control import command_bus
from ..errors import EmcasError, location
from ..namespace import Record
from ..ops.located import LocatedFloats, located
from .compiled import Array

_MOTOR = ("motor_voltage", "motor_current")
# Shares of command.limit: the fin's angle at a sample; two commands far from it; distances of commands near it, whose
# references differ if there is no dead band.
_ANGLE, _FAR, _NEAR = -0.9, (0.98, 1.0), (1e-5, 2e-5, 3e-5)
_OFFSET = 100.0  # counts of an encoder
_MEASURED = 0.25  # share of an angle by which its measurement may differ: resolution, delay, a loaded drive line
_LEAST = 0.9  # share of an energy that the supply must at least deliver, less the peak power times one interval


def outputs(actuator: Actuator) -> tuple[str, ...]:
    """Return the names of the outputs for :func:`moving` that an actuator has."""
    names = {v.name for v in actuator.outputs}
    return tuple(name for name in ("fin_angle", "fin_rate", "measured_fin_angle", "saturated", "supply_power", *_MOTOR)
                 if name in names)


class Samples:
    """The samples of a user's actuator at rest, with parameters and inputs by name in SI and a `supply` [V or Pa]."""

    def __init__(self, actuator: Actuator, values: Mapping[str, Any], inputs: Mapping[str, float], supply: float
                 ) -> None:
        assert actuator.source is not None
        self._actuator, self._values, self._ops = actuator, values, LocatedFloats(actuator.source)
        further = {identifier(v.name): inputs[v.name] for v in actuator.further_inputs}
        self._inputs = {**further, "command": 0.0, "supply": supply, "enable": True, "encoder_offset": None}

    def _started(self, **changes: Any) -> tuple[Any, dict[str, Any]]:
        """Return the parameters, with changes by name, and every state at the start."""
        source = self._actuator.source
        p = self._actuator.namespace({name: located(value, source)  # type: ignore[arg-type]
                                      for name, value in {**self._values, **changes}.items()})
        return p, self._actuator.start(self._ops, p)

    def _sample(self, p: Any, start: Mapping[str, Any], **changes: Any) -> tuple[Record, SampleInputs]:
        x = Record(**start)
        position = self._actuator.position(self._ops, p, x)
        return x, SampleInputs(**{**self._inputs, **changes, "position": position})

    def require_all_set(self) -> None:
        """Raise EmcasError for a state of the controllers that no sample sets."""
        p, start = self._started()
        returned = {*self._actuator.sample(self._ops, p, *self._sample(p, start)), *command_bus.STATES}
        for state in (*self._actuator.controller_states, *self._actuator.sampled_states):
            if state.name not in returned:
                raise EmcasError(f"{location(self._actuator.sample)} returns no {state.name}, which nothing else "
                                 "changes: return it, or leave it out of the states")

    def require_offset(self) -> None:
        """Raise EmcasError for encoder counts that do not contain the offset by which homing shifts them."""
        p, start = self._started(**{"encoder.enabled": True})

        def counts(offset: float) -> tuple[float, float]:
            """Return the counts at the start and after a sample."""
            sampled = self._actuator.sampled(self._ops, p, *self._sample(p, start, encoder_offset=offset))
            return self._actuator.start(self._ops, p, None, offset)["counts"], sampled["counts"]

        functions = (self._actuator.initial, self._actuator.sample)
        for function, before, after in zip(functions, counts(0.0), counts(_OFFSET), strict=True):
            if abs(after - before - _OFFSET) > 0.5:
                raise EmcasError(f"{location(function)} returns counts that an encoder_offset of {_OFFSET:g} changes "
                                 f"by {after - before:g}: add encoder_offset, where it is not None, to the counts")

    def follows_beyond(self, share: float) -> bool:
        """Return whether the reference of a fin at command.limit changes if the command is `share` times this limit."""
        limit = self._values["command.limit"]
        p, start = self._started(**{"fin.start_angle": limit})
        at, beyond = (self._actuator.sampled(self._ops, p, *self._sample(p, start, command=command))["reference"]
                      for command in (limit, share * limit))
        return bool(at != beyond)

    def problems(self) -> Iterator[str]:
        """Yield a message if a sample ignores the command, or limits the reference without setting `limited`."""
        limit = self._values["command.limit"]
        for side in (1.0, -1.0):
            p, start = self._started(**{"fin.start_angle": side * _ANGLE * limit})
            shares = (*(_ANGLE + near for near in _NEAR), *_FAR, -1.0)  # the last is in the other direction
            samples = [self._actuator.sampled(self._ops, p, *self._sample(p, start, command=side * share * limit))
                       for share in shares]
            near, far = samples[:len(_NEAR)], samples[len(_NEAR):-1]
            if all(each == samples[0] for each in samples):
                yield f"{location(self._actuator.sample)} returns the same for every inputs.command; use this input"
                return
            references = {each["reference"] for each in near}
            if len(references) == 3 and far[0]["reference"] == far[1]["reference"] and not far[0]["limited"] > 0.0:
                yield (f"{location(self._actuator.sample)} returns limited = {far[0]['limited']:g}, but the reference "
                       f"is limited to {far[0]['reference']:.4g}; return limited = 1 at every limit")
                return


def at_rest(actuator: Actuator, shown: Mapping[str, Any]) -> Iterator[str]:
    """Yield a message if the supply power is below 0 in the outputs `shown` of a disabled actuator at rest."""
    power = 0.0 if actuator.supply is None else shown["supply_power"]
    if power < 0.0:
        yield (f"{of_function(actuator, 'outputs')} returns supply_power = {power:.3g} W at rest while disabled; "
               "return the power that the actuator consumes, negative only while it returns power")


def moving(actuator: Actuator, values: Mapping[str, Any], responses: Mapping[str, Array], interval: float,
           balanced: bool) -> Iterator[str]:
    """Yield messages about outputs that contradict the motion of a fin from rest, without load.

    `responses` are :func:`outputs` [runs, points], `interval` [s] apart; the first run is checked. Its power is checked
    if energy is `balanced`: as far as is known, only fin and motor store energy.
    """
    measured, angle = responses["measured_fin_angle"][0, -1], responses["fin_angle"][0, -1]
    if not values.get("homing.required") and abs(measured - angle) > _MEASURED * abs(angle):
        yield (f"{actuator.source}: measured_fin_angle is {degrees(measured):.4g} deg where fin_angle is "
               f"{degrees(angle):.4g} deg; sample() must return the fin's angle in rad, with the sign of fin_angle")
    if actuator.supply is None or not balanced:
        return
    def integrated(power: Array) -> Array:
        """Return the energy [J] until each point."""
        return np.concatenate(([0.0], np.cumsum(0.5 * interval * (power[1:] + power[:-1]))))

    power, electric = responses["supply_power"][0], actuator.supply.input.unit == "V"
    supplied = integrated(power)
    # Towards the centre a spring may drive the fin; gas and oil in chambers store energy.
    driven = np.logical_and(electric, responses["fin_angle"][0] >= responses["fin_angle"][0, 0])
    inertia = fin_port.hinge_inertia(actuator.namespace(values))
    needs = {"the fin's motion has": 0.5 * inertia * np.where(driven, responses["fin_rate"][0], 0.0)**2}
    if electric and all(name in responses for name in _MOTOR):
        needs["the motor consumes"] = integrated(np.prod([responses[name][0] for name in _MOTOR], axis=0))
    for words, energy in needs.items():
        lacking = _LEAST * energy - supplied - interval * np.max(np.abs(power))
        if lacking[at := int(np.argmax(lacking))] > 0.0:
            yield (f"{of_function(actuator, 'outputs')} returns a supply_power whose energy is {supplied[at]:.3g} J "
                   f"after {at * interval:.3g} s, but {words} {energy[at]:.3g} J; return supply times supply current")
            return
