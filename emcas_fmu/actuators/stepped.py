"""The step and the outputs of an actuator that declares derivatives and discontinuities instead of a step."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import replace
from functools import wraps
from inspect import signature
from typing import TYPE_CHECKING, Any

from ..errors import EmcasError, hint
from ..namespace import Record
from ..ops.base import Ops, Value
from ..physics.loads import LOADS
from ..steppers.discontinuities import Discontinuity, Stop, System
from . import fin_port
from .lists import check_arguments
from .positional import complete, identifiers
from .state import PlantInputs, State

if TYPE_CHECKING:
    from .declaration import Actuator

BEGUN = "begun"
"""State of an actuator whose initial values use inputs: 0 before the first step, then 1."""
_INPUTS = ("reference", *LOADS, "supply", "enabled", "rated_current_limit", "command", "sampled_reference",
           "measured_fin_angle", "limited")
_FIN_STOP = Stop("fin_angle", "fin_rate", "fin.stop_angle")


def fields(actuator: Actuator) -> dict[str, Any]:
    """Return the fields to replace: step, derivatives without discontinuities, and outputs completed by the port's.

    If initial values use inputs, all functions that read states are replaced. Raises EmcasError for an actuator without
    derivatives, and for a discontinuity whose state, parameter, function or name does not fit the actuator.
    """
    if actuator.derivatives is None:
        raise EmcasError(f"actuator {actuator.name}: has neither a step nor derivatives; declare derivatives")
    names, derivatives, output_values = [s.name for s in actuator.states], actuator.derivatives, actuator.output_values
    stops = [] if {_FIN_STOP.angle, _FIN_STOP.rate} - set(names) or any(
        isinstance(each, Stop) and each.angle == _FIN_STOP.angle for each in actuator.discontinuities) else [_FIN_STOP]
    try:
        for each in actuator.discontinuities:
            _check_values(each, {v.name for v in actuator.parameters})
        system = System(lambda ops, p, x, u: complete(derivatives, derivatives(ops, p, x, u), names),
                        (*actuator.discontinuities, *stops), names)
    except EmcasError as error:
        raise EmcasError(f"actuator {actuator.name}: {error}") from error
    if wrong := [name for name in system.names if not name.isidentifier()]:
        raise EmcasError(f"actuator {actuator.name}: discontinuity {wrong[0]!r}: its name is a Python identifier, such "
                         "as friction")
    used = {*names, *_INPUTS, *(s.name for s in actuator.sampled_states), *identifiers(actuator.further_inputs)}
    if twice := [name for name in system.names if name in used or system.names.count(name) > 1]:
        raise EmcasError(f"actuator {actuator.name}: {twice[0]} is the name of two things; give the discontinuity "
                         "another name than states and inputs have")

    @wraps(output_values)
    def outputs(ops: Ops, p: Any, x: Record, u: PlantInputs) -> Mapping[str, Value]:
        now, at_limit = system.present(ops, p, x, u)
        return fin_port.completed(ops, p, x, u, ops.either(u.limited > 0.0, at_limit), output_values(ops, p, x, now))

    @wraps(derivatives)
    def smooth(ops: Ops, p: Any, x: Record, u: Record) -> Mapping[str, Value]:
        return system.smooth(ops, p, x, u)

    replaced = {"step": system.step, "derivatives": smooth, "output_values": outputs, "discontinuities": ()}
    return replaced | (_begun(actuator, replaced) if len(signature(actuator.initial).parameters) == 4 else {})


def _check_values(each: Discontinuity, parameters: Collection[str]) -> None:
    """Raise EmcasError if a torque, gap, value or limit names no parameter or has other arguments than ops, p, x, u."""
    owner = f"{type(each).__name__} {each.angle if isinstance(each, Stop) else each.name}"
    for name, value in vars(each).items():
        if callable(value):
            check_arguments(f"{owner}, {name}", value, "ops, p, x, u")
        elif isinstance(value, str) and name not in ("name", "rate", "angle") and value not in parameters:
            raise EmcasError(f"{owner}: {name} {value!r} is not a parameter{hint(value, parameters)}")


def _begun(actuator: Actuator, replaced: Mapping[str, Any]) -> dict[str, Any]:
    """Return the fields of an actuator whose initial values use the inputs of its first sample and step."""
    initial, sample = actuator.initial, actuator.sample
    names = [s.name for s in (*actuator.states, *actuator.controller_states, *actuator.sampled_states)]

    def begun(ops: Ops, p: Any, x: Record, u: Record) -> Record:
        """Return the states `x`; before the first step, the initial states under the inputs `u`."""
        at = Record(fin_angle=p.fin.start_angle, encoder_offset=None)
        start = {**dict.fromkeys(names, 0.0), "fin_angle": at.fin_angle,
                 **complete(initial, initial(ops, p, at, u), (), names)}
        fresh = ops.equal(x.begun, 0.0)
        states = {name: ops.where(fresh, start[name], value) for name, value in vars(x).items() if name in start}
        return x.replace(**states, **{BEGUN: 1.0})

    def from_start(function: Any) -> Any:
        """Return the function of (ops, p, x, u) for the states that `begun` returns."""
        return wraps(function)(lambda ops, p, x, u: function(ops, p, begun(ops, p, x, u), u))

    switched = replace(replaced["step"].system, begun=lambda ops, p, x, u, h: (begun(ops, p, x, u), h))
    rates = replaced["derivatives"]
    return {
        "states": (*actuator.states, State(BEGUN)), "begun": begun, "step": switched.step(replaced["step"].as_built),
        "initial": lambda ops, p, start: {},
        "derivatives": wraps(rates)(lambda ops, p, x, u: {**rates(ops, p, x, u), BEGUN: 0.0}),
        "sample": from_start(sample), "output_values": from_start(replaced["output_values"])}
