"""What is done in a sample: kinds of experiments and input profiles, and the rows of inputs they make."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import pi
from typing import Any

import numpy as np

from ..actuators import NONLINEAR, get
from ..bench.excitation import STEP
from ..reference.cases import LEAD_IN
from ..simulation import Array

SAME = ""  # in the tables below: the unit of the input itself
# The command of each kind of experiment: fields with units. All but those with a default must be given.
EXPERIMENTS: Mapping[str, Mapping[str, str]] = {
    "step": {"amplitude": SAME},
    "sine": {"amplitude": SAME, "frequency": "Hz"},
    "chirp": {"amplitude": SAME, "low": "Hz", "high": "Hz"},
    "hold": {"amplitude": SAME},
}
PROFILES: Mapping[str, Mapping[str, str]] = {
    "constant": {"value": SAME},
    "step": {"before": SAME, "after": SAME, "at": "s"},
    "window": {"value": SAME, "begin": "s", "end": "s", "outside": SAME},
    "sine": {"amplitude": SAME, "frequency": "Hz", "offset": SAME},
    "spring": {"stiffness": "N.m/rad", "offset": SAME},
}
# What these stand for where they are left out is the input's start.
OPTIONAL = ("before", "outside", "offset")
COMMAND, LOAD, POWER = "fin_command", "aero_torque", "supply_power"
# Power is looked at more often than the rest: the drive's short transients follow the controller's samples.
POWER_ROWS = 5
POWER_STEP = STEP / POWER_ROWS
INDEX = {v.name: i for i, v in enumerate(get(NONLINEAR).inputs)}  # a model's own inputs stand behind these


@dataclass(frozen=True)
class Profile:
    """How an input goes: `prefix` and a field's name make the name its number is found by."""

    variable: str
    kind: str
    prefix: str


@dataclass(frozen=True)
class Experiment:
    """A run of a sample: the command's kind, `duration` [s] from its instant on, profiles of other inputs."""

    name: str
    kind: str
    duration: float
    profiles: tuple[Profile, ...] = ()

    @property
    def prefix(self) -> str:
        """Of the names of the command's numbers."""
        return f"experiments.{self.name}"


@dataclass(frozen=True)
class Excitation:
    """`time` [s] (n) from the command's instant; `table` (n, inputs), SI; a spring's `stiffness` [N.m/rad] if any;
    `told` [s] from the command's instant: when the drive gets a new reference."""

    time: Array
    table: Array
    stiffness: float
    told: Array


def excitation(experiment: Experiment, values: Mapping[str, Any], numbers: Mapping[str, Any],
               model: str = NONLINEAR) -> Excitation:
    """The rows of inputs of an experiment, STEP apart, each held until the next; the command begins after LEAD_IN.

    `values` are flat parameters in SI, `numbers` those of profiles and commands by name; the table's columns are the
    inputs of the `model`.
    """
    inputs = get(model).inputs
    time = np.arange(round((LEAD_IN + experiment.duration) / STEP) + 1) * STEP - LEAD_IN
    table = np.empty((len(time), len(inputs)))
    starts = [float(values[v.key] if v.key else v.start or 0.0) for v in inputs]
    index = {v.name: i for i, v in enumerate(inputs)}
    table[:] = starts
    stiffness = 0.0
    for profile in experiment.profiles:
        column = index[profile.variable]
        number = _finder(numbers, profile.prefix, starts[column])
        if profile.kind == "spring":
            table[:, column] = number("offset")
            stiffness = number("stiffness")
        else:
            table[:, column] = _SHAPES[profile.kind](time, number)
    table[:, INDEX[COMMAND]] = _COMMANDS[experiment.kind](
        np.maximum(time, 0.0), time > -STEP / 2, _finder(numbers, experiment.prefix, 0.0), experiment.duration)
    return Excitation(time, table, stiffness, _told(values, float(time[-1])))


def _told(values: Mapping[str, Any], end: float) -> Array:
    """Samples reach the drive a transport delay later; none where they come too often to be told apart."""
    period, delay = float(values["controller.sample_time"]), float(values["drive.transport_delay"])
    if period < 2.0 * POWER_STEP:
        return np.empty(0)
    first = np.ceil((LEAD_IN - delay) / period - 1e-6)
    return np.arange(first, (end + LEAD_IN - delay) / period) * period + delay - LEAD_IN


Number = Callable[[str], float]


def _finder(numbers: Mapping[str, Any], prefix: str, start: float) -> Number:
    return lambda field: float(numbers.get(f"{prefix}.{field}", start))


def _sweep(since: Array, number: Number, duration: float) -> Array:
    """Logarithmic sine sweep over the whole duration."""
    low, high = number("low"), number("high")
    if not low < high:
        raise ValueError(f"the sweep's low = {low:g} Hz is not below its high = {high:g} Hz")
    growth = np.log(high / low) / duration
    return np.asarray(number("amplitude") * np.sin(2.0 * pi * low * np.expm1(growth * since) / growth))


_COMMANDS: Mapping[str, Callable[[Array, Array, Number, float], Array]] = {
    "step": lambda _, on, number, __: np.where(on, number("amplitude"), 0.0),
    "hold": lambda since, _, number, __: np.full_like(since, number("amplitude")),
    "sine": lambda since, _, number, __: number("amplitude") * np.sin(2.0 * pi * number("frequency") * since),
    "chirp": lambda since, _, number, duration: _sweep(since, number, duration),
}


def _from(time: Array, instant: float) -> Array:
    """Rows at an instant or later; a row a rounding short of it is on it."""
    return time > instant - STEP / 2


def _window(time: Array, number: Number) -> Array:
    begin, end = number("begin"), number("end")
    if end < begin:
        raise ValueError(f"a window's end = {end:g} s is before its begin = {begin:g} s")
    return np.where(_from(time, begin) & ~_from(time, end), number("value"), number("outside"))


_SHAPES: Mapping[str, Callable[[Array, Number], Any]] = {
    "constant": lambda time, number: number("value"),
    "step": lambda time, number: np.where(_from(time, number("at")), number("after"), number("before")),
    "window": _window,
    "sine": lambda time, number: number("offset") + number("amplitude") * np.sin(
        2.0 * pi * number("frequency") * np.maximum(time, 0.0)),
}
