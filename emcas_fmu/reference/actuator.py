"""An actuator as the frame integrates it: states, modes, their equations and events, and its controllers."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from .events import Accuracy, Body, Event, State, Value
from .vehicle import INPUTS_AT_REST, Surroundings, clip, surroundings

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

    def inputs(self) -> dict[str, float]:
        """Return the start value of every input, SI."""
        return {**INPUTS_AT_REST, self.supply[0]: self.p[self.supply[1]], "enable": 1.0}

    def surroundings(self, row: Mapping[str, float], reference: float) -> Surroundings:
        """Return what acts under a row of inputs and an output of the controllers that has arrived [V]."""
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
