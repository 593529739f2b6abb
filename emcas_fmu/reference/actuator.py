"""Simulation of an actuator: sampled controllers, a delayed DAC and held inputs; the plant is integrated.

Between two discrete instants (a sample, the arrival of a delayed DAC value, an input row) the actuator is integrated
from event to event.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from . import events
from .controllers import Bus
from .events import Accuracy, Array, Body, Event, Scalar, StateVector
from .vehicle import INPUTS_AT_REST, Surroundings, as_built, clip, surroundings

DIGITS = 12  # decimals of a second to which instants are rounded: coinciding instants are then equal

Sample = Callable[[StateVector, float, bool], float]
"""Function of state, command [rad] and enable signal that returns the controllers' output [V or 1]; called once per
sample."""


class ReferenceActuator(ABC):
    """One actuator with its parameters `p`: equations for each mode, and the events that end a mode."""

    accuracy: Accuracy
    names: tuple[str, ...]
    """Names of the outputs, in the order of `outputs`, then that of the controllers' output if it is recorded."""
    supply = ("supply_voltage", "drive.supply_voltage")
    """Names of the supply's input and of the parameter with its start value."""
    p: Mapping[str, float]
    bodies: tuple[Body, ...] = ()

    @abstractmethod
    def __init__(self, parameters: Mapping[str, Scalar]): ...

    @abstractmethod
    def start(self) -> tuple[StateVector, Any]:
        """Return the state and the mode at the start, at rest at the start angle."""

    @abstractmethod
    def controller(self, nominal: Any) -> Sample:
        """Return the controllers in their start state; they compute with the `nominal` actuator."""

    @abstractmethod
    def outputs(self, y: StateVector, around: Surroundings) -> Sequence[float]:
        """Return the outputs [SI] at a state, in the order of `names`, without the controllers' output."""

    @abstractmethod
    def slope(self, y: StateVector, mode: Any, around: Surroundings) -> Sequence[float]:
        """Return d/dt of the state [SI/s] in a mode."""

    @classmethod
    def simulate(cls, parameters: Mapping[str, Scalar], inputs: Mapping[str, Array]) -> dict[str, Array]:
        """Simulate one actuator and return `time` [s] and its outputs [SI] at the rows.

        `inputs` contains the row times `time` [s], from 0, and any input columns [SI], named as in the interface. A row
        is held until the next. Outputs are left limits: a sample at a row time affects later rows only. Raises
        ValueError for unknown inputs and impossible values, ArithmeticError if the integration fails.
        """
        p = {name: float(value) for name, value in parameters.items()}
        actuator = cls(as_built(p))
        columns, sample = columns_of(inputs, actuator.inputs()), actuator.controller(cls(p))
        if round(first := float(inputs["time"][0]), DIGITS) != 0.0:
            raise ValueError(f"row times start at {first:g} s; they must start at 0")
        instants, (row_at, sample_at, arrival_at) = schedule(inputs["time"], p)
        bus, (state, mode), sent, arrived = Bus(p), actuator.start(), [0.0], 0.0
        row = {name: column[0] for name, column in columns.items()}
        around = actuator.surroundings(row, arrived)
        records = []
        for t, next_instant in zip(instants, [*instants[1:], None], strict=True):
            if t in row_at:
                records.append((t, *actuator.outputs(state, around), sent[-1]))
                row = {name: column[row_at[t]] for name, column in columns.items()}
            if next_instant is None:
                break
            if t in sample_at:
                sent.append(sample(state, bus.arrived(row["fin_command"]), bool(row["enable"])))
            if t in arrival_at:
                arrived = sent[1 + arrival_at[t]]
            around = actuator.surroundings(row, arrived)
            mode = actuator.admit(state, mode, around)
            state, mode = events.advance(actuator, state, mode, around, t, next_instant)
        return dict(zip(("time", *actuator.names), np.array(records).T, strict=False))  # drops an unnamed column

    def inputs(self) -> dict[str, float]:
        """Return the start value [SI] of every input."""
        return {**INPUTS_AT_REST, self.supply[0]: self.p[self.supply[1]], "enable": 1.0}

    def surroundings(self, row: Mapping[str, float], reference: float) -> Surroundings:
        """Return loads and current reference from a row of inputs and the controllers' delayed output [V]."""
        current = self.p["drive.current_gain"] * reference + self.p["drive.current_offset"]
        return surroundings(self.p, row, clip(current, self.p["drive.current_limit"]), self.supply[0])

    def admit(self, y: StateVector, mode: Any, around: Surroundings) -> Any:
        """Return the mode after a jump of the surroundings; may correct the state in place."""
        return self.settled(y, mode, around)

    def settled(self, y: StateVector, mode: Any, around: Surroundings) -> Any:
        """Return the mode in which each body at rest starts if nothing holds it; called after every event and jump."""
        for body in self.bodies:
            if not getattr(mode, body.field):
                mode = mode._replace(**{body.field: body.starts(y, mode, around)})
        return mode

    def events(self, mode: Any, around: Surroundings) -> list[Event]:
        """Return the events that end a mode."""
        return [event for body in self.bodies for event in body.events(mode, around)]


def schedule(time: Any, p: Mapping[str, Any]) -> tuple[list[float], Iterator[dict[float, int]]]:
    """Return the instants [s] of a run with rows at `time` [s], and three mappings from instants to indices.

    The indices are those of the row, of the sample, and of the sample whose DAC value reaches the drive.
    """
    period, rows = p["controller.sample_time"], np.round(np.asarray(time, dtype=float), DIGITS)
    samples = np.arange(math.floor(rows[-1] / period) + 1) * period
    delays = (0.0, p.get("drive.transport_delay", 0.0))
    sequences = [rows, *(np.round(samples + delay, DIGITS) for delay in delays)]
    instants = np.unique(np.concatenate(sequences))
    return instants[instants <= rows[-1]].tolist(), ({t: k for k, t in enumerate(each.tolist())} for each in sequences)


def columns_of(inputs: Mapping[str, Any], starts: Mapping[str, float]) -> dict[str, list[float]]:
    """Return every input's column, or its constant start value if `inputs` lacks it.

    Raises ValueError for an unknown input.
    """
    if unknown := sorted(set(inputs) - set(starts) - {"time"}):
        raise ValueError(f"unknown inputs {', '.join(unknown)}; the actuator has {', '.join(starts)}")
    shape = np.shape(inputs["time"])
    return {name: np.broadcast_to(inputs.get(name, start), shape).tolist() for name, start in starts.items()}
