"""What samples and outputs of a user's actuator return for the port, where it contradicts the motion.

Measured angle, `limited` and power have no equation of the package: these are invariants, which no sound actuator
breaks. A wrong power is seen if it is less than what the motor gets, or the fin has; one that is too high is not.
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
from ..control import command as bus
from ..errors import EmcasError, location
from ..namespace import Record
from ..ops.located import LocatedFloats, located
from .compiled import Array

_MOTOR = ("motor_voltage", "motor_current")
# Where the fin is when a command far away is sampled, and two of these, as shares of its limit; of it, errors in which
# a reference that has no dead band differs.
_BESIDE, _FAR, _NEAR = -0.9, (0.98, 1.0), (1e-5, 2e-5, 3e-5)
_OFFSET = 100.0  # [counts] of an encoder
_MEASURED = 0.25  # share of an angle by which its measurement may be off: resolution, delay, a loaded drive line
_LEAST = 0.9  # share of an energy that the power adds up to at least, and a point's more: points are 1 ms apart


def outputs(actuator: Actuator) -> tuple[str, ...]:
    """Return the names of the outputs that :func:`moving` needs, as far as an actuator has them."""
    names = {v.name for v in actuator.outputs}
    return tuple(name for name in ("fin_angle", "fin_rate", "measured_fin_angle", "saturated", "supply_power", *_MOTOR)
                 if name in names)


class Sampled:
    """The samples of a user's actuator at rest, with parameters and inputs by name in SI; `supply` is one of these."""

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
        returned = {*self._actuator.sample(self._ops, p, *self._sample(p, start)), *bus.STATES}
        for state in (*self._actuator.controller_states, *self._actuator.sampled_states):
            if state.name not in returned:
                raise EmcasError(f"{location(self._actuator.sample)} returns no {state.name}, which nothing else "
                                 "changes: return it, or leave it out of the states")

    def require_offset(self) -> None:
        """Raise EmcasError for counts of an encoder to which no offset is added, by which homing shifts them."""
        p, start = self._started(**{"encoder.enabled": True})

        def counts(offset: float) -> tuple[float, float]:
            """Return the counts of a start and of a sample."""
            sampled = self._actuator.sampled(self._ops, p, *self._sample(p, start, encoder_offset=offset))
            return self._actuator.start(self._ops, p, None, offset)["counts"], sampled["counts"]

        functions = (self._actuator.initial, self._actuator.sample)
        for function, before, after in zip(functions, counts(0.0), counts(_OFFSET), strict=True):
            if abs(after - before - _OFFSET) > 0.5:
                raise EmcasError(f"{location(function)} returns counts that an encoder_offset of {_OFFSET:g} changes "
                                 f"by {after - before:g}: add encoder_offset, where it is not None, to the counts")

    def follows_beyond(self, share: float) -> bool:
        """Return whether the reference at command.limit follows the command to a `share` of it beyond."""
        limit = self._values["command.limit"]
        p, start = self._started(**{"fin.start_angle": limit})
        at, beyond = (self._actuator.sampled(self._ops, p, *self._sample(p, start, command=command))["reference"]
                      for command in (limit, share * limit))
        return bool(at != beyond)

    def unsaid(self) -> Iterator[str]:
        """Yield in words that a sample ignores its command; or clips its reference, which differs near the angle, and
        is not `limited`.
        """
        limit = self._values["command.limit"]
        for side in (1.0, -1.0):
            p, start = self._started(**{"fin.start_angle": side * _BESIDE * limit})
            shares = (*(_BESIDE + near for near in _NEAR), *_FAR, -1.0)  # the last is on the other side
            samples = [self._actuator.sampled(self._ops, p, *self._sample(p, start, command=side * share * limit))
                       for share in shares]
            near, far = samples[:len(_NEAR)], samples[len(_NEAR):-1]
            if all(each == samples[0] for each in samples):
                yield f"{location(self._actuator.sample)} returns the same for every inputs.command; use it there"
                return
            references = {each["reference"] for each in near}
            if len(references) == 3 and far[0]["reference"] == far[1]["reference"] and not far[0]["limited"] > 0.0:
                yield (f"{location(self._actuator.sample)} returns limited = {far[0]['limited']:g} where the reference "
                       f"{far[0]['reference']:.4g} follows the command no further; return limited = 1 at every limit")
                return


def at_rest(actuator: Actuator, shown: Mapping[str, Any]) -> Iterator[str]:
    """Yield in words that power comes from an actuator that is disabled and at rest, by its outputs."""
    power = 0.0 if actuator.supply is None else shown["supply_power"]
    if power < 0.0:
        yield (f"{of_function(actuator, 'outputs')} returns supply_power = {power:.3g} W at rest while disabled; it is "
               "what the actuator draws, negative only while it returns power")


def moving(actuator: Actuator, values: Mapping[str, Any], moved: Mapping[str, Array], interval: float, balanced: bool
           ) -> Iterator[str]:
    """Yield in words what contradicts the motion of a fin from rest, without load.

    `moved` are :func:`outputs` [runs, points], `interval` [s] apart. Power is judged if the line's energy is
    `balanced` by that of fin and motor: nothing else is known to store energy.
    """
    measured, angle = moved["measured_fin_angle"][0, -1], moved["fin_angle"][0, -1]
    if not values.get("homing.required") and abs(measured - angle) > _MEASURED * abs(angle):
        yield (f"{actuator.source}: measured_fin_angle is {degrees(measured):.4g} deg where fin_angle is "
               f"{degrees(angle):.4g} deg; sample() returns it in rad, of the fin, in the sense of fin_angle")
    if actuator.supply is None or not balanced:
        return
    def added_up(power: Array) -> Array:
        """Return the energy [J] until each point."""
        return np.concatenate(([0.0], np.cumsum(0.5 * interval * (power[1:] + power[:-1]))))

    power, electric = moved["supply_power"][0], actuator.supply.input.unit == "V"
    drawn = added_up(power)
    # Inwards a centring spring may drive the fin, and gas and oil in chambers store energy.
    own = np.logical_and(electric, moved["fin_angle"][0] >= moved["fin_angle"][0, 0])
    inertia = fin_port.hinge_inertia(actuator.namespace(values))
    needs = {"the fin moves with": 0.5 * inertia * np.where(own, moved["fin_rate"][0], 0.0)**2}
    if electric and all(name in moved for name in _MOTOR):
        needs["the motor gets"] = added_up(np.prod([moved[name][0] for name in _MOTOR], axis=0))
    for words, energy in needs.items():
        less = _LEAST * energy - drawn - interval * np.max(np.abs(power))
        if less[at := int(np.argmax(less))] > 0.0:
            yield (f"{of_function(actuator, 'outputs')} returns a supply_power that adds up to {drawn[at]:.3g} J in "
                   f"{at * interval:.3g} s, in which {words} {energy[at]:.3g} J; it is supply times the current drawn")
            return
