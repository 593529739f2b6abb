"""An actuator in time: sampled controllers, delayed DAC and held inputs around equations that are integrated.

Between two discrete instants (a sample, the arrival of a delayed DAC value, an input row) the actuator is integrated
from event to event; at each instant the discrete parts act.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from . import events
from .controllers import Bus
from .events import Accuracy, Array, Body, Event, State, Value
from .vehicle import INPUTS_AT_REST, Surroundings, as_built, clip, surroundings

DIGITS = 12  # decimals of a second to which instants are rounded so that coinciding ones are one

Sample = Callable[[State, float, bool], float]
"""From the state, the command [rad] and the enable signal to the controllers' output, once per sample."""


class Actuator(ABC):
    """One actuator with its parameters `p`: equations for each mode, and the events that end a mode."""

    accuracy: Accuracy
    names: tuple[str, ...]
    """The outputs; the controllers' last unless it is not an output."""
    supply = ("supply_voltage", "drive.supply_voltage")
    """Names of the supply's input and of the parameter that is its start value."""
    p: Mapping[str, float]
    bodies: tuple[Body, ...] = ()

    @abstractmethod
    def __init__(self, parameters: Mapping[str, Value]): ...

    @abstractmethod
    def start(self) -> tuple[State, Any]:
        """Return the state and the mode at the start."""

    @abstractmethod
    def controller(self, nominal: Any) -> Sample:
        """Return the controllers at the start, which compute with the `nominal` actuator."""

    @abstractmethod
    def outputs(self, y: State, around: Surroundings) -> Sequence[float]:
        """Return the outputs of a state."""

    @abstractmethod
    def slope(self, y: State, mode: Any, around: Surroundings) -> Sequence[float]:
        """Return d/dt of the state, in SI per s, in a mode."""

    @classmethod
    def simulate(cls, parameters: Mapping[str, Value], inputs: Mapping[str, Array]) -> dict[str, Array]:
        """Simulate one actuator from its start and return `time` and its outputs at the rows, SI units.

        `inputs` holds the row times `time` [s], from zero, and the columns that are used, named as in the interface; a
        row holds until the next. Outputs are left limits, so a sample that falls on a row shows after it. Raises
        ValueError for inputs that it cannot have, ArithmeticError where the integration fails.
        """
        p = {name: float(value) for name, value in parameters.items()}
        actuator = cls(as_built(p))
        columns, sample = columns_of(inputs, actuator.inputs()), actuator.controller(cls(p))
        if round(float(inputs["time"][0]), DIGITS) != 0.0:
            raise ValueError("row times must start at 0")
        instants, (row_at, sample_at, arrival_at) = schedule(inputs["time"], p)
        bus, (state, mode), sent, arrived = Bus(p), actuator.start(), [0.0], 0.0
        row = {name: column[0] for name, column in columns.items()}
        around = actuator.surroundings(row, arrived)
        records = []
        for t, following in zip(instants, [*instants[1:], None], strict=True):
            if t in row_at:
                records.append((t, *actuator.outputs(state, around), sent[-1]))
                row = {name: column[row_at[t]] for name, column in columns.items()}
            if following is None:
                break
            if t in sample_at:
                sent.append(sample(state, bus.arrived(row["fin_command"]), bool(row["enable"])))
            if t in arrival_at:
                arrived = sent[1 + arrival_at[t]]
            around = actuator.surroundings(row, arrived)
            mode = actuator.admit(state, mode, around)
            state, mode = events.advance(actuator, state, mode, around, t, following)
        return dict(zip(("time", *actuator.names), np.array(records).T, strict=False))  # without what is no output

    def inputs(self) -> dict[str, float]:
        """Return the start value of every input, SI."""
        return {**INPUTS_AT_REST, self.supply[0]: self.p[self.supply[1]], "enable": 1.0}

    def surroundings(self, row: Mapping[str, float], reference: float) -> Surroundings:
        """Return loads and current reference under a row of inputs and a delayed output of the controllers [V]."""
        current = self.p["drive.current_gain"] * reference + self.p["drive.current_offset"]
        return surroundings(self.p, row, clip(current, self.p["drive.current_limit"]), self.supply[0])

    def admit(self, y: State, mode: Any, around: Surroundings) -> Any:
        """Return the mode after the surroundings have jumped; may correct the state in place."""
        return self.settled(y, mode, around)

    def settled(self, y: State, mode: Any, around: Surroundings) -> Any:
        """Return the mode in which each body at rest that nothing holds starts; called after every event."""
        for body in self.bodies:
            if not getattr(mode, body.field):
                mode = mode._replace(**{body.field: body.starts(y, mode, around)})
        return mode

    def events(self, mode: Any, around: Surroundings) -> list[Event]:
        """Return the events that end a mode."""
        return [event for body in self.bodies for event in body.events(mode, around)]


def schedule(time: Any, p: Mapping[str, Any]) -> tuple[list[float], Iterator[dict[float, int]]]:
    """Return the instants [s] of a run with rows at `time` [s]; instants that coincide are one.

    Then, by their times, the numbers of rows, of samples, and of samples that arrive at the drive.
    """
    period, rows = p["controller.sample_time"], np.round(np.asarray(time, dtype=float), DIGITS)
    samples = np.arange(math.floor(rows[-1] / period) + 1) * period
    each = [rows, *(np.round(samples + late, DIGITS) for late in (0.0, p.get("drive.transport_delay", 0.0)))]
    instants = np.unique(np.concatenate(each))
    return instants[instants <= rows[-1]].tolist(), ({t: k for k, t in enumerate(times.tolist())} for times in each)


def columns_of(inputs: Mapping[str, Any], starts: Mapping[str, float]) -> dict[str, list[float]]:
    """Return every input at the rows, its start value without a column. Raises ValueError for an unknown input."""
    if unknown := sorted(set(inputs) - set(starts) - {"time"}):
        raise ValueError(f"unknown inputs {unknown}")
    shape = np.shape(inputs["time"])
    return {name: np.broadcast_to(inputs.get(name, start), shape).tolist() for name, start in starts.items()}
