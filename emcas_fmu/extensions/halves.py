"""Halves of an actuator for hardware in the loop: the controllers alone, or the plant alone.

    controllers    command, enable, measured states              ->  reference, measured fin angle
    plant          reference, enable, supply, loads, motion      ->  measured states, and the other outputs

A signal between the halves has the same name in both. The encoders and the bus of the command belong to the
controllers, the drive with its transport delay to the plant, which reads the reference at its samples. States that
samples set and steps use, such as those of the extensions homing and faults, are signals from controllers to plant.

Both halves have the parameters of the whole, and sample every controller.sample_time from the start. If the controllers
step first, the plant then reads their reference, and the communication step is the sample time or an integer part of
it, the trajectory equals that of the whole to the bit.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any

from ..actuators import capabilities, fin_port
from ..actuators.declaration import Actuator, PlantInputs, SampleInputs, State, Values
from ..actuators.positional import identifier
from ..namespace import Record
from ..ops.base import Ops, Value
from ..variables import Terminal, Variable, real_input, real_output
from .declaration import Extension

_IDLE = State("idle", description="unused state of the controllers alone: a core needs at least one")


def measured(actuator: Actuator) -> tuple[str, ...]:
    """Return the names of the states that an actuator's samples read, those of position first."""
    read = (s.name for s in actuator.states) if actuator.controllers_read is None else actuator.controllers_read
    position = (actuator.encoder[0], *(() if actuator.fin_side is None else actuator.fin_side[:1]))
    return tuple(name for name in dict.fromkeys((*position, *read)) if name != "supply")


def _output(state: State, nominal: float = 1.0) -> Variable:
    return real_output(state.name, state.unit or "1", state.description or f"state {state.name}", nominal)


def _input(v: Variable, start: float = 0.0) -> Variable:
    return real_input(v.name, v.unit, v.description, minimum=v.minimum, maximum=v.maximum, nominal=v.nominal,
                      start=start)


def _only(values: Mapping[str, Value], names: Iterable[str]) -> Values:
    return {name: values[name] for name in names if name in values}


class _Signals:
    """Signals between the halves, as outputs: reference of the last sample, measured states, sampled states."""

    def __init__(self, actuator: Actuator) -> None:
        outputs, states = {v.name: v for v in actuator.limited_outputs}, {s.name: s for s in actuator.states}
        self.reference = outputs.get(actuator.reference_output, real_output(
            actuator.reference_output, "1", "reference of the controllers to the drive", 1.0))
        self.measured = {name: outputs.get(name, _output(states[name])) for name in measured(actuator)}
        self.sampled = {s.name: _output(s) for s in actuator.sampled_states}
        self.terminal = Terminal("coupling", "between controllers and plant",
                                 (self.reference.name, *self.measured, *self.sampled))


def _controller(actuator: Actuator) -> Actuator:
    """Return the controllers alone."""
    signals, supply = _Signals(actuator), actuator.supply
    kept = [s.name for s in (*actuator.controller_states, *actuator.sampled_states)]
    line = () if supply is None else (supply.input,)
    unused = () if actuator.controllers_read is None or "supply" in actuator.controllers_read else line

    def initial(ops: Ops, p: Any, start: Record) -> Values:
        return _only(actuator.start(ops, p, start.fin_angle, start.encoder_offset), ("measured_fin_angle", *kept))

    def sample(ops: Ops, p: Any, x: Record, inputs: SampleInputs) -> Values:
        read = {name: getattr(inputs, name) for name in signals.measured}
        others = {s.name: 0.0 for s in actuator.states}  # read by some actuators, without effect on the result
        x = Record(**{**others, **vars(x), **read})
        level = {} if supply is None else {"supply": getattr(inputs, identifier(supply.input.name))}
        return actuator.sampled(ops, p, x, inputs.replace(**level, position=actuator.position(ops, p, x)))

    def output_values(ops: Ops, p: Any, x: Record, u: PlantInputs) -> Values:
        return {signals.reference.name: u.sampled_reference, "measured_fin_angle": u.measured_fin_angle,
                "saturated": u.limited > 0.0, **{name: getattr(u, name) for name in signals.sampled}}

    outputs = fin_port.described(
        {"saturated": "a limit of the controllers was active at the last sample"},
        tuple(v for v in actuator.outputs if v.name in (fin_port.MEASURED_FIN_ANGLE.name, fin_port.SATURATED.name)))
    return replace(
        actuator, states=(_IDLE,), encoder=(_IDLE.name, _IDLE.name), fin_side=None, supply=None, initial=initial,
        sample=sample, step=lambda ops, p, x, u, h: ({}, h), derivatives=None, output_values=output_values,
        outputs=(signals.reference, *outputs, *signals.sampled.values()), provides=frozenset(),
        further_inputs=(*actuator.further_inputs, *line, *map(_input, signals.measured.values())),
        hidden=frozenset(v.name for v in (fin_port.AERO_TORQUE, *fin_port.VEHICLE_MOTION, *unused)),
        terminals=(signals.terminal,), longest_tick=lambda ops, p: p.controller.sample_time, transport_delay=None)


def _plant(actuator: Actuator) -> Actuator:
    """Return the plant alone."""
    signals = _Signals(actuator)
    dropped = {signals.reference.name, fin_port.MEASURED_FIN_ANGLE.name, fin_port.TRACKING_ERROR.name}
    shown = {v.name: v for v in actuator.outputs if v.name not in dropped} | signals.measured
    starts = {s.name: s.start for s in actuator.sampled_states}

    def initial(ops: Ops, p: Any, start: Record) -> Values:
        return _only(actuator.start(ops, p, start.fin_angle, start.encoder_offset), (s.name for s in actuator.states))

    def sample(ops: Ops, p: Any, x: Record, inputs: SampleInputs) -> Values:
        return {"reference": getattr(inputs, identifier(signals.reference.name))}

    def output_values(ops: Ops, p: Any, x: Record, u: PlantInputs) -> Values:
        # A measured state replaces the output of its name, which may depend on inputs: an algebraic loop.
        return {**_only(actuator.output_values(ops, p, x, u), shown), **_only(vars(x), signals.measured)}

    return replace(
        actuator, controller_states=(), sampled_states=(), initial=initial, sample=sample, output_values=output_values,
        outputs=fin_port.described({"saturated": "a limit of the plant is active"}, tuple(shown.values())),
        further_inputs=(*actuator.acting_inputs, _input(signals.reference),
                        *(_input(v, starts[name]) for name, v in signals.sampled.items())),
        provides=frozenset(), hidden=frozenset({fin_port.COMMAND.name}),
        terminals=(*actuator.terminals, signals.terminal))


CONTROLLER, PLANT = (
    Extension(name, title, extend, needs=(capabilities.POSITION_LOOP,), replaces=(capabilities.POSITION_LOOP,))
    for name, title, extend in (("controller", "its controllers alone", _controller),
                                ("plant", "its plant alone", _plant)))
