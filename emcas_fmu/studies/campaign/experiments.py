"""What is done in a sample: kinds of experiments and input profiles, as excitations of the bench."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from math import pi
from typing import Any

import numpy as np

from ...actuators import get
from ...bench.excitation import STEP, Excitation, sine_from_rest, staircase, step_to, sweep
from ...reference.cases import LEAD_IN
from ...simulation import Array

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


def excitation(experiment: Experiment, values: Mapping[str, Any], numbers: Mapping[str, Any],
               model: str) -> Excitation:
    """Return the excitation of an experiment; its command begins after LEAD_IN, and profiles count from there.

    `values` are flat parameters in SI of the `model`, `numbers` those of profiles and commands by name. Raises
    ValueError for numbers that do not go together.
    """
    made = _COMMANDS[experiment.kind](_finder(numbers, experiment.prefix, 0.0), experiment.duration)
    time = made.time - LEAD_IN
    inputs = {v.name: v for v in get(model).inputs}
    columns: dict[str, Any] = {}
    spring = 0.0
    for profile in experiment.profiles:
        v = inputs[profile.variable]
        number = _finder(numbers, profile.prefix, float(v.initial(values)))
        if profile.kind == "spring":
            columns[v.name], spring = number("offset"), number("stiffness")
        else:
            columns[v.name] = _SHAPES[profile.kind](time, number)
    return replace(made.holding(columns), spring=spring)


Number = Callable[[str], float]


def _finder(numbers: Mapping[str, Any], prefix: str, start: float) -> Number:
    return lambda field: float(numbers.get(f"{prefix}.{field}", start))


_COMMANDS: Mapping[str, Callable[[Number, float], Excitation]] = {
    "step": lambda number, duration: step_to(number("amplitude"), duration),
    "hold": lambda number, duration: staircase((number("amplitude"),) * 2, (LEAD_IN, duration)),
    "sine": lambda number, duration: sine_from_rest(number("amplitude"), number("frequency"), duration),
    "chirp": lambda number, duration: sweep(number("amplitude"), duration, number("low"), number("high")),
}


def _from(time: Array, instant: float) -> Array:
    """Return rows at an instant or later; a row a rounding short of it is on it."""
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
