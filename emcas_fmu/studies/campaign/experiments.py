"""What is done in a sample: kinds of experiments and input profiles, as excitations of the bench."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from math import degrees, pi
from typing import Any

import numpy as np

from ...actuators import get
from ...bench.excitation import COMMAND, STEP, Excitation, sine_from_rest, staircase, step_to, sweep
from ...reference.cases import LEAD_IN
from ...simulation import Array

REQUIREMENT = "requirement"  # no experiment's name: columns begin so
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

    `values` are flat parameters in SI of the `model`, `numbers` those of profiles and commands by name; of many samples
    those that vary are arrays. Raises ValueError for numbers that do not go together.
    """
    number = _finder(numbers, experiment.prefix, 0.0)
    amplitude, *shape = (number(field) for field in EXPERIMENTS[experiment.kind])
    each = zip(*(np.ravel(x).tolist() for x in np.broadcast_arrays(*shape)), strict=True) if shape else [()]
    made = [_unit(experiment.kind, experiment.duration, *numbers_of) for numbers_of in each]
    one, time = made[0], made[0].time - LEAD_IN
    unit = one.command if len(made) == 1 else np.stack([each.command for each in made])
    columns: dict[str, Any] = {COMMAND: amplitude * unit + 0.0}  # no -0.0 of a negative amplitude
    inputs = {v.name: v for v in get(model).inputs}
    spring: Any = 0.0
    for profile in experiment.profiles:
        v = inputs[profile.variable]
        number = _finder(numbers, profile.prefix, v.initial(values))
        if profile.kind == "spring":
            columns[v.name], spring = number("offset"), number("stiffness")
        else:
            columns[v.name] = _SHAPES[profile.kind](time, number)
    size = "" if np.ndim(amplitude) else f" of {degrees(amplitude):.6g} deg"
    return replace(one.holding(columns), title=experiment.kind + size,
                   spring=np.ravel(spring) if np.ndim(spring) else spring)


Number = Callable[[str], Any]


def _finder(numbers: Mapping[str, Any], prefix: str, start: Any) -> Number:
    """Return what gives a number by its field; of many samples an array [samples, 1], if it varies."""
    def found(field: str) -> Any:
        value = numbers.get(f"{prefix}.{field}", start)
        return np.asarray(value, dtype=float)[:, np.newaxis] if np.ndim(value) else float(value)
    return found


# Of amplitude 1, by the fields besides the amplitude.
_UNITS: Mapping[str, Callable[..., Excitation]] = {
    "step": lambda duration: step_to(1.0, duration),
    "hold": lambda duration: staircase((1.0, 1.0), (LEAD_IN, duration)),
    "sine": lambda duration, frequency: sine_from_rest(1.0, frequency, duration),
    "chirp": lambda duration, low, high: sweep(1.0, duration, low, high),
}


@lru_cache(maxsize=64)
def _unit(kind: str, duration: float, *shape: float) -> Excitation:
    return _UNITS[kind](duration, *shape)


def _from(time: Array, instant: Any) -> Any:
    """Return whether rows are at an instant or later; one a rounding short of it is on it."""
    return time > instant - STEP / 2


def _window(time: Array, number: Number) -> Any:
    begin, end = number("begin"), number("end")
    for first, last in np.broadcast(begin, end):
        if last < first:
            raise ValueError(f"a window's end = {last:g} s is before its begin = {first:g} s")
    return np.where(_from(time, begin) & ~_from(time, end), number("value"), number("outside"))


_SHAPES: Mapping[str, Callable[[Array, Number], Any]] = {
    "constant": lambda time, number: number("value"),
    "step": lambda time, number: np.where(_from(time, number("at")), number("after"), number("before")),
    "window": _window,
    # Row by row, so that the library takes the same steps whichever others there are.
    "sine": lambda time, number: number("offset") + number("amplitude") * np.apply_along_axis(
        np.sin, -1, 2.0 * pi * number("frequency") * np.maximum(time, 0.0)),
}
