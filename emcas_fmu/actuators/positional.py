"""The equations of an actuator as functions of positional arguments, for tracing: names become positions here."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from math import isnan
from typing import TYPE_CHECKING, Any

from ..errors import EmcasError, hint, location
from ..namespace import Record
from ..ops.base import Ops, Value
from ..ops.located import LocatedFloat
from ..physics.loads import LOADS, motion_loads
from ..variables import Variable
from . import fin_port
from .state import PlantInputs, SampleInputs

if TYPE_CHECKING:
    from .declaration import Actuator, Parameters

Function = tuple[str, tuple[str, ...], Callable[..., tuple[Value, ...]]]
"""A name, the names of the arguments after ops and p, and the function."""


def identifier(name: str) -> str:
    """Return a variable's name as an identifier: ``acceleration.x`` becomes acceleration_x."""
    return re.sub(r"\W+", "_", name)


def identifiers(variables: Iterable[Variable]) -> tuple[str, ...]:
    """Return the names of variables as identifiers."""
    return tuple(identifier(v.name) for v in variables)


def functions(actuator: Actuator) -> tuple[Function, ...]:
    """Return the five functions of an actuator, which return values in SI.

    initial() returns states, controller states, measured angle and sampled states; sample() the reference, controller
    states, measured angle, whether a limit is active, and sampled states; motion_loads() the fields of MotionLoads;
    step() the states and the time [s] that it has advanced; outputs() every output. The argument `active` is the
    reference that has arrived at the drive, `reference` that of the last sample.
    """
    plant, controllers, sampled = (tuple(s.name for s in states) for states in (
        actuator.states, actuator.controller_states, actuator.sampled_states))
    step_inputs = (*LOADS, "supply", "enable", *identifiers(actuator.acting_inputs))

    def acting(sampled_values: Iterable[Value], reference: Value, values: Iterable[Value]) -> dict[str, Value]:
        """Return the plant inputs by name."""
        names = (*sampled, "reference", *LOADS, "supply", "enabled", *identifiers(actuator.acting_inputs))
        return {**dict(zip(names, (*sampled_values, reference, *values), strict=True)), "rated_current_limit": None}

    def initial(ops: Ops, p: Parameters) -> tuple[Value, ...]:
        start = actuator.start(ops, p)
        return tuple(start[name] for name in (*plant, *controllers, "measured_fin_angle", *sampled))

    def sample(ops: Ops, p: Parameters, *arguments: Value) -> tuple[Value, ...]:
        names = (*plant, *controllers, *sampled)
        x = Record(**dict(zip(names, arguments, strict=False)))
        command, supply, enable, *further = arguments[len(names):]
        inputs = SampleInputs(command=command, supply=supply, enable=enable,
                              position=actuator.position(ops, p, x),
                              **dict(zip(identifiers(actuator.further_inputs), further, strict=True)))
        values = actuator.commanded(ops, p, x, inputs)
        return tuple(values[name] for name in ("reference", *controllers, "measured_fin_angle", "limited", *sampled))

    def step(ops: Ops, p: Parameters, *arguments: Value) -> tuple[Value, ...]:
        x = Record(**dict(zip(plant, arguments, strict=False)))
        split = len(plant) + len(sampled)
        reference, *values, h = arguments[split:]
        u = PlantInputs(**acting(arguments[len(plant):split], reference, values))
        returned = actuator.step(ops, p, x, u, h)
        if not (isinstance(returned, tuple) and len(returned) == 2):
            raise EmcasError(f"{location(actuator.step)} returns {type(returned).__name__}; return a mapping of states "
                             "and the time [s] that the step has advanced, as in return {...}, h")
        moved, used = returned
        moved = {**vars(x), **complete(actuator.step, moved, (), plant)}
        complete(actuator.step, {"the time of the step": used}, ("the time of the step",))
        return (*(moved[name] for name in plant), used)

    def outputs(ops: Ops, p: Parameters, *arguments: Value) -> tuple[Value, ...]:
        x = Record(**dict(zip(plant, arguments, strict=False)))
        reference, sampled_reference, measured, limited, *rest = arguments[len(plant):]
        sampled_values, (command, *values) = rest[:len(sampled)], rest[len(sampled):]
        u = PlantInputs(**acting(sampled_values, reference, values), command=command,
                        sampled_reference=sampled_reference, measured_fin_angle=measured, limited=limited)
        names = tuple(v.name for v in actuator.outputs)
        shown = complete(actuator.output_values, actuator.output_values(ops, p, x, u), names)
        return tuple(shown[name] for name in names)

    return (
        ("initial", (), initial),
        ("sample", (*plant, *controllers, *sampled, "command", "supply", "enable",
                    *identifiers(actuator.further_inputs)), sample),
        ("motion_loads", identifiers(fin_port.VEHICLE_MOTION), motion_loads),
        ("step", (*plant, *sampled, "active", *step_inputs, "h"), step),
        ("outputs", (*plant, "active", "reference", "measured", "limited", *sampled, "command", *step_inputs), outputs),
    )


def complete(function: Callable[..., Any], values: Any, names: Iterable[str], optional: Iterable[str] = ()
             ) -> Mapping[str, Value]:
    """Return `values`, the result of `function`.

    Raises EmcasError with the function's location unless they are a mapping of names to numbers that has all `names`
    and no others than these and the `optional` ones.
    """
    if not isinstance(values, Mapping):
        raise EmcasError(f"{location(function)} returns {type(values).__name__}; return a mapping of names to values")
    needed = list(names)
    known = {*needed, *optional}
    missing = [name for name in needed if name not in values]
    unknown = [str(name) for name in values if name not in known]
    returned = f"returns {', '.join(unknown)}, which is not declared{hint(unknown[0], known)}" if unknown else ""
    if missing:
        raise EmcasError(f"{location(function)} returns no {', '.join(missing)}{returned and f'; it {returned}'}")
    if unknown:
        raise EmcasError(f"{location(function)} {returned}; declared are {', '.join(sorted(known))}")
    for name, value in values.items():
        is_nan = isinstance(value, float) and isnan(value) and not isinstance(value, LocatedFloat)
        if value is None or isinstance(value, (str, Sequence, Mapping)) or is_nan:
            raise EmcasError(f"{location(function)} returns {name} = {value!r}; return a number")
    return values
