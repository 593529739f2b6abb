"""An actuator in time: sampled controllers, delayed DAC and held inputs around a plant that is integrated.

Between two discrete instants (a sample, the arrival of a delayed DAC value, an input row) the plant is integrated from
event to event; at each instant the discrete parts act.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from . import events
from .controllers import Bus, Controllers
from .events import State, Value, Vector
from .plant import Plant
from .vehicle import INPUTS_AT_REST

Array = NDArray[np.floating[Any]]

# Interface inputs and their start values, SI; a parameter drive.supply_voltage replaces that of the supply.
INPUTS = {**INPUTS_AT_REST, "supply_voltage": 39.0, "enable": 1.0}
OUTPUTS = ("fin_angle", "fin_rate", "motor_current", "motor_voltage", "drive_reference")
DIGITS = 12  # decimals of a second to which instants are rounded so that coinciding ones are one


class Simulated(events.Plant, Protocol):
    """A plant as :func:`run` needs it."""

    def start(self) -> tuple[State, Any]:
        """Return the state and the mode at the start."""

    def surroundings(self, row: Mapping[str, float], reference: float) -> Any:
        """Return what acts under a row of inputs and a controllers' output that has arrived."""

    def admit(self, state: State, mode: Any, around: Any) -> Any:
        """Return the mode after the surroundings have jumped; may correct the state in place."""

    def outputs(self, state: Vector, mode: Any, around: Any) -> Sequence[float]:
        """Return the plant's outputs."""


def run(plant: Simulated, sample: Callable[[State, float, bool], float], p: Mapping[str, float],
        inputs: Mapping[str, Array], starts: Mapping[str, float], outputs: Sequence[str]) -> dict[str, Array]:
    """Simulate a plant under sampled controllers and return `time` and its `outputs` at the rows, SI units.

    `sample` returns the output of the controllers from the plant's state, the command [rad] and the enable signal;
    the last of the `outputs` is that value, the others are the plant's. `inputs` holds the row times `time` [s], from
    zero, and columns by name; a row holds until the next. `starts` holds the start value of every input. Outputs are
    left limits, so a sample that falls on a row shows after it.
    """
    columns = columns_of(inputs, starts)
    if round(float(inputs["time"][0]), DIGITS) != 0.0:
        raise ValueError("row times must start at 0")
    instants, row_at, sample_at, arrival_at = schedule(inputs["time"], p)
    bus, (state, mode), sent, arrived = Bus(p), plant.start(), [0.0], 0.0
    row = {name: column[0] for name, column in columns.items()}
    around = plant.surroundings(row, arrived)
    records = []
    for t, following in zip(instants, [*instants[1:], None], strict=True):
        if t in row_at:
            records.append((t, *plant.outputs(state, mode, around), sent[-1]))
            row = {name: column[row_at[t]] for name, column in columns.items()}
        if following is None:
            break
        if t in sample_at:
            sent.append(sample(state, bus.arrived(row["fin_command"]), bool(row["enable"])))
        if t in arrival_at:
            arrived = sent[1 + arrival_at[t]]
        around = plant.surroundings(row, arrived)
        mode = plant.admit(state, mode, around)
        state, mode = events.advance(plant, state, mode, around, t, following)
    return dict(zip(("time", *outputs), np.array(records).T, strict=True))


def simulate(parameters: Mapping[str, Value], inputs: Mapping[str, Array], kind: type[Plant] = Plant
             ) -> dict[str, Array]:
    """Simulate one actuator from rest and return `time` and the `OUTPUTS` at the rows, SI units.

    `inputs` holds the uniform row times `time` [s], from zero, and the columns that are used, named as in the
    interface; a row holds until the next. Outputs are left limits. `kind` is the plant.
    """
    check_supply(inputs)
    nominal = kind(parameters)
    plant, p = nominal.as_built(), nominal.parameters
    controllers = Controllers(plant, nominal, p["fin.start_angle"])
    return run(plant, lambda y, command, enable: controllers.sample(y[0], y[1], command, enable, y[2]), p, inputs,
               voltage_starts(parameters), OUTPUTS)


class Schedule(NamedTuple):
    """The instants [s] of a run; by their times the numbers of rows, of samples, and of samples that arrive."""

    instants: list[float]
    rows: dict[float, int]
    samples: dict[float, int]
    arrivals: dict[float, int]


def schedule(time: Any, p: Mapping[str, Any]) -> Schedule:
    """Return the instants of a run with rows at `time` [s]; instants that coincide are one."""
    period, rows = p["controller.sample_time"], np.round(np.asarray(time, dtype=float), DIGITS)
    samples = np.arange(math.floor(rows[-1] / period) + 1) * period
    each = [rows, *(np.round(samples + late, DIGITS) for late in (0.0, p["drive.transport_delay"]))]
    instants = np.unique(np.concatenate(each))
    return Schedule(instants[instants <= rows[-1]].tolist(),
                    *({t: k for k, t in enumerate(times.tolist())} for times in each))


def voltage_starts(parameters: Mapping[str, Any]) -> dict[str, float]:
    """Return the start values of the inputs of an actuator on a voltage bus."""
    return {**INPUTS, "supply_voltage": float(parameters.get("drive.supply_voltage", INPUTS["supply_voltage"]))}


def check_supply(inputs: Mapping[str, Any]) -> None:
    """Raise ValueError for a supply voltage that is not above 0."""
    if np.min(inputs.get("supply_voltage", INPUTS["supply_voltage"])) <= 0.0:
        raise ValueError("supply_voltage must be above 0: the modes of the drive are distinguished by its limits")


def columns_of(inputs: Mapping[str, Any], starts: Mapping[str, float]) -> dict[str, list[float]]:
    """Return every input at the rows, its start value without a column. Raises ValueError for an unknown input."""
    if unknown := sorted(set(inputs) - set(starts) - {"time"}):
        raise ValueError(f"unknown inputs {unknown}")
    shape = np.shape(inputs["time"])
    return {name: np.broadcast_to(inputs.get(name, start), shape).tolist() for name, start in starts.items()}
